"""All framers against any bytes: any content, any split, any loss."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation
from pointit.services.imu_bridge.serial.bno085 import BNO085_LENGTH, Bno085Framer
from pointit.services.imu_bridge.serial.detection import Detection, Format, SerialConfig
from pointit.services.imu_bridge.serial.framers import SerialFramer
from pointit.services.imu_bridge.serial.line_parser import LONGEST_LINE
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.serial.witmotion import LENGTH as WITMOTION_LENGTH
from pointit.services.imu_bridge.serial.witmotion import WitMotionFramer
from pointit.services.imu_bridge.serial.ximu3 import LONGEST, Ximu3Framer
from pointit.services.imu_bridge.sources import Item, Reading, Reconnected
from pointit_lab.devices.contracts import imu
from pointit_lab.devices.serial_formats import (
    bno085_orientation,
    witmotion_packet,
    witmotion_quaternion,
    ximu3_quaternion,
)

POSTURE = rotation.from_azimuth_elevation(0.7, -0.3)


@dataclass(frozen=True)
class Kind:
    make: Callable[[], SerialFramer]
    packet: bytes
    end: bytes
    """Bytes behind which a packet is found, whatever was before."""
    kept: Callable[[SerialFramer], int]
    most_kept: int


KINDS = {
    "text": Kind(
        TextFramer,
        imu.TestSerial().encode(POSTURE),
        b"\n",
        lambda framer: len(framer._splitter._rest),  # pyrefly: ignore[missing-attribute]
        LONGEST_LINE,
    ),
    "witmotion": Kind(
        lambda: WitMotionFramer(configure=True, baud=0),
        witmotion_quaternion(POSTURE),
        b"\0" * WITMOTION_LENGTH,
        lambda framer: len(framer._cutter._rest),  # pyrefly: ignore[missing-attribute]
        WITMOTION_LENGTH,
    ),
    "bno085": Kind(
        Bno085Framer,
        bno085_orientation(POSTURE),
        b"\0" * BNO085_LENGTH,
        lambda framer: len(framer._cutter._rest),  # pyrefly: ignore[missing-attribute]
        BNO085_LENGTH,
    ),
    "ximu3": Kind(
        Ximu3Framer,
        ximu3_quaternion(POSTURE, 77),
        b"\n",
        lambda framer: len(framer._rest),  # pyrefly: ignore[missing-attribute]
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
def test_framers_give_unit_orientations_and_bounded_memory_for_any_bytes(
    kind: Kind, garbage: list[bytes]
) -> None:
    framer = kind.make()
    for piece in garbage:
        assert all(map(is_unit, framer.feed(piece, 0)))
        assert kind.kept(framer) <= kind.most_kept


@pytest.mark.parametrize(("name", "header"), [("witmotion", b"\x55\x59"), ("bno085", b"\xaa\xaa\x01")])
def test_packet_directly_behind_what_looks_like_a_header_is_found(name: str, header: bytes) -> None:
    kind = KINDS[name]
    framer = kind.make()
    assert len(framer.feed(header + kind.packet, 0) + framer.feed(b"\0" * 20, 0)) == 1


@each_kind
@given(sizes=st.lists(st.integers(1, 40), min_size=1, max_size=30))
def test_framers_read_a_stream_however_it_is_split(kind: Kind, sizes: list[int]) -> None:
    stream = kind.end + kind.packet * 8
    whole = kind.make()
    split = kind.make()
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
def test_headers_in_a_flood_are_read_in_linear_time(kind: Kind) -> None:
    framer = kind.make()
    for header in (b"\x55", b"\xaa", b"\n", b"Q,1,", b"{"):
        assert framer.feed(header * 20_000, 0) == []
    assert kind.kept(framer) <= kind.most_kept


@each_kind
@given(garbage=st.binary(max_size=400), at=st.integers(0, 10))
def test_format_behind_garbage_is_not_mistaken_for_another(kind: Kind, garbage: bytes, at: int) -> None:
    detection = Detection(SerialConfig())
    stream = kind.packet[at:] + garbage + kind.end + kind.packet * 8
    detection.feed(stream, 0, 0.0)
    assert detection.found is not None
    assert detection.found.baud == 115200
    assert KINDS[detection.found.format] is kind


@pytest.mark.parametrize("encode", [witmotion_quaternion, bno085_orientation, ximu3_quaternion])
@pytest.mark.parametrize("promise", ["delivers", "bad_bytes"])
def test_source_keeps_its_promises_about_data(
    promise: str, encode: Callable[[rotation.Quaternion], bytes]
) -> None:
    # those that depend on the format; all of them are tested with lines of text
    contract = type("Format", (imu.TestSerial,), {"encode": staticmethod(encode)})
    getattr(contract(), f"test_{promise}")()


LISTENING_S = 0.1
"""Time for which a port is listened to when nothing comes, s."""
PERIOD_S = 0.01
ANGLES = 0x53


PACKETS: dict[Format, Callable[[rotation.Quaternion, int], bytes]] = {
    "text": lambda orientation, _index: imu.TestSerial().encode(orientation),
    "witmotion": lambda orientation, _index: witmotion_quaternion(orientation),
    "bno085": bno085_orientation,
}
each_format = pytest.mark.parametrize("name", PACKETS)


class Line:
    """A serial line in virtual time."""

    def __init__(self, name: Format) -> None:
        self.detection = Detection(SerialConfig(format=name, baud=115200))
        self._packet = PACKETS[name]
        self._now_s = 0.0
        self.index = 0
        """Number of the next packet, as the BNO085 counts them."""

    def feed(self, data: bytes) -> list[Item]:
        return self.detection.feed(data, round(self._now_s * 1e9), self._now_s)

    def send(self, yaw_deg: float, seconds: float = 1.0) -> list[Item]:
        """Return the items while the device sends 100 packets a second, tilted and turned by `yaw_deg`."""
        items: list[Item] = []
        posture = rotation.multiply(
            rotation.from_yaw(math.radians(yaw_deg)), rotation.from_azimuth_elevation(0.0, -0.4, 0.9)
        )
        for _ in range(round(seconds / PERIOD_S)):
            self._now_s += PERIOD_S
            items += self.feed(self._packet(posture, self.index))
            self.index += 1
        return items

    def pause(self, seconds: float, *, runs_on: bool = True) -> None:
        """Let nothing arrive; the device runs on or has no power."""
        for _ in range(round(seconds / LISTENING_S)):
            self._now_s += LISTENING_S
            assert self.feed(b"") == []
        self.index = self.index + round(seconds / PERIOD_S) if runs_on else 0

    def stall(self, seconds: float) -> None:
        """Let time pass without anybody who reads the port."""
        self._now_s += seconds


def connections(items: list[Item]) -> int:
    return sum(isinstance(item, Reconnected) for item in items)


@each_format
def test_yaw_origin_is_new_when_a_silent_sensor_restarts(name: Format) -> None:
    line = Line(name)
    assert connections(line.send(40.0)) == 0
    line.pause(2.1, runs_on=False)
    again = line.send(1.0)
    assert again[0] == Reconnected()
    assert isinstance(again[1], Reading)
    assert connections(again) == 1
    line.send(-70.0)
    line.pause(600.0, runs_on=False)
    assert connections(line.send(-2.0)) == 1


@each_format
@pytest.mark.parametrize(
    ("before_deg", "after_deg", "seconds"),
    [(40.0, 4.0, 5.0), (40.0, 40.0, 5.0), (-100.0, 100.0, 60.0), (4.0, -2.0, 5.0), (40.0, 0.0, 1.5)],
)
def test_radio_that_paused_keeps_the_origin(
    name: Format, before_deg: float, after_deg: float, seconds: float
) -> None:
    line = Line(name)
    line.send(before_deg)
    line.pause(seconds)
    assert connections(line.send(after_deg)) == 0
    assert connections(line.send(0.0)) == 0  # later, the arm turns there


def test_yaw_origin_is_kept_when_a_bno085_counter_runs_on() -> None:
    line = Line("bno085")
    line.send(40.0)
    line.pause(3.0)
    assert line.index % 256 > 32
    assert connections(line.send(0.0)) == 0


def test_device_time_that_runs_on_keeps_the_origin() -> None:
    line = Line("text")
    line.feed(b"\n5000000,0.7071,0,0,0.7071\n")
    line.pause(3.0)
    assert connections(line.feed(b"8000000,1,0,0,0\n")) == 0


@each_format
def test_silence_that_nobody_listened_to_is_none(name: Format) -> None:
    """The process had no time; what came meanwhile is read at once."""
    line = Line(name)
    line.send(40.0)
    line.stall(5.0)
    assert connections(line.send(0.0)) == 0


def test_witmotion_is_switched_again_when_it_lost_its_settings() -> None:
    """As sold it sends angles by compass, whose yaw is anything; then its quaternions begin at 0."""
    line = Line("witmotion")
    detection = line.detection
    assert detection.framer is not None

    def as_sold(count: int) -> list[Item]:
        return [item for _ in range(count) for item in line.feed(witmotion_packet(ANGLES, 0, 0, -9000, 0))]

    as_sold(30)
    detection.framer.commands.clear()
    line.send(40.0)
    assert detection.framer.commands.pop() == bytes.fromhex("ff aa 03 09 00")  # switched
    detection.framer.commands.clear()
    assert connections(as_sold(20)) == 0  # on their way while it was switched
    line.pause(3.0, runs_on=False)
    assert connections(as_sold(30)) == 1
    assert bytes.fromhex("ff aa 02 08 02") in detection.framer.commands
    assert connections(line.send(0.0)) == 1
    assert bytes.fromhex("ff aa 02 00 02") in detection.framer.commands


@pytest.mark.parametrize(
    ("line", "refused"),
    [(b"hello world\r\n", "'hello world' "), (b"\x00\x01\x02\x80\x9f\r\n", "")],
    ids=["text", "bytes"],
)
def test_refused_line_is_kept_only_if_it_is_text(line: bytes, refused: str) -> None:
    framer = TextFramer()
    assert framer.feed(b"\n" + line, 0) == []
    assert framer.bad == 1
    assert framer.refused_text.startswith(refused)
    assert bool(framer.refused_text) is bool(refused)
