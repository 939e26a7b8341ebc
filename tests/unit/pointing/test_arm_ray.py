"""The three rays by hand, by property, many at once; their correction, bounded and continuous."""

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.schemas import BodyMeasures, PointingOffset, UserProfile
from pointit.services.pointing.pointer import FADE_RAD, MAX_CORRECTION_RAD, ArmRay, RayModel, apply
from tests.support.known import known

angles = st.floats(-math.pi, math.pi)
elevations = st.floats(-1.5, 1.5)
hands: st.SearchStrategy[Literal["left", "right"]] = st.sampled_from(["left", "right"])
models: st.SearchStrategy[RayModel] = st.sampled_from(["eye_finger", "shoulder_arm", "forearm"])
bodies = st.builds(
    BodyMeasures, footprint_to_neck_m=st.floats(0.8, 1.8), neck_to_eyes_m=st.floats(0.1, 0.3),
    neck_to_shoulder_m=st.floats(0.0, 0.25), shoulder_to_wrist_m=st.floats(0.4, 0.7),
    wrist_to_finger_m=st.floats(0.1, 0.25),
)  # fmt: skip


def rayed(ray: ArmRay, azimuth_rad: float, elevation_rad: float) -> tuple[vector.Vec3, vector.Vec3]:
    return known(ray.ray(rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)))


def direction(ray: ArmRay, azimuth_rad: float, elevation_rad: float, roll_rad: float = 0.0) -> vector.Vec3:
    found = known(ray.ray(rotation.from_azimuth_elevation(azimuth_rad, elevation_rad, roll_rad)))
    return found[1]


def test_a_level_arm_points_down_from_the_eyes_over_the_finger() -> None:
    ray = ArmRay()
    assert rayed(ray, 0.0, 0.0)[0] == (0.0, 0.0, 1.43 + 0.21)
    # the finger is 0.73 m ahead and 0.21 m below the eyes
    assert vector.elevation(direction(ray, 0.0, 0.0)) == pytest.approx(math.atan2(-0.21, 0.73))
    assert vector.azimuth(direction(ray, 0.0, 0.0)) == pytest.approx(0.0)


@given(bodies, hands, angles, elevations, angles)
def test_the_eye_finger_ray_goes_through_the_fingertip(
    body: BodyMeasures,
    hand: Literal["left", "right"],
    azimuth_rad: float,
    elevation_rad: float,
    roll_rad: float,
) -> None:
    ray = ArmRay(body, hand=hand)
    side = body.neck_to_shoulder_m if hand == "left" else -body.neck_to_shoulder_m
    arm = vector.scale(
        vector.direction(azimuth_rad, elevation_rad), body.shoulder_to_wrist_m + body.wrist_to_finger_m
    )
    shoulder = vector.rotate_z((0.0, side, body.footprint_to_neck_m), azimuth_rad)
    eyes = (0.0, 0.0, body.footprint_to_neck_m + body.neck_to_eyes_m)
    reach = vector.subtract(vector.add(shoulder, arm), eyes)
    assert vector.angle_between(reach, direction(ray, azimuth_rad, elevation_rad, roll_rad)) < 1e-7


@given(st.builds(ArmRay, bodies, hand=hands, model=models), angles, elevations, angles)
def test_turning_the_person_or_the_yaw_origin_turns_the_ray(
    ray: ArmRay, azimuth_rad: float, elevation_rad: float, yaw_rad: float
) -> None:
    origin, along = rayed(ray, azimuth_rad, elevation_rad)
    turned_origin, turned_along = rayed(ray, azimuth_rad + yaw_rad, elevation_rad)
    assert turned_origin == pytest.approx(vector.rotate_z(origin, yaw_rad), abs=1e-6)
    assert vector.angle_between(vector.rotate_z(along, yaw_rad), turned_along) < 1e-6


def test_the_left_shoulder_is_on_the_left() -> None:
    body = BodyMeasures(neck_to_shoulder_m=0.2)
    left, right = ArmRay(body, hand="left"), ArmRay(body, hand="right")
    assert direction(left, 0.0, 0.0)[1] > 0.0 > direction(right, 0.0, 0.0)[1]
    left, right = (ArmRay(body, hand=hand, model="shoulder_arm") for hand in ("left", "right"))
    assert (rayed(left, 0.0, 0.0)[0], rayed(right, 0.0, 0.0)[0]) == ((0.0, 0.2, 1.43), (0.0, -0.2, 1.43))
    assert rayed(right, math.pi / 2, 0.3)[0] == pytest.approx((0.2, 0.0, 1.43))


@given(angles, elevations, st.sampled_from(["shoulder_arm", "forearm"]))
def test_arm_rays_go_along_the_arm(azimuth_rad: float, elevation_rad: float, model: RayModel) -> None:
    ray = ArmRay(model=model)
    along = vector.direction(azimuth_rad, elevation_rad)
    assert vector.angle_between(direction(ray, azimuth_rad, elevation_rad), along) < 1e-7


def test_the_forearm_starts_at_the_elbow_of_a_hanging_upper_arm() -> None:
    ray = ArmRay(BodyMeasures(neck_to_shoulder_m=0.2), model="forearm")
    assert rayed(ray, 0.0, 0.0)[0] == pytest.approx((0.0, -0.2, 1.43 - 0.56 * 0.55))


def test_profile_selects_ray_model_and_hand() -> None:
    body = BodyMeasures(neck_to_shoulder_m=0.2)
    profile = UserProfile(stamp_ns=0, body=body, hand="left", ray_model="shoulder_arm")
    assert rayed(ArmRay.from_profile(profile), 0.0, 0.0)[0] == (0.0, 0.2, 1.43)


@given(bodies, hands, models, st.lists(st.tuples(angles, elevations, angles), min_size=1, max_size=20))
def test_many_at_once_are_the_same_as_one_by_one(
    body: BodyMeasures,
    hand: Literal["left", "right"],
    model: RayModel,
    arms: list[tuple[float, float, float]],
) -> None:
    ray = ArmRay(body, hand=hand, model=model)
    orientations = [rotation.from_azimuth_elevation(*arm) for arm in arms]
    origins, directions = ray.rays(np.array(orientations))
    singly = [ray.ray(orientation) for orientation in orientations]
    assert np.allclose(origins, [one[0] for one in singly if one], atol=1e-12)
    assert np.allclose(directions, [one[1] for one in singly if one], atol=1e-12)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)


def test_a_finger_at_the_eyes_has_no_direction() -> None:
    ray = ArmRay(BodyMeasures(neck_to_eyes_m=0.73))
    up = rotation.from_azimuth_elevation(0.3, math.pi / 2)
    assert ray.ray(up) is None
    _, directions = ray.rays(np.array([up, rotation.IDENTITY]))
    assert np.isnan(directions[0]).all()
    assert np.isfinite(directions[1]).all()


any_angles = st.floats(-10.0, 10.0)
any_elevations = st.floats(-math.pi / 2, math.pi / 2)
terms = st.tuples(*[st.floats(-3.0, 3.0)] * 6)
ranges = st.tuples(st.floats(-1.5, 0.0), st.floats(0.0, 1.5))
AROUND = (-0.8, 0.8)
offsets = st.builds(
    PointingOffset, rung=st.sampled_from(["pitch", "polynomial"]), azimuth=terms, elevation=terms,
    reference_rad=any_angles, azimuth_range_rad=ranges, elevation_range_rad=ranges,
)  # fmt: skip


def test_the_polynomials_by_hand() -> None:
    offset = PointingOffset(
        rung="polynomial",
        elevation=(0.01, 0.02, 0.03, 0.04, 0.05, 0.06),
        azimuth=(-0.01, 0.1, 0.0, 0.0, 0.0, 0.0),
        reference_rad=3.0,
        azimuth_range_rad=AROUND,
        elevation_range_rad=AROUND,
    )
    a, e = 0.4, -0.5
    azimuth, elevation = apply(offset, 3.4 - math.tau, e)
    assert azimuth == pytest.approx(-0.01 + 0.1 * a)
    assert elevation == pytest.approx(0.01 + 0.02 * a + 0.03 * e + 0.04 * a * a + 0.05 * a * e + 0.06 * e * e)


def test_without_a_pose_only_the_elevation_is_corrected_as_in_the_midst_of_the_anchors() -> None:
    offset = PointingOffset(
        rung="polynomial",
        elevation=(0.01, 0.5, 0.03, 0.5, 0.5, 0.0),
        azimuth=(0.1, 0.1, 0.0, 0.0, 0.0, 0.0),
        reference_rad=1.0,
        azimuth_range_rad=AROUND,
        elevation_range_rad=AROUND,
    )
    assert apply(offset, None, 0.2) == pytest.approx((0.0, 0.01 + 0.03 * 0.2))


@given(offsets, any_angles, any_elevations)
def test_it_is_bounded_and_never_leads_over_the_pole(
    offset: PointingOffset, azimuth_rad: float, elevation_rad: float
) -> None:
    azimuth, elevation = apply(offset, azimuth_rad, elevation_rad)
    assert abs(azimuth) <= MAX_CORRECTION_RAD
    assert abs(elevation) <= MAX_CORRECTION_RAD
    assert abs(elevation_rad + elevation) <= math.pi / 2 + 1e-12


@given(offsets, st.floats(-0.5, 0.5), st.floats(0.0, 1.5))
def test_beyond_all_azimuths_it_stays(offset: PointingOffset, elevation_rad: float, further: float) -> None:
    edge = offset.reference_rad + offset.azimuth_range_rad[1]
    at_edge = apply(offset, edge, elevation_rad)
    assert apply(offset, edge + further, elevation_rad) == pytest.approx(at_edge)


@given(offsets, any_angles, st.floats(0.0, 0.4))
def test_beyond_all_elevations_it_stays(offset: PointingOffset, azimuth_rad: float, further: float) -> None:
    offset = offset.model_copy(update={"elevation_range_rad": (-0.6, 0.6)})
    at_edge = apply(offset, azimuth_rad, -0.6)
    assert apply(offset, azimuth_rad, -0.6 - further) == pytest.approx(at_edge)


@given(offsets, any_angles, st.sampled_from([-1.0, 1.0]))
def test_straight_up_and_down_nothing_jumps(offset: PointingOffset, azimuth_rad: float, up: float) -> None:
    """Across the pole the azimuth turns round; the corrected ray must not."""
    rays: list[vector.Vec3] = []
    for side in (0.0, math.pi):
        elevation_rad = up * (math.pi / 2 - 1e-6)
        by_azimuth, by_elevation = apply(offset, azimuth_rad + side, elevation_rad)
        rays.append(vector.direction(azimuth_rad + side + by_azimuth, elevation_rad + by_elevation))
    assert vector.angle_between(rays[0], rays[1]) < 2e-6 * (1.0 + MAX_CORRECTION_RAD / math.sin(FADE_RAD))
