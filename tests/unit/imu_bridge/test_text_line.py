"""Lines of text from boards: each documented form, what is refused, and what no bytes may do."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.network.udp import UdpConfig
from pointit.services.imu_bridge.serial.detection import SerialConfig
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
        b"quat\t0.5\t-0.5\t0.5\t0.5\t",  # i2cdevlib, MPU6050_DMP6
        b"q 5e-1 -5e-1 0.5 +0.5",
        b"qW: 0.5 qX: -0.5 qY: 0.5 qZ: 0.5\t\t",  # Adafruit BNO055, rawdata
        b"Quaternion: w: 0.5 x: -0.5 y: 0.5 z: 0.5",
        b"w,0.5,x,-0.5,y,0.5,z,0.5",
        b"\xef\xbb\xbf0.5,-0.5,0.5,0.5\0",
        b'{"w": 0.5, "x": -0.5, "y": 0.5, "z": 0.5}',
        b'{"quat_w":0.5,"quat_x":-0.5,"quat_y":0.5,"quat_z":0.5,"x":0.1,"y":0,"z":9.8}',
        b'{"t": 7, "q": [0.5, -0.5, 0.5, 0.5]}',
        b'{"Quaternion": [-0.5, 0.5, 0.5, 0.5], "order": "xyzw"}',
        b'{"quat": {"x": -0.5, "y": 0.5, "z": 0.5, "w": 0.5}}',
    ],
)
def test_all_forms_of_one_quaternion(line: bytes) -> None:
    assert quaternion(line).orientation_xyzw == (-0.5, 0.5, 0.5, 0.5)


def test_order_of_four_numbers_is_configurable() -> None:
    assert quaternion(b"0,0,0,1", LineParser("xyzw")).orientation_xyzw == (0, 0, 0, 1)
    assert quaternion(b"0,0,0,1", LineParser("wxyz")).orientation_xyzw == (0, 0, 1, 0)
    assert quaternion(b"w:0 x:0 y:1 z:0", LineParser("xyzw")).orientation_xyzw == (0, 1, 0, 0)


@pytest.mark.parametrize(
    ("form", "line", "time_ns", "names"),
    [
        ("{sensor},{t_us},{w},{x},{y},{z}", "wrist,1500000,1,0,0,0", 1_500_000_000, ("wrist",)),
        ("{t_ms};{w};{x};{y};{z}", "20,5; 1,0 ;0;0;0;", 20_500_000, ()),  # decimal commas
        ("{t_s} {w} {x} {y} {z}", "0.25\t1.00  0.00 | 0 0", 250_000_000, ()),
        ("{x},{y},{z},{w},{_},{_}", "0,0,0,1,nan,ovf", None, ()),
        ("IMU{_} {w} {x} {y} {z}", "IMU3 1 0 0 0", None, ()),
        (
            "[{_}] <inf> {sensor}: {w} {x} {y} {z}",
            "[ 00:00:01.250,000] <inf> left-1: 1 0 0 0",
            None,
            ("left-1",),
        ),
        ("$QUAT,{x},{y},{z},{w}*{_}", "$QUAT,0,0,0,+1.0*3E", None, ()),
        ('{"id": {sensor},"rot": [{x},{y},{z},{w}]}', '{"id": 7, "rot": [0.0, 0.0, 0.0, 1.0]}', None, ("7",)),
    ],
)
def test_described_line_is_read_as_it_is_described(
    form: str, line: str, time_ns: int | None, names: tuple[str, ...]
) -> None:
    parser = LineParser("wxyz", form)
    assert quaternion(line.encode(), parser) == QuaternionLine((0.0, 0.0, 0.0, 1.0), time_ns, names)
    assert parser.parse(b"wrist: button hold") == ButtonLine("hold", ("wrist",))
    with pytest.raises(LineError, match=r"has another form than imu-bridge\.serial\.line; describe it by"):
        parser.parse(b"1,0,0,0,7,7,7")


@pytest.mark.parametrize(
    ("form", "reason"),
    [
        ("{w},{x},{y}", "must have each of"),
        ("{w},{x},{y},{z},{z}", "must have each of"),
        ("{w},{x},{y},{z},{q}", "has the unknown part {q}"),
        ("{w}{x},{y},{z}", "has {w}{x} without a separator"),
    ],
)
def test_form_without_a_clear_quaternion_is_refused(form: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        SerialConfig(line=form)
    with pytest.raises(ValueError, match=reason):
        UdpConfig(line=form)


def test_line_that_nearly_fits_a_form_of_many_parts_is_refused_at_once() -> None:
    parser = LineParser("wxyz", ":".join(["{_}"] * 40) + ",{w},{x},{y},{z}")
    with pytest.raises(LineError):
        parser.parse(b":" * 200 + b"1:" * 28)


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
        (b"nan,0,0,1", "let the device send four numbers"),
        (b"1e999,0,0,1", "norm inf"),
        (b"1_0,0,0,1", "describe it by"),
        (b"1,0,0", "let the device send four numbers, w, x, y and z"),
        (b"0,0,0,0", "norm 0"),
        (b"1,1,0,0", "norm 1.41"),
        (b"0.89,0,0,0", "norm 0.89"),
        (
            b"1,0,0,0,1",
            'none of the documented forms; describe it by imu-bridge.serial.line="{_},{_},{_},{_},{_}"',
        ),
        (b'{"quat": [1, 0, 0, 0], "q": [0, 1, 0, 0]}', "has several quaternions; describe it by"),
        (b'{"q": [1, 0, 0, 0], "w": 1, "x": 0, "y": 0, "z": 0}', "has several quaternions; describe it by"),
        (b'{"q": [1, 0, 0, 0], "order": "yxzw"}', "has the order 'yxzw'"),
        (b'[{"q": [1, 0, 0, 0]}]', "describe it by"),
        (b'{"qw": 1, "qx": 0, "y": 0, "z": 0}', "has no quaternion; describe it by"),
        (b"\xff\x00\x80", "not text"),
    ],
)
def test_unreadable_line_is_refused_with_a_reason(line: bytes, reason: str) -> None:
    with pytest.raises(LineError, match=re.escape(reason)):
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
