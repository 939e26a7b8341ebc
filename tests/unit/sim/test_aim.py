"""Direction of the arm, checked against the pointing model of the product."""

import math
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures, ImuSample, UserProfile
from pointit.services.pointing.pointer import Pointer
from pointit.sim.aim import Stance

coordinates = st.floats(-6.0, 6.0)
heights = st.floats(0.0, 3.0)


@given(
    st.tuples(coordinates, coordinates, heights),
    st.floats(0.0, 0.2),
    st.floats(-3.1, 3.1),
    st.sampled_from(["left", "right"]),
)
def test_ray_of_the_aimed_arm_meets_the_target(
    target: Vec3, shoulder_m: float, yaw_rad: float, hand: Literal["left", "right"]
) -> None:
    position = (1.0, -2.0, 0.0)
    body = BodyMeasures(neck_to_shoulder_m=shoulder_m)
    stance = Stance(body, hand, position)
    if math.dist(stance.eyes_m, target) < 0.1:
        return
    level_m = math.hypot(target[0] - position[0], target[1] - position[1])
    rise_m = target[2] - stance.eyes_m[2]
    highest_m = stance.arm_m + math.copysign(body.neck_to_eyes_m, -rise_m)  # finger above or below the eyes
    if shoulder_m * abs(rise_m) > 0.98 * highest_m * level_m:
        return  # an arm beside the neck cannot be brought before what is straight above or below the eyes
    azimuth_rad, elevation_rad = stance.aim_at(target)
    # what the wristband reads in {H}, and the ray the pointing service makes of it
    sample = ImuSample(
        stamp_ns=0, orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad - yaw_rad, elevation_rad)
    )
    ray = Pointer(UserProfile(stamp_ns=0, body=body, hand=hand)).ray(sample, 0)
    assert ray is not None

    sight = vector.rotate_z(vector.subtract(target, stance.eyes_m), -yaw_rad)
    assert vector.angle_between(ray.direction, sight) < 1e-6


def test_short_arm_points_at_the_nearest_point_of_the_line() -> None:
    stance = Stance(BodyMeasures(shoulder_to_wrist_m=0.05, wrist_to_finger_m=0.05))
    # 10 cm cannot reach the level line 21 cm above the shoulder: the best it can do is straight up
    azimuth_rad, elevation_rad = stance.aim_at((5.0, 0.0, stance.eyes_m[2]))
    assert elevation_rad == pytest.approx(math.pi / 2)
    assert math.isfinite(azimuth_rad)


@pytest.mark.parametrize("beside_deg", [(10.0, 0.0), (0.0, 10.0), (-5.0, -8.0)])
def test_line_over_the_finger_deviates_by_the_given_error(beside_deg: tuple[float, float]) -> None:
    stance = Stance(BodyMeasures(neck_to_shoulder_m=0.15), "left", (1.0, 2.0, 0.0))
    target = (3.0, -1.0, 0.9)
    beside = (math.radians(beside_deg[0]), math.radians(beside_deg[1]))
    azimuth, elevation = stance.aim_at(target, beside)
    shoulder = stance.shoulder_m(azimuth)
    finger = vector.add(shoulder, vector.scale(vector.direction(azimuth, elevation), stance.arm_m))
    seen = stance.sight_of(finger)
    meant = stance.sight_of(target)
    assert (seen[0] - meant[0], seen[1] - meant[1]) == pytest.approx(beside)


def test_arm_that_is_the_ray_turns_to_the_target() -> None:
    stance = Stance(BodyMeasures(), position_m=(1.0, 0.0, 0.0), ray_model="shoulder_arm")
    azimuth, elevation = stance.aim_at((3.0, 0.0, 0.0), (0.0, 0.1))
    assert azimuth == pytest.approx(0.0)
    assert elevation == pytest.approx(math.atan2(-1.43, 2.0) + 0.1)
    bent = Stance(BodyMeasures(), position_m=(1.0, 0.0, 0.0), ray_model="forearm")
    assert bent.aim_at((3.0, 0.0, 0.0))[1] == pytest.approx(math.atan2(-1.43 + 0.56 * 0.55, 2.0))
