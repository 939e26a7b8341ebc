"""The mouse's arm: the pointing service's ray of it meets the place, and it moves as wrists can."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pointit.bridges.web.wrists.mouse_arm import FASTEST_RADPS, MouseArm
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, BodyMeasures, UserProfile
from pointit.services.pointing.arm_ray import ArmRay

STEP_NS = NS_PER_S // 60

bodies = st.builds(
    BodyMeasures,
    footprint_to_neck_m=st.floats(0.8, 1.8),
    neck_to_eyes_m=st.floats(0.05, 0.3),
    neck_to_shoulder_m=st.floats(0.0, 0.3),
    shoulder_to_wrist_m=st.floats(0.45, 0.8),
    wrist_to_finger_m=st.floats(0.0, 0.3),
)
coordinates = st.floats(-20.0, 20.0)
angles = st.floats(-math.pi, math.pi)


def angle_between(a: Quaternion, b: Quaternion) -> float:
    x, y, z, w = rotation.multiply(rotation.inverse(a), b)
    return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))


def seen_from(profile: UserProfile, arm: Quaternion, feet_m: Vec3, yaw_rad: float) -> tuple[Vec3, Vec3]:
    """Return where in {W} the pointing service has the ray start, and where it goes."""
    ray = ArmRay.from_profile(profile).ray(arm)
    assert ray is not None
    return vector.add(feet_m, vector.rotate_z(ray[0], yaw_rad)), vector.rotate_z(ray[1], yaw_rad)


profiles = st.builds(
    UserProfile,
    stamp_ns=st.just(0),
    body=bodies,
    hand=st.sampled_from(["left", "right"]),
    ray_model=st.sampled_from(["eye_finger", "shoulder_arm", "forearm"]),
)


@given(
    profiles,
    st.tuples(coordinates, coordinates, st.floats(-1.0, 1.0)),
    angles,
    st.tuples(coordinates, coordinates, st.floats(-1.0, 5.0)),
)
def test_the_ray_of_the_arm_meets_the_place(
    profile: UserProfile, feet_m: Vec3, yaw_rad: float, at_m: Vec3
) -> None:
    body = profile.body
    # an arm shorter than the way from the eyes to the shoulder reaches not every line of sight, nor one that
    # stays beside the neck a line that goes straight up or down
    assume(body.shoulder_to_wrist_m > 1.01 * math.hypot(body.neck_to_eyes_m, body.neck_to_shoulder_m))
    level_m = math.hypot(at_m[0] - feet_m[0], at_m[1] - feet_m[1])
    rise_m = at_m[2] - feet_m[2] - body.footprint_to_neck_m - body.neck_to_eyes_m
    arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
    highest_m = arm_m + math.copysign(body.neck_to_eyes_m, -rise_m)  # finger above or below the eyes
    assume(body.neck_to_shoulder_m * abs(rise_m) <= 0.98 * highest_m * level_m)
    assume(level_m > 1.05 * body.neck_to_shoulder_m)
    arm = MouseArm()
    arm.set_profile(profile)
    arm.set_pose(feet_m, yaw_rad)
    arm.aim(at_m)
    start_m, direction = seen_from(profile, arm.step(0), feet_m, yaw_rad)
    sight = vector.subtract(at_m, start_m)
    assume(vector.norm(sight) > 0.05)
    assert vector.angle_between(direction, sight) < 1e-6


def test_it_points_ahead_before_it_is_told_where() -> None:
    arm = rotation.rotate(MouseArm().step(0), (1.0, 0.0, 0.0))
    assert vector.azimuth(arm) == pytest.approx(0.0)
    assert -0.5 < vector.elevation(arm) < 0.0


@given(st.lists(st.tuples(coordinates, coordinates, st.floats(0.0, 3.0)), min_size=2, max_size=12))
def test_it_never_turns_faster_than_a_wrist(places: list[Vec3]) -> None:
    arm = MouseArm()
    arm.set_pose((0.3, 0.2, 0.0), 0.7)
    before, now_ns = arm.step(0), 0
    for place in places:
        arm.aim(place)
        for _ in range(3):
            now_ns += STEP_NS
            after = arm.step(now_ns)
            assert angle_between(before, after) <= FASTEST_RADPS * STEP_NS / NS_PER_S + 1e-6
            before = after


def test_it_arrives_where_the_mouse_jumped_to_within_half_a_second() -> None:
    arm, now_ns = MouseArm(), 0
    arm.aim((3.0, 0.0, 1.0))
    arm.step(now_ns)
    arm.aim((-3.0, 0.5, 1.0))
    steps = [arm.step(now_ns := now_ns + STEP_NS) for _ in range(30)]
    assert angle_between(steps[0], steps[-1]) > 2.0
    assert steps[-1] == steps[-2]


def test_it_goes_the_shorter_way_round() -> None:
    arm = MouseArm()
    arm.aim((-3.0, 0.5, 1.0))
    arm.step(0)
    arm.aim((-3.0, -0.5, 1.0))  # 19° further, across the azimuth where angles begin again
    steps = [arm.step(k * STEP_NS) for k in range(1, 5)]
    assert steps[1] == steps[3]


def test_a_pose_found_anew_turns_the_arm_in_the_persons_frame_only() -> None:
    arm = MouseArm()
    arm.aim((3.0, 0.0, 1.0))
    arm.set_pose((0.0, 0.0, 0.0), 0.5)
    assert arm.azimuth((3.0, 0.0, 1.0)) == pytest.approx(-0.5)
    ahead = rotation.rotate(arm.step(0), (1.0, 0.0, 0.0))
    assert vector.azimuth(ahead) == pytest.approx(-0.5)


def test_tremor_has_the_asked_size_and_comes_again_with_its_seed() -> None:
    def angles_of(seed: int) -> list[float]:
        arm = MouseArm(seed=seed)
        arm.aim((3.0, 0.0, 1.6))
        still = arm.step(0)
        arm.set_tremor(math.radians(0.5))
        return [angle_between(still, arm.step(k * STEP_NS)) for k in range(1, 1200)]

    first = angles_of(1)
    rms_deg = math.degrees(math.sqrt(sum(a * a for a in first) / len(first)))
    assert rms_deg == pytest.approx(0.5 * math.sqrt(2.0), rel=0.1)  # about two axes
    assert first == angles_of(1)
    assert first != angles_of(2)


def test_without_tremor_a_held_arm_is_still() -> None:
    arm = MouseArm()
    arm.aim((3.0, 1.0, 1.0))
    assert arm.step(0) == arm.step(STEP_NS) == arm.step(5 * NS_PER_S)
