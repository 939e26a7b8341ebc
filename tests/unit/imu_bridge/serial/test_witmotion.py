"""WitMotion's protocol: published bytes, fallbacks, and the commands that switch quaternions on."""

import math
from importlib import import_module
from typing import Any

import pytest

from pointit.geometry import rotation
from pointit.services.imu_bridge.arm_frame import from_roll_pitch_yaw
from pointit.services.imu_bridge.reading import RawReading, Reading
from pointit.services.imu_bridge.serial import witmotion
from pointit.services.imu_bridge.serial.witmotion import WitMotionFramer
from pointit_lab.devices.serial_formats import witmotion_packet, witmotion_quaternion

GOLDEN = bytes.fromhex("55 59 82 5a 00 00 00 00 82 5a 66")
"""w = z = 0.7071, checked against the vendor's decoder."""
protocol: Any = import_module("witmotion.protocol")
"""A decoder that is not ours, without types."""
ACCELERATION, RATE, ANGLES = 0x51, 0x52, 0x53


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


def test_angles_turn_about_z_then_y_then_x() -> None:
    packet = witmotion_packet(ANGLES, 5461, -3641, 10923, 0)  # 30°, -20°, 60°
    reader = framer()
    item = [item for _ in range(20) for item in reader.feed(packet, 0)][-1]
    assert isinstance(item, Reading)
    x, y, z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    turn = rotation.multiply(
        rotation.from_axis_angle(z, math.radians(60)),
        rotation.multiply(
            rotation.from_axis_angle(y, math.radians(-20)), rotation.from_axis_angle(x, math.radians(30))
        ),
    )
    assert item.world_from_sensor == pytest.approx(turn, abs=1e-3)


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


def test_rate_and_acceleration_are_used_when_nothing_else_comes() -> None:
    cycle = witmotion_packet(ACCELERATION, 0, 0, 2048, 0) + witmotion_packet(RATE, 16384, 0, -1, 0)
    item = framer().feed(cycle * 20, 7)[-1]
    assert isinstance(item, RawReading)
    assert item.acceleration_mps2 == pytest.approx((0, 0, 9.80665))
    assert item.angular_velocity_radps == pytest.approx((math.radians(1000), 0, -math.radians(2000) / 32768))


def test_quaternion_of_a_wrong_norm_is_no_reading() -> None:
    reader = framer()
    assert reader.feed(witmotion_packet(0x59, 0, 0, 0, 0), 0) == []
    assert reader.feed(witmotion_packet(0x59, 16384, 0, 0, 0), 0) == []
    assert len(reader.feed(GOLDEN, 0)) == 1


def commands(reader: WitMotionFramer) -> list[str]:
    sent = [command.hex(" ") for command in reader.commands]
    reader.commands.clear()
    return sent


@pytest.mark.parametrize(("baud", "rate"), [(115200, "ff aa 03 09 00"), (9600, "ff aa 03 08 00")])
def test_device_is_switched_to_quaternions_and_then_to_a_higher_rate(baud: int, rate: str) -> None:
    reader = framer(configure=True, baud=baud)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 20, 0)
    assert commands(reader) == ["ff aa 69 88 b5", "ff aa 24 01 00", "ff aa 02 08 02"]
    reader.feed(GOLDEN, 0)
    assert commands(reader) == ["ff aa 69 88 b5", "ff aa 02 00 02", rate]
    assert "quaternions" in reader.told
    reader.feed(GOLDEN * 50 + witmotion_packet(ANGLES, 0, 0, 0, 0) * 200, 0)
    assert commands(reader) == []


def test_device_without_quaternions_gives_its_angles_at_a_higher_rate() -> None:
    reader = framer(configure=True)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 20, 0)
    commands(reader)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 100, 0)
    assert commands(reader) == ["ff aa 69 88 b5", "ff aa 02 08 00", "ff aa 03 09 00"]


def test_device_that_sends_quaternions_is_left_alone() -> None:
    reader = framer(configure=True)
    reader.feed((GOLDEN + witmotion_packet(ANGLES, 0, 0, 0, 0)) * 200, 0)
    assert commands(reader) == []


def test_device_is_left_alone_when_that_is_configured() -> None:
    reader = framer(configure=False)
    reader.feed(witmotion_packet(ANGLES, 0, 0, 0, 0) * 200, 0)
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
