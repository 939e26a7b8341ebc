"""A sensor that is restarted behind an adapter that stays: a new yaw origin, and none after a mere pause."""

import math
from collections.abc import Callable

import pytest

from pointit.geometry import rotation
from pointit.services.imu_bridge.reading import Item, Reading, Reconnected
from pointit.services.imu_bridge.serial.config import Format, SerialConfig
from pointit.services.imu_bridge.serial.detection import Detection
from pointit_lab.devices.serial_formats import bno085_orientation, witmotion_packet, witmotion_quaternion

LISTENING_S = 0.1
"""Time for which a port is listened to when nothing comes, s."""
PERIOD_S = 0.01
ANGLES = 0x53


def text_line(orientation: rotation.Quaternion, _index: int) -> bytes:
    x, y, z, w = orientation
    return f"{w:.4f},{x:.4f},{y:.4f},{z:.4f}\n".encode()


PACKETS: dict[Format, Callable[[rotation.Quaternion, int], bytes]] = {
    "text": text_line,
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
def test_sensor_that_starts_near_its_power_on_yaw_after_a_silence_has_a_new_origin(name: Format) -> None:
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
    [
        (40.0, 4.0, 5.0),
        (40.0, 40.0, 5.0),
        (40.0, 25.0, 5.0),
        (-100.0, 100.0, 60.0),
        (4.0, -2.0, 5.0),
        (40.0, 0.0, 1.5),
    ],
)
def test_radio_that_paused_keeps_the_origin(
    name: Format, before_deg: float, after_deg: float, seconds: float
) -> None:
    line = Line(name)
    line.send(before_deg)
    line.pause(seconds)
    assert connections(line.send(after_deg)) == 0
    assert connections(line.send(0.0)) == 0  # later, the arm turns there


def test_counter_of_a_bno085_that_ran_on_keeps_the_origin_also_near_the_power_on_yaw() -> None:
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


def test_witmotion_that_lost_its_settings_with_its_power_is_switched_again_and_has_new_origins() -> None:
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
