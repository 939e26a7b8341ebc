"""Lines of text from boards: each documented form, what is refused, and what no bytes may do."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.serial.line_parser import ButtonLine, LineError, LineParser, QuaternionLine
from pointit.services.imu_bridge.serial.text_line import LineSplitter


def quaternion(line: bytes, parser: LineParser | None = None) -> QuaternionLine:
    parsed = (parser or LineParser()).parse(line)
    assert isinstance(parsed, QuaternionLine)
    return parsed


@pytest.mark.parametrize(
    "line",
    [
        b"0.5,-0.5,0.5,0.5",
        b"0.5, -0.5, 0.5, 0.5\r",
        b"  0.5 -0.5\t0.5 .5 ",
        b"0.5;-0.5;0.5;0.5;",
        b"Quaternion: 0.5, -0.5, 0.5, 0.5",
        b"my-imu 2: 5e-1 -5e-1 0.5 +0.5",
    ],
)
def test_all_forms_of_one_quaternion(line: bytes) -> None:
    assert quaternion(line).orientation_xyzw == (-0.5, 0.5, 0.5, 0.5)


@pytest.mark.parametrize(
    ("line", "parser", "orientation_xyzw", "time_ns"),
    [
        (b"0,0,0,1", LineParser("xyzw"), (0, 0, 0, 1), None),
        (b"0,0,0,1", LineParser("wxyz"), (0, 0, 1, 0), None),
        (b"1500000,1,0,0,0", LineParser(), (0, 0, 0, 1), 1_500_000_000),
        (b"0.00,0.00,0.71,0.71,3.14,", LineParser("xyzw"), (0, 0, math.sqrt(0.5), math.sqrt(0.5)), None),
        (b"1,0,0,0,1", LineParser("xyzw", "time"), (0, 0, 0, 1), 1000),
        (b"1,0,0,0,1", LineParser("xyzw", "accuracy"), (1, 0, 0, 0), None),
    ],
)
def test_order_and_meaning_of_a_fifth_number_are_as_configured(
    line: bytes, parser: LineParser, orientation_xyzw: tuple[float, ...], time_ns: int | None
) -> None:
    parsed = quaternion(line, parser)
    assert parsed.orientation_xyzw == pytest.approx(orientation_xyzw)
    assert parsed.device_time_ns == time_ns


@pytest.mark.parametrize("line", [b"button", b"B", b"Button press", b"b:press"])
def test_button_lines_are_gestures(line: bytes) -> None:
    assert LineParser().parse(line) == ButtonLine("press")
    assert LineParser().parse(b"button double") == ButtonLine("double")


@pytest.mark.parametrize(
    "line", [b"", b"  ", b"# hello", b"Calibration: 1, 0, 0, 0", b"Orientation: 10, 20, 30"]
)
def test_lines_of_other_readings_are_ignored(line: bytes) -> None:
    assert LineParser().parse(line) is None


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"nan,0,0,1", "'nan'"),
        (b"inf,0,0,1", "'inf'"),
        (b"1e999,0,0,1", "not finite"),
        (b"1_0,0,0,1", "'1_0'"),
        (b"1,0,0", "3 numbers"),
        (b"1,0,0,0,0,0", "6 numbers"),
        (b"0,0,0,0", "norm 0"),
        (b"1,1,0,0", "norm 1.41"),
        (b"0.89,0,0,0", "norm 0.89"),
        (b"-5,1,0,0,0", "time -5"),
        (b"1e300,1,0,0,0", "time 1e+300"),
        (b"\xff\x00\x80", "not text"),
        (b"hello world", "'hello'"),
    ],
)
def test_unreadable_line_is_refused_with_a_reason(line: bytes, reason: str) -> None:
    with pytest.raises(LineError, match=reason.replace("+", r"\+")):
        LineParser().parse(line)


@given(st.text("0123456789.,;-+eE: \tnaifbQ", max_size=60))
def test_random_almost_lines_give_unit_quaternions_or_reasons(text: str) -> None:
    try:
        parsed = LineParser().parse(text.encode())
    except LineError:
        return
    if isinstance(parsed, QuaternionLine):
        assert math.isclose(math.hypot(*parsed.orientation_xyzw), 1.0, abs_tol=1e-9)


def test_the_first_partial_line_is_thrown_away() -> None:
    splitter = LineSplitter()
    assert splitter.feed(b"0,0,0\n1,0,") == []
    assert splitter.feed(b"0,0\r\nb") == [b"1,0,0,0"]
    assert splitter.feed(b"utton\n\n") == [b"button"]


@given(st.lists(st.sampled_from([b"1,0,0,0", b"button", b"x" * 300, b""]), max_size=20), st.integers(1, 50))
def test_how_the_stream_is_cut_into_chunks_does_not_matter(lines: list[bytes], size: int) -> None:
    stream = b"\n" + b"".join(line + b"\r\n" for line in lines)
    whole, pieces = LineSplitter(), LineSplitter()
    one_by_one: list[bytes] = []
    for start in range(0, len(stream), size):
        one_by_one += pieces.feed(stream[start : start + size])
    assert one_by_one == whole.feed(stream) == [line for line in lines if 0 < len(line) < 300]
    assert pieces.overlong == whole.overlong == lines.count(b"x" * 300)


def test_a_line_is_read_again_after_an_endless_one() -> None:
    splitter = LineSplitter()
    splitter.feed(b"\n")
    splitter.feed(b"\x55" * 10_000)
    assert splitter.buffered_bytes == 0
    for _ in range(10):
        assert splitter.feed(b"\x55" * 100) == []
    assert splitter.overlong >= 1
    assert splitter.feed(b"\n1,0,0,0\n") == [b"1,0,0,0"]
