"""UART-RVC of a BNO085: the data sheet's example, and the axes of pitch and roll."""

import math

import pytest

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.reading import Reading
from pointit.services.imu_bridge.serial.bno085 import Bno085Framer
from pointit_lab.devices.serial_formats import bno085_orientation, bno085_packet

DATA_SHEET = bytes.fromhex("AA AA DE 01 00 92 FF 25 08 8D FE EC FF D1 03 00 00 00 E7")
"""Index 222, yaw 0.01°, pitch -1.10°, roll 20.85°, acceleration -371, -20, 977 mg."""
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


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


def test_words_of_the_data_sheet_hold_when_the_acceleration_agrees_with_them() -> None:
    yaw, pitch, roll = math.radians(40), math.radians(-25), math.radians(50)
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
