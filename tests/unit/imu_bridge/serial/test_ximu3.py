"""x-IMU3's messages: published bytes, text and binary, all kinds that are read, and its commands."""

import math
from collections.abc import Callable

import pytest

from pointit.geometry import rotation
from pointit.schemas import Feedback
from pointit.services.imu_bridge.reading import Battery, Item, Press, RawReading, Reading, Signal
from pointit.services.imu_bridge.serial.ximu3 import LONGEST, Ximu3Framer
from pointit_lab.devices.serial_formats import ximu3_binary, ximu3_text

MANUAL = {
    "Q binary": bytes.fromhex("D1 40420F0000000000 0000803F 00000000 00000000 00000000 0A"),
    "Q text": b"Q,1000000,1.0000,0.0000,0.0000,0.0000\r\n",
}
"""Messages of the user manual: an identity at 1 s."""


def read(data: bytes) -> list[Item]:
    return Ximu3Framer().feed(data, 9)


@pytest.mark.parametrize("message", MANUAL.values(), ids=MANUAL)
def test_messages_of_the_manual_are_read(message: bytes) -> None:
    assert read(message) == [Reading(9, (0, 0, 0, 1), 1_000_000_000)]


def test_encoder_of_the_tests_gives_the_manuals_bytes() -> None:
    assert ximu3_binary("Q", 1_000_000, 1, 0, 0, 0) == MANUAL["Q binary"]
    assert ximu3_text("Q", 1_000_000, 1, 0, 0, 0) == MANUAL["Q text"]


@pytest.mark.parametrize("make", [ximu3_text, ximu3_binary])
def test_battery_signal_and_button_are_read(make: Callable[..., bytes]) -> None:
    stream = make("B", 1, 75, 3.9, 2) + make("W", 2, 100, -50) + make("O", 3, 1) + make("O", 4, 0)
    battery, signal, press = read(stream)
    assert isinstance(battery, Battery)
    assert battery.level == 0.75
    assert battery.volts == pytest.approx(3.9)
    assert signal == Signal(-50)
    assert press == Press(9)


@pytest.mark.parametrize("make", [ximu3_text, ximu3_binary])
def test_inertial_messages_are_raw_readings_when_nothing_else_comes(make: Callable[..., bytes]) -> None:
    item = read(make("I", 20_000, 180, 0, 0, 0, 0, 1) * 30)[-1]
    assert isinstance(item, RawReading)
    assert item.angular_velocity_radps == pytest.approx((math.pi, 0, 0))
    assert item.acceleration_mps2 == pytest.approx((0, 0, 9.80665))
    assert item.device_time_ns == 20_000_000


def test_inertial_messages_are_passed_over_beside_quaternions() -> None:
    cycle = ximu3_binary("I", 1, 0, 0, 0, 0, 0, 1) * 4 + ximu3_binary("Q", 1, 1, 0, 0, 0)
    assert [type(item) for item in read(cycle * 20)] == [Reading] * 20


def test_euler_angles_are_used_when_no_quaternion_comes() -> None:
    item = read(ximu3_text("A", 1, 0, 0, 90) * 30)[-1]
    assert isinstance(item, Reading)
    assert item.world_from_sensor == pytest.approx(rotation.from_yaw(math.pi / 2))


@pytest.mark.parametrize(
    "message",
    [
        b'{"ping":{"interface":"USB"}}\r\n',
        b"^0{}\n",
        b"T,1000000,25.0\r\n",
        b"N,1000000,This is a notification.\r\n",
        b"L,1000000,0.0,0.0,0.0\r\n",
        ximu3_binary("M", 1, 1, 0, 0),
        b"\r\n",
    ],
)
def test_messages_with_other_content_are_passed_over(message: bytes) -> None:
    reader = Ximu3Framer()
    reader.feed(MANUAL["Q text"], 0)
    assert reader.feed(message, 0) == []
    assert reader.bad == 0


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (b"Q,1000000,nan,0,0,1\r\n", "not finite"),
        (b"Q,1000000,2,0,0,0\r\n", "norm 2"),
        (b"Q,-1,1,0,0,0\r\n", "time -1"),
        (b"Q,1000000,1,0,0\r\n", "4 values"),
        (b"Q,x,1,0,0,0\r\n", "'x'"),
        (b"\xff\xfe\n", "begins with"),
        (MANUAL["Q binary"][:-2] + b"\n", "23 bytes"),
        (MANUAL["Q binary"].replace(b"\x42\x0f", b"\xdb\x0f"), "escape"),
        (b"Q" * (LONGEST + 1), "no end"),
    ],
)
def test_unreadable_message_is_counted_with_its_reason(message: bytes, reason: str) -> None:
    reader = Ximu3Framer()
    reader.feed(MANUAL["Q text"], 0)
    assert reader.feed(message, 0) == []
    assert reader.bad == 1
    assert reason in reader.reason
    reader.feed(b"\n", 0)
    assert len(reader.feed(MANUAL["Q binary"], 0)) == 1


def test_times_whose_bytes_must_be_stuffed_come_back() -> None:
    for time_us in (0x0A, 0xDB, 0x0ADB0A, 0xDBDCDD0A, 0xDCDB, 0xDDDB):
        [item] = read(ximu3_binary("Q", time_us, 1, 0, 0, 0))
        assert isinstance(item, Reading)
        assert item.device_time_ns == time_us * 1000


def test_cue_lets_the_led_flash_in_its_color() -> None:
    framer = Ximu3Framer()
    begin, end = framer.cue(Feedback(stamp_ns=0, seq=1, cue="selected", color=(255, 0, 16)))
    assert (begin, end) == (b'{"colour":"FF0010"}\n', b'{"colour":null}\n')
    assert framer.cue(Feedback(stamp_ns=0, seq=1, cue="selected", haptic_ms=(40,)))[0] != b""
    assert framer.cue(Feedback(stamp_ns=0, seq=1, cue="target")) == (b"", b"")
