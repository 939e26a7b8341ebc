"""All framers against any bytes: any content, any split, any loss."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation
from pointit.services.imu_bridge.reading import Item, RawReading, Reading
from pointit.services.imu_bridge.serial.bno085 import LENGTH as BNO085_LENGTH
from pointit.services.imu_bridge.serial.bno085 import Bno085Framer
from pointit.services.imu_bridge.serial.config import SerialConfig
from pointit.services.imu_bridge.serial.detection import Detection
from pointit.services.imu_bridge.serial.framer import Framer
from pointit.services.imu_bridge.serial.text_line import LONGEST_LINE, TextFramer
from pointit.services.imu_bridge.serial.witmotion import LENGTH as WITMOTION_LENGTH
from pointit.services.imu_bridge.serial.witmotion import WitMotionFramer
from pointit.services.imu_bridge.serial.ximu3 import LONGEST, Ximu3Framer
from pointit.testing import ImuHarness, checks, run_checks
from pointit.testing.templates.imu_source.fake import encode as text
from pointit_lab.devices.harnesses.imu import BNO085_HARNESS, SERIAL_XIMU3_HARNESS, WITMOTION_HARNESS
from pointit_lab.devices.serial_formats import bno085_orientation, witmotion_quaternion, ximu3_quaternion

POSTURE = rotation.from_azimuth_elevation(0.7, -0.3)


@dataclass(frozen=True)
class Kind:
    make: Callable[[], Framer]
    packet: bytes
    end: bytes
    """Bytes behind which a packet is found, whatever was before."""
    kept: Callable[[Framer], int]
    most_kept: int


KINDS = {
    "text": Kind(TextFramer, text(POSTURE), b"\n", lambda framer: framer._splitter.kept, LONGEST_LINE),  # type: ignore[attr-defined]
    "witmotion": Kind(
        lambda: WitMotionFramer(configure=True, baud=0),
        witmotion_quaternion(POSTURE),
        b"\0" * WITMOTION_LENGTH,
        lambda framer: framer._cutter.kept,  # type: ignore[attr-defined]
        WITMOTION_LENGTH,
    ),
    "bno085": Kind(
        Bno085Framer,
        bno085_orientation(POSTURE),
        b"\0" * BNO085_LENGTH,
        lambda framer: framer._cutter.kept,  # type: ignore[attr-defined]
        BNO085_LENGTH,
    ),
    "ximu3": Kind(
        Ximu3Framer,
        ximu3_quaternion(POSTURE, 77),
        b"\n",
        lambda framer: framer.kept,  # type: ignore[attr-defined]
        LONGEST,
    ),
}
each_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
headers = st.sampled_from([b"\x55", b"\x55\x59", b"\xaa", b"\xaa\xaa", b"\n", b"\xd1", b"Q,", b"\xdb", b"{"])
pieces = st.lists(st.binary(max_size=60) | headers | st.just(b"\x55" * 300), max_size=12)


def is_unit(item: Item) -> bool:
    if isinstance(item, Reading):
        return abs(sum(value * value for value in item.world_from_sensor) - 1) < 1e-6
    return True


@each_kind
@given(garbage=pieces)
def test_any_bytes_give_unit_orientations_or_nothing_and_are_not_kept(
    kind: Kind, garbage: list[bytes]
) -> None:
    framer = kind.make()
    for piece in garbage:
        assert all(map(is_unit, framer.feed(piece, 0)))
        assert kind.kept(framer) <= kind.most_kept


@each_kind
@given(garbage=st.binary(max_size=100))
def test_packets_behind_garbage_are_found(kind: Kind, garbage: bytes) -> None:
    framer = kind.make()
    framer.feed(garbage + kind.end, 0)
    items = framer.feed(kind.packet * 3, 0)
    assert any(isinstance(item, Reading | RawReading) for item in items)


@pytest.mark.parametrize(("name", "header"), [("witmotion", b"\x55\x59"), ("bno085", b"\xaa\xaa\x01")])
def test_packet_directly_behind_what_looks_like_a_header_is_found(name: str, header: bytes) -> None:
    kind = KINDS[name]
    framer = kind.make()
    assert len(framer.feed(header + kind.packet, 0) + framer.feed(b"\0" * 20, 0)) == 1


@each_kind
@given(sizes=st.lists(st.integers(1, 40), min_size=1, max_size=30))
def test_how_a_stream_is_split_does_not_matter(kind: Kind, sizes: list[int]) -> None:
    stream = kind.end + kind.packet * 8
    whole, split = kind.make(), kind.make()
    expected = whole.feed(stream, 0)
    items: list[Item] = []
    at = 0
    while at < len(stream):
        size = sizes[at % len(sizes)]
        items += split.feed(stream[at : at + size], 0)
        at += size
    assert items == expected
    assert split.good == whole.good == 8


@each_kind
@given(lost=st.integers(0, 200), count=st.integers(1, 20))
def test_lost_bytes_cost_the_packets_they_were_in(kind: Kind, lost: int, count: int) -> None:
    stream = kind.packet * 20
    lost %= len(stream)
    framer = kind.make()
    framer.feed(kind.end, 0)
    framer.feed(stream[:lost] + stream[lost + count :], 0)
    assert framer.good >= 20 - 2 - count // len(kind.packet) - 1


@each_kind
def test_a_flood_of_headers_is_read_in_linear_time(kind: Kind) -> None:
    framer = kind.make()
    for header in (b"\x55", b"\xaa", b"\n", b"Q,1,", b"{"):
        assert framer.feed(header * 20_000, 0) == []
    assert kind.kept(framer) <= kind.most_kept


@given(garbage=pieces)
def test_detection_survives_any_bytes(garbage: list[bytes]) -> None:
    detection = Detection(SerialConfig())
    for number, piece in enumerate(garbage):
        assert all(map(is_unit, detection.feed(piece, 0, number * 0.7)))
        assert detection.baud > 0


@each_kind
def test_each_format_is_recognized(kind: Kind) -> None:
    detection = Detection(SerialConfig())
    detection.feed(kind.end + kind.packet * 5, 0, 0.0)
    [name] = [name for name, each in KINDS.items() if each is kind]
    assert detection.found is not None
    assert (detection.found.format, detection.found.baud) == (name, 115200)


@each_kind
@given(garbage=st.binary(max_size=400), at=st.integers(0, 10))
def test_a_format_is_not_mistaken_for_another_behind_garbage(kind: Kind, garbage: bytes, at: int) -> None:
    detection = Detection(SerialConfig())
    stream = kind.packet[at:] + garbage + kind.end + kind.packet * 8
    detection.feed(stream, 0, 0.0)
    assert detection.found is not None
    assert KINDS[detection.found.format] is kind


ABOUT_DATA = {"delivers", "bad_bytes", "not_finite", "not_unit"}
"""Checks that depend on the format; `pointit plugin check` makes all of them with lines of text."""


@pytest.mark.parametrize(
    "harness", [WITMOTION_HARNESS, BNO085_HARNESS, SERIAL_XIMU3_HARNESS], ids=["witmotion", "bno085", "ximu3"]
)
def test_source_keeps_its_promises_about_data(harness: ImuHarness) -> None:
    chosen = [check for check in checks(harness) if check.name in ABOUT_DATA]
    assert len(chosen) == len(ABOUT_DATA)
    assert [problem for _, problem in run_checks(chosen) if problem] == []
