"""Mountings of the sensor, measured by two poses of the arm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion, from_roll_pitch_yaw
from pointit.services.imu_bridge.fitted_mounting import (
    FittedMounting,
    MountingError,
    MountingHold,
    RestPoseCollector,
    mean_pose,
    solve_mounting,
)
from tests.support import there

angles = st.floats(-3.1, 3.1)
slight = st.floats(-0.1, 0.1)


def held(
    azimuth: float, elevation: float, worn: Quaternion, *, noise_deg: float = 0.0, roll: float = 0.0
) -> MountingHold:
    """Return the readings of an arm in that pose, with the sensor worn so that arm_from_true is `worn`."""
    arm = rotation.from_azimuth_elevation(azimuth, elevation, roll)
    read = Rotation.from_quat(rotation.multiply(arm, rotation.inverse(worn)))
    random = np.random.default_rng(1)
    errors = Rotation.from_rotvec(random.normal(0.0, math.radians(noise_deg), (100, 3)))
    return mean_pose((read * errors).as_quat())


def assert_same(a: Quaternion, b: Quaternion, tolerance_deg: float = 1e-3) -> None:
    angle_rad = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()
    assert math.degrees(float(angle_rad)) < tolerance_deg


@given(roll=angles, pitch=st.floats(-1.5, 1.5), yaw=angles, azimuth=angles, drift=angles, twist=angles)
def test_mounting_is_recovered_for_any_heading_and_arm_twist(
    *, roll: float, pitch: float, yaw: float, azimuth: float, drift: float, twist: float
) -> None:
    worn = from_roll_pitch_yaw(roll, pitch, yaw)
    raised = held(azimuth + drift, math.pi / 2, worn, roll=twist)
    found = solve_mounting(held(azimuth, 0.0, worn), raised)
    assert_same(found.arm_from_true, worn)
    assert abs(found.forward_after_rad) < 1e-6
    assert abs(found.up_after_rad) < 1e-3  # near the zenith an elevation is known to the root of a rounding


@given(low=slight, high=slight)
def test_mounting_error_is_at_most_the_mean_pose_error(low: float, high: float) -> None:
    worn = from_roll_pitch_yaw(1.0, 0.4, 2.0)
    found = solve_mounting(held(0.5, low, worn), held(0.5, math.pi / 2 + high, worn))
    arm = rotation.rotate(found.arm_from_true, (1.0, 0.0, 0.0))
    wanted = rotation.rotate(worn, (1.0, 0.0, 0.0))
    assert vector.angle_between(arm, wanted) <= (abs(low) + abs(high)) / 2 + 1e-7


def test_mean_pose_ignores_the_signs_of_quaternions() -> None:
    found = mean_pose(np.array([[0.0, 0.0, 0.1, 1.0], [0.0, 0.0, 0.1, -1.0], [0.0, 0.0, -0.1, -1.0]]))
    assert_same(found.mean_xyzw, (0.0, 0.0, math.sin(0.0332), math.cos(0.0332)), 0.1)


def solved(worn: Quaternion) -> FittedMounting:
    return solve_mounting(held(0.2, 0.0, worn), held(0.2, math.pi / 2, worn))


def test_mounting_reports_errors_before_and_after() -> None:
    # turned clockwise seen from the elbow: what was the sensor's left is up now
    turned = solved(rotation.from_axis_angle((1.0, 0.0, 0.0), -math.radians(92)))
    assert math.degrees(turned.about_arm_rad) == pytest.approx(92.0)
    assert turned.off_axis_rad == pytest.approx(0.0, abs=1e-6)
    assert turned.forward_before_rad == pytest.approx(0.0, abs=1e-6)
    # what was taken for the arm points 10° below it
    low = solved(rotation.from_axis_angle((0.0, 1.0, 0.0), -math.radians(10)))
    assert math.degrees(low.off_axis_rad) == pytest.approx(10.0)
    assert math.degrees(low.forward_before_rad) == pytest.approx(-10.0)
    assert math.degrees(low.up_before_rad) == pytest.approx(-10.0)
    assert (low.forward_after_rad, low.up_after_rad) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert low.heading_change_rad == pytest.approx(0.0, abs=1e-6)
    aside = solved(rotation.from_yaw(math.radians(90)))
    assert math.degrees(aside.heading_change_rad) == pytest.approx(90.0)


UP = math.pi / 2


@pytest.mark.parametrize(
    ("forward", "up", "words"),
    [
        ((0.0, 3.5), (UP, 0.0), "did not rest while it was ahead"),
        ((0.0, 0.0), (UP, 3.5), "did not rest while it was up"),
        ((0.0, 0.0), (0.3, 0.0), "poses are the same: between them the arm turned by 17°"),
        ((-0.6, 0.0), (UP, 0.0), "34° from level"),
        ((0.0, 0.0), (UP - 0.6, 0.0), "34° from level"),
    ],
)
def test_mounting_is_refused_when_the_poses_do_not_determine_it(
    forward: tuple[float, float], up: tuple[float, float], words: str
) -> None:
    worn = from_roll_pitch_yaw(0.4, 0.1, 0.2)
    with pytest.raises(MountingError, match=words):
        solve_mounting(
            held(0.0, forward[0], worn, noise_deg=forward[1]), held(0.0, up[0], worn, noise_deg=up[1])
        )


def test_rest_begins_at_the_last_movement() -> None:
    stillness = RestPoseCollector(1.0)
    at = rotation.from_yaw
    for step in range(9):
        assert stillness.add(at(0.001 * step), 0.1 * step) is None
    assert stillness.rested_s == pytest.approx(0.8)
    assert stillness.add(at(0.5), 0.9) is None
    assert stillness.rested_s == 0.0
    assert stillness.moved_rad == pytest.approx(0.5)
    for step in range(1, 10):
        assert stillness.add(at(0.5), 0.9 + 0.1 * step) is None
    found = there(stillness.add(at(0.5), 2.0))
    assert_same(found.mean_xyzw, at(0.5))
    assert found.samples == 11
