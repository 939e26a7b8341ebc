"""Mounting and yaw origin: where the arm points for a sensor that is worn in each documented way."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pointit.geometry import rotation, vector
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, ArmFrame, from_roll_pitch_yaw

angles = st.floats(-3.1, 3.1)
elevations = st.floats(-1.3, 1.3)

SENSOR_AXIS = {
    "plus_x": (1.0, 0.0, 0.0),
    "minus_x": (-1.0, 0.0, 0.0),
    "plus_y": (0.0, 1.0, 0.0),
    "minus_y": (0.0, -1.0, 0.0),
    "metamotion": (0.0, -1.0, 0.0),
    "myo": (-1.0, 0.0, 0.0),
    "watch_left": (1.0, 0.0, 0.0),  # 3 o'clock is towards the fingers
    "watch_right": (-1.0, 0.0, 0.0),  # 9 o'clock is
    "phone": (0.0, 1.0, 0.0),
}
"""The sensor's axis that points along the arm to the finger."""


@pytest.mark.parametrize("name", sorted(MOUNTINGS))
@given(azimuth=angles, elevation=elevations, roll=angles)
def test_the_arm_points_where_the_sensors_axis_does(
    name: str, azimuth: float, elevation: float, roll: float
) -> None:
    sensor = rotation.from_azimuth_elevation(azimuth, elevation, roll)
    arm = ArmFrame(MOUNTINGS[name]).orientation(sensor)
    finger = rotation.rotate(arm, (1.0, 0.0, 0.0))
    assert vector.angle_between(finger, rotation.rotate(sensor, SENSOR_AXIS[name])) < 1e-7


def test_metamotion_is_the_sensor_turned_by_minus_90_degrees_about_z() -> None:
    sensor = rotation.from_azimuth_elevation(0.4, 0.2, 0.1)
    expected = rotation.multiply(sensor, rotation.from_yaw(-math.pi / 2))
    assert ArmFrame(MOUNTINGS["metamotion"]).orientation(sensor) == pytest.approx(expected)


@pytest.mark.parametrize("name", sorted(MOUNTINGS))
def test_what_is_up_on_the_sensor_is_up_on_the_arm(name: str) -> None:
    assert rotation.rotate(MOUNTINGS[name], (0.0, 0.0, 1.0)) == pytest.approx((0.0, 0.0, 1.0))


@given(roll=angles, pitch=elevations, yaw=angles)
def test_roll_pitch_yaw_turn_about_the_fixed_axes_in_that_order(
    roll: float, pitch: float, yaw: float
) -> None:
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw])
    ours = Rotation.from_quat(from_roll_pitch_yaw(roll, pitch, yaw))
    assert (ours.inv() * expected).magnitude() < 1e-7


@given(azimuth=angles, origin=angles)
def test_the_yaw_origin_counts_as_zero(azimuth: float, origin: float) -> None:
    arm = ArmFrame(rotation.IDENTITY, origin).orientation(rotation.from_azimuth_elevation(azimuth, 0.3))
    finger = rotation.rotate(arm, (1.0, 0.0, 0.0))
    assert math.isclose(vector.wrap(vector.azimuth(finger) - (azimuth - origin)), 0.0, abs_tol=1e-9)
    assert math.isclose(vector.elevation(finger), 0.3)


@pytest.mark.parametrize("name", sorted(MOUNTINGS))
@given(azimuth=angles, elevation=elevations, roll=angles, wanted=angles)
def test_turning_makes_the_arm_read_the_wanted_yaw_and_keeps_its_elevation(
    name: str, azimuth: float, elevation: float, roll: float, wanted: float
) -> None:
    frame = ArmFrame(MOUNTINGS[name], 1.0)
    arm = rotation.from_azimuth_elevation(azimuth, elevation, roll)
    sensor = rotation.multiply(arm, rotation.inverse(MOUNTINGS[name]))
    frame.set_azimuth(wanted, sensor)
    finger = rotation.rotate(frame.orientation(sensor), (1.0, 0.0, 0.0))
    assert math.isclose(vector.wrap(vector.azimuth(finger) - wanted), 0.0, abs_tol=1e-6)
    assert math.isclose(vector.elevation(finger), elevation, abs_tol=1e-7)


def test_a_steep_arm_has_no_yaw() -> None:
    with pytest.raises(ValueError, match="hold it level"):
        ArmFrame(rotation.IDENTITY).set_azimuth(0.0, rotation.from_azimuth_elevation(0.0, 1.5))
