"""Where the arm must point: checked against the pointing model of the product."""

import math
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures, ImuSample, UserProfile
from pointit.services.pointing.eye_finger import EyeFinger
from pointit.services.user_sim.aim import Stance

coordinates = st.floats(-6.0, 6.0)
heights = st.floats(0.0, 3.0)


@given(
    st.tuples(coordinates, coordinates, heights),
    st.floats(0.0, 0.2),
    st.floats(-3.1, 3.1),
    st.sampled_from(["left", "right"]),
)
def test_the_ray_of_the_aimed_arm_meets_the_target(
    target: Vec3, shoulder_m: float, yaw_rad: float, hand: Literal["left", "right"]
) -> None:
    position = (1.0, -2.0, 0.0)
    body = BodyMeasures(neck_to_shoulder_m=shoulder_m)
    stance = Stance(body, hand, position, yaw_rad)
    if math.dist(stance.eyes_m, target) < 0.1:
        return
    azimuth_rad, elevation_rad = stance.aim_at(target)
    # what the wristband reads in {H}, and the ray the pointing service makes of it
    sample = ImuSample(
        stamp_ns=0, orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad - yaw_rad, elevation_rad)
    )
    ray = EyeFinger(UserProfile(stamp_ns=0, body=body, hand=hand)).ray(sample, 0)
    assert ray is not None
    sight = vector.turn(vector.subtract(target, stance.eyes_m), -yaw_rad)
    assert vector.angle_between(ray.direction, sight) < 1e-6


def test_a_short_arm_points_at_the_nearest_point_of_the_line() -> None:
    stance = Stance(BodyMeasures(shoulder_to_wrist_m=0.05, wrist_to_finger_m=0.05))
    # 10 cm cannot reach the level line 21 cm above the shoulder: the best it can do is straight up
    azimuth_rad, elevation_rad = stance.aim_at((5.0, 0.0, stance.eyes_m[2]))
    assert elevation_rad == pytest.approx(math.pi / 2)
    assert math.isfinite(azimuth_rad)


def test_the_eyes_themselves_are_no_crash() -> None:
    stance = Stance(BodyMeasures())
    assert stance.aim_at(stance.eyes_m) == (0.0, 0.0)
