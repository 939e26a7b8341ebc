"""Formats of a BNO085, an x-IMU3 and WitMotion: published bytes, axes, commands."""

import math
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion, from_roll_pitch_yaw
from pointit.schemas import Feedback
from pointit.services.imu_bridge.serial import witmotion
from pointit.services.imu_bridge.serial.bno085 import Bno085Framer
from pointit.services.imu_bridge.serial.witmotion import WitMotionFramer
from pointit.services.imu_bridge.serial.ximu3 import LONGEST, Ximu3Framer
from pointit.services.imu_bridge.sources import Battery, Item, Press, RawReading, Reading, Signal
from pointit_lab.devices.serial_formats import (
    bno085_orientation,
    bno085_packet,
    witmotion_packet,
    witmotion_quaternion,
    ximu3_binary,
    ximu3_text,
)

DATA_SHEET = bytes.fromhex("AA AA DE 01 00 92 FF 25 08 8D FE EC FF D1 03 00 00 00 E7")
"""Index 222, yaw 0.01°, pitch -1.10°, roll 20.85°, acceleration -371, -20, 977 mg."""
X = (1.0, 0.0, 0.0)
Y = (0.0, 1.0, 0.0)
Z = (0.0, 0.0, 1.0)


def orientation(data: bytes, reader: Bno085Framer | None = None) -> Quaternion:
    item = (reader or Bno085Framer()).feed(data, 0)[-1]
    assert isinstance(item, Reading)
    return item.world_from_sensor


def test_encoder_of_the_tests_gives_the_data_sheets_bytes() -> None:
    assert bno085_packet(222, 1, -110, 2085, (-371, -20, 977)) == DATA_SHEET


def test_data_sheets_example_agrees_with_its_own_acceleration() -> None:
    found = orientation(DATA_SHEET)
    up = rotation.rotate(rotation.inverse(found), Z)
    assert up == pytest.approx((-0.355, -0.02, 0.935), abs=0.02)  # acceleration: -0.355, -0.019, 0.935


def test_axes_are_those_of_the_data_sheet_when_acceleration_agrees() -> None:
    yaw = math.radians(40)
    pitch = math.radians(-25)
    roll = math.radians(50)
    wanted = rotation.multiply(
        rotation.from_axis_angle(Z, yaw),
        rotation.multiply(rotation.from_axis_angle(Y, pitch), rotation.from_axis_angle(X, roll)),
    )
    up = rotation.rotate(rotation.inverse(wanted), Z)
    mg = (round(1000 * up[0]), round(1000 * up[1]), round(1000 * up[2]))
    assert orientation(bno085_packet(0, 4000, -2500, 5000, mg)) == pytest.approx(wanted, abs=1e-3)


def test_axes_do_not_change_during_a_fast_motion() -> None:
    reader = Bno085Framer()
    posture = rotation.from_azimuth_elevation(0.7, -0.3, 0.5)
    orientation(bno085_orientation(posture) * 50, reader)
    shaken = bno085_packet(0, 0, 0, 3000, (-3000, 2000, 1000)) * 20
    orientation(shaken, reader)
    found = orientation(bno085_orientation(posture), reader)
    assert abs(sum(a * b for a, b in zip(found, posture, strict=True))) == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("azimuth", [-3.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("elevation", [-1.4, -0.5, 0.0, 0.8, 1.5])
def test_every_direction_of_the_arm_comes_back(azimuth: float, elevation: float) -> None:
    posture = rotation.from_azimuth_elevation(azimuth, elevation, 0.4)
    found = orientation(bno085_orientation(posture) * 3)
    assert abs(sum(a * b for a, b in zip(found, posture, strict=True))) == pytest.approx(1, abs=1e-4)


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


def test_led_flashes_only_for_cues_with_a_signal() -> None:
    framer = Ximu3Framer()
    assert framer.cue(Feedback(stamp_ns=0, seq=1, cue="selected", haptic_ms=(40,)))[0] != b""
    assert framer.cue(Feedback(stamp_ns=0, seq=1, cue="target")) == (b"", b"")


GOLDEN = bytes.fromhex("55 59 82 5a 00 00 00 00 82 5a 66")
"""w = z = 0.7071, checked against the vendor's decoder."""
protocol: Any = import_module("witmotion.protocol")
"""A decoder that is not ours, without types."""
ACCELERATION = 0x51
RATE = 0x52
ANGLES = 0x53


def framer(*, configure: bool = False, baud: int = 115200) -> WitMotionFramer:
    return WitMotionFramer(configure=configure, baud=baud)


def test_published_packet_of_a_quaternion_is_read() -> None:
    [item] = framer().feed(GOLDEN, 5)
    assert isinstance(item, Reading)
    assert item.stamp_ns == 5
    assert item.world_from_sensor == pytest.approx(rotation.from_yaw(math.radians(90)), abs=1e-4)
    assert item.device_time_ns is None


def test_encoder_of_the_tests_gives_the_published_bytes() -> None:
    assert witmotion_quaternion((0.0, 0.0, 0.7071, 0.7071)) == GOLDEN


def test_angles_are_used_when_no_quaternion_comes() -> None:
    packet = witmotion_packet(ANGLES, 0, 0, 16384, 0)  # yaw 90°
    reader = framer()
    items = [item for _ in range(30) for item in reader.feed(packet, 0)]
    assert 10 < len(items) < 20
    assert isinstance(items[0], Reading)
    assert items[0].world_from_sensor == pytest.approx(rotation.from_yaw(math.radians(90)))


def test_quaternions_are_preferred_over_angles_and_raw_values() -> None:
    cycle = (
        witmotion_packet(ACCELERATION, 0, 0, 2048, 0)
        + witmotion_packet(RATE, 0, 0, 0, 0)
        + witmotion_packet(ANGLES, 0, 0, 0, 0)
        + GOLDEN
    )
    items = framer().feed(cycle * 50, 0)
    assert len(items) == 50
    assert all(isinstance(item, Reading) and item.world_from_sensor[2] > 0.7 for item in items)


def commands(reader: WitMotionFramer) -> list[str]:
    sent = [command.hex(" ") for command in reader.commands]
    reader.commands.clear()
    return sent


@pytest.mark.parametrize(("baud", "rate"), [(115200, "ff aa 03 09 00"), (9600, "ff aa 03 08 00")])
def test_device_is_switched_to_quaternions_before_a_higher_rate(baud: int, rate: str) -> None:
    reader = framer(configure=True, baud=baud)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 20, 0)
    assert commands(reader) == ["ff aa 69 88 b5", "ff aa 24 01 00", "ff aa 02 08 02"]
    reader.feed(GOLDEN, 0)
    assert commands(reader) == ["ff aa 69 88 b5", "ff aa 02 00 02", rate]
    assert "quaternions" in reader.notice
    reader.feed(GOLDEN * 50 + witmotion_packet(ANGLES, 0, 0, 0, 0) * 200, 0)
    assert commands(reader) == []


def test_device_without_quaternions_gives_its_angles_at_a_higher_rate() -> None:
    reader = framer(configure=True)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 20, 0)
    commands(reader)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 100, 0)
    assert commands(reader) == ["ff aa 69 88 b5", "ff aa 02 08 00", "ff aa 03 09 00"]


@pytest.mark.parametrize(
    ("configure", "stream"),
    [(True, GOLDEN + witmotion_packet(ANGLES, 0, 0, 0, 0)), (False, witmotion_packet(ANGLES, 0, 0, 0, 0))],
    ids=["it sends quaternions", "it is configured so"],
)
def test_device_is_left_alone(*, configure: bool, stream: bytes) -> None:
    reader = framer(configure=configure)
    reader.feed(stream * 200, 0)
    assert commands(reader) == []


def test_independent_decoder_reads_the_packets_of_the_tests() -> None:
    posture = rotation.from_azimuth_elevation(0.7, -0.3)
    packet = witmotion_quaternion(posture)
    assert protocol.QuaternionMessage.compute_checksum(packet[2:10]) == packet[10]
    w, x, y, z = protocol.QuaternionMessage.parse(packet[2:10]).q
    assert (x, y, z, w) == pytest.approx(posture, abs=1e-4)
    [item] = framer().feed(packet, 0)
    assert isinstance(item, Reading)
    assert item.world_from_sensor == pytest.approx((x, y, z, w), abs=1e-4)


def test_independent_decoder_reads_the_same_rates_and_angles() -> None:
    values = (2048, -16384, 8192, 2500)
    reader = framer()
    stream = witmotion_packet(ACCELERATION, *values) + witmotion_packet(RATE, *values)
    item = reader.feed(stream * 20, 0)[-1]
    assert isinstance(item, RawReading)
    body = witmotion_packet(RATE, *values)[2:10]
    rates_degps = protocol.AngularVelocityMessage.parse(body).w

    assert [math.degrees(value) for value in item.angular_velocity_radps] == pytest.approx(rates_degps)
    accelerations = protocol.AccelerationMessage.parse(body).a  # it takes g as 9.8 m/s²
    assert item.acceleration_mps2 == pytest.approx(accelerations, rel=1e-3)

    angles = protocol.AngleMessage.parse(body)
    item = framer().feed(witmotion_packet(ANGLES, *values) * 20, 0)[-1]
    assert isinstance(item, Reading)
    turn = from_roll_pitch_yaw(*(math.radians(each) for each in (angles.roll, angles.pitch, angles.yaw)))
    assert item.world_from_sensor == pytest.approx(turn)


def test_independent_encoder_writes_the_same_commands() -> None:
    register = protocol.Register
    quaternions = 1 << protocol.QuaternionMessage.code - 0x50
    angles = 1 << protocol.AngleMessage.code - 0x50
    for command, number, value in (
        (witmotion.SIX_AXES, register.alg, 1),
        (witmotion.SEND_BOTH, register.rsw, quaternions | angles),
        (witmotion.SEND_QUATERNIONS, register.rsw, quaternions),
        (witmotion.SEND_ANGLES, register.rsw, angles),
        (witmotion.RATE_100_HZ, register.rate, protocol.ReturnRateSelect.rate_100hz.value),
        (witmotion.RATE_50_HZ, register.rate, protocol.ReturnRateSelect.rate_50hz.value),
    ):
        assert protocol.ConfigCommand(number, value).serialize() == command
