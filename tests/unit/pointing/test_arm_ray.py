"""The ray of an arm, and offsets of it."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.schemas import Anchor, BodyMeasures, PointingOffset, UserProfile
from pointit.services.pointing.offset import OffsetFit, OffsetSighting, fit, sighting
from pointit.services.pointing.pointer import FADE_RAD, MAX_CORRECTION_RAD, ArmRay, RayModel, apply
from tests.support import there

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
    return there(ray.ray(rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)))


def direction(ray: ArmRay, azimuth_rad: float, elevation_rad: float, roll_rad: float = 0.0) -> vector.Vec3:
    found = there(ray.ray(rotation.from_azimuth_elevation(azimuth_rad, elevation_rad, roll_rad)))
    return found[1]


def test_level_arm_points_down_from_the_eyes_over_the_finger() -> None:
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
    left = ArmRay(body, hand="left")
    right = ArmRay(body, hand="right")
    assert direction(left, 0.0, 0.0)[1] > 0.0 > direction(right, 0.0, 0.0)[1]
    left, right = (ArmRay(body, hand=hand, model="shoulder_arm") for hand in ("left", "right"))
    assert (rayed(left, 0.0, 0.0)[0], rayed(right, 0.0, 0.0)[0]) == ((0.0, 0.2, 1.43), (0.0, -0.2, 1.43))
    assert rayed(right, math.pi / 2, 0.3)[0] == pytest.approx((0.2, 0.0, 1.43))


@given(angles, elevations, st.sampled_from(["shoulder_arm", "forearm"]))
def test_arm_rays_go_along_the_arm(azimuth_rad: float, elevation_rad: float, model: RayModel) -> None:
    ray = ArmRay(model=model)
    along = vector.direction(azimuth_rad, elevation_rad)
    assert vector.angle_between(direction(ray, azimuth_rad, elevation_rad), along) < 1e-7


def test_forearm_starts_at_the_elbow_of_a_hanging_upper_arm() -> None:
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
    a = 0.4
    e = -0.5
    azimuth, elevation = apply(offset, 3.4 - math.tau, e)
    assert azimuth == pytest.approx(-0.01 + 0.1 * a)
    assert elevation == pytest.approx(0.01 + 0.02 * a + 0.03 * e + 0.04 * a * a + 0.05 * a * e + 0.06 * e * e)


def test_only_the_elevation_is_corrected_without_a_pose() -> None:
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


DEG = math.radians(1.0)
Rng = np.random.Generator


def seen(azimuth_deg: float, elevation_deg: float, turn_deg: float, raise_deg: float) -> OffsetSighting:
    """Return a pointing at a place whose ray must be turned by what it is off to meet it."""
    azimuth_rad = (azimuth_deg - turn_deg) * DEG
    elevation_rad = (elevation_deg - raise_deg) * DEG
    return OffsetSighting(azimuth_rad, elevation_rad, azimuth_deg * DEG, elevation_deg * DEG)


def spread_out(count: int, rng: Rng) -> list[tuple[float, float]]:
    """Return targets in front, azimuth and elevation, deg."""
    return [(rng.uniform(-40.0, 40.0), rng.uniform(-40.0, 5.0)) for _ in range(count)]


def left_deg(fitted: OffsetFit, held_out: Sequence[OffsetSighting]) -> tuple[float, float]:
    """Return the rms of what is left of azimuth and elevation, deg, heading set right."""
    offset = there(fitted.offset)
    errors: list[tuple[float, float]] = []
    for each in held_out:
        azimuth = each.azimuth_rad + fitted.heading_rad
        by_azimuth, by_elevation = apply(offset, azimuth, each.elevation_rad)
        left_rad = each.elevation_rad + by_elevation - each.target_elevation_rad
        errors.append((vector.wrap(azimuth + by_azimuth - each.target_azimuth_rad) / DEG, left_rad / DEG))
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    return float(rms[0]), float(rms[1])


def test_one_anchor_is_believed_but_for_what_people_are_like() -> None:
    fitted = fit([seen(20.0, -30.0, 3.0, 5.0)], fitted_ns=7)
    assert fitted.offset is not None
    assert fitted.offset.rung == "pitch"
    # people: 4 deg about 0; a hold: 1 deg
    assert fitted.offset.elevation[0] == pytest.approx(5.0 * DEG * 16.0 / 17.0)
    assert (fitted.offset.azimuth, fitted.offset.anchors, fitted.offset.fitted_ns) == ((0.0,) * 6, 1, 7)
    # one anchor does not tell whether the person sees their hand: scatter of 0.5 to 6 degrees
    assert 3.0 * DEG < fitted.offset.sigma_rad < 6.0 * DEG
    assert fitted.heading_rad == pytest.approx(3.0 * DEG)
    assert 4.0 * DEG <= fitted.heading_sigma_rad < 5.0 * DEG


def test_a_new_person_after_one_anchor() -> None:
    """Simulated people of pointing.md §3: 4.35 deg rms must become at most 1.5; the bound is 1.41."""
    rng = np.random.default_rng(3)
    before: list[float] = []
    after: list[float] = []
    within: list[bool] = []
    for _ in range(2000):
        bias = rng.normal(2.8, 2.8)
        anchor, new = (seen(*place, 0.0, bias + rng.normal()) for place in spread_out(2, rng))
        offset = there(fit([anchor]).offset)
        _, by_elevation = apply(offset, None, new.elevation_rad)
        off = new.target_elevation_rad - new.elevation_rad
        before.append(off)
        after.append(off - by_elevation)
        within.append(abs(off - by_elevation) <= 2.0 * offset.sigma_rad)

    assert np.sqrt(np.mean(np.square(before))) / DEG > 4.0
    assert np.sqrt(np.mean(np.square(after))) / DEG < 1.5
    assert np.mean(within) > 0.95


@given(
    st.floats(-15.0, 15.0),
    st.floats(-180.0, 180.0),
    st.lists(st.tuples(st.floats(-170.0, 170.0), st.floats(-60.0, 30.0)), min_size=1, max_size=7),
    st.floats(-math.pi, math.pi),
)
def test_a_constant_is_found_wherever_the_room_points(
    bias_deg: float, heading_deg: float, places: list[tuple[float, float]], turn_rad: float
) -> None:
    anchors = [seen(*place, heading_deg, bias_deg) for place in places]
    turned = [
        dataclasses.replace(
            each,
            azimuth_rad=each.azimuth_rad + turn_rad,
            target_azimuth_rad=each.target_azimuth_rad + turn_rad,
        )
        for each in anchors
    ]
    for fitted in (fit(anchors), fit(turned)):
        assert fitted.dropped == ()
        shrunk = len(places) * 16.0 / (len(places) * 16.0 + 1.0)
        assert abs(there(fitted.offset).elevation[0] / DEG - shrunk * bias_deg) < 1e-6 + 0.15 * abs(bias_deg)
        assert abs(vector.wrap(fitted.heading_rad - heading_deg * DEG)) < 1e-9


@pytest.mark.parametrize("bad", [(0.0, 12.0), (0.0, -9.0), (25.0, 0.0), (-160.0, 0.0), (0.0, -75.0)])
def test_one_bad_hold_is_dropped(bad: tuple[float, float]) -> None:
    rng = np.random.default_rng(5)
    places = spread_out(6, rng)
    good = [seen(*place, rng.normal(2.0, 1.0), 4.0 + rng.normal(0.0, 0.7)) for place in places]
    spoiled = [*good[:3], seen(10.0, -20.0, 2.0 + bad[0], 4.0 + bad[1]), *good[3:]]
    expected = fit(good)
    fitted = fit(spoiled)
    assert (expected.dropped, fitted.dropped) == ((), (3,))
    assert fitted.offset == there(expected.offset)
    assert fitted.heading_rad == pytest.approx(expected.heading_rad)


def test_at_most_a_third_of_the_holds_is_dropped() -> None:
    good = [seen(20.0 * index, 0.0, 0.0, 2.0) for index in range(4)]
    bad = [seen(20.0 * index, 0.0, 0.0, 10.0 + 2.0 * index) for index in range(3)]
    fitted = fit([*good, *bad])
    assert fitted.dropped == (5, 6)  # the two worst of seven


def test_lone_sighting_with_a_hanging_hand_is_dropped() -> None:
    fitted = fit([seen(0.0, 10.0, 0.0, 70.0)])
    assert (fitted.offset, fitted.dropped) == (None, (0,))


@pytest.mark.parametrize("scatter_deg", [0.6, 1.5, 4.0])
@pytest.mark.parametrize("count", [1, 2, 4, 7])
def test_two_sigma_hold_for_people_of_any_scatter(scatter_deg: float, count: int) -> None:
    rng = np.random.default_rng(11)
    within: list[bool] = []
    stated: list[float] = []
    for _ in range(300):
        bias = rng.normal(0.0, 4.0)
        *anchors, new = (
            seen(*place, 0.0, bias + rng.normal(0.0, scatter_deg)) for place in spread_out(count + 1, rng)
        )
        offset = there(fit(anchors).offset)
        off = new.target_elevation_rad - new.elevation_rad
        within.append(abs(off - offset.elevation[0]) <= 2.0 * offset.sigma_rad)
        stated.append(offset.sigma_rad / DEG)

    assert np.mean(within) >= 0.88
    if count == 7:  # the anchors have told the scatter
        assert np.median(stated) < 2.0 * scatter_deg


def test_two_that_disagree_are_both_kept_and_doubted() -> None:
    agreed = fit([seen(0.0, 0.0, 0.0, 3.0), seen(20.0, 0.0, 0.0, 3.5)])
    torn = fit([seen(0.0, 0.0, 0.0, -4.0), seen(20.0, 0.0, 0.0, 9.0)])
    assert torn.dropped == ()
    assert there(torn.offset).sigma_rad > 1.5 * there(agreed.offset).sigma_rad


def bent(place: tuple[float, float], rng: Rng, noise_deg: float = 0.5) -> OffsetSighting:
    """Return a pointing of somebody whose error grows to the sides and downwards."""
    azimuth, elevation = place
    a = azimuth * DEG
    e = elevation * DEG
    off_azimuth = (0.12 * a + 0.08 * a * a) / DEG + rng.normal(0.0, noise_deg)
    off_elevation = (0.05 - 0.12 * e + 0.1 * a * a) / DEG + rng.normal(0.0, noise_deg)
    return seen(azimuth, elevation, off_azimuth, off_elevation)


def test_with_many_anchors_a_bent_error_is_straightened() -> None:
    rng = np.random.default_rng(11)
    anchors = [bent(place, rng) for place in spread_out(24, rng)]
    held_out = [bent(place, rng) for place in spread_out(200, rng)]
    flat = fit(anchors[:7])
    fitted = fit(anchors)
    assert (there(flat.offset).rung, there(fitted.offset).rung) == ("pitch", "polynomial")
    azimuth_before, elevation_before = left_deg(flat, held_out)
    azimuth_after, elevation_after = left_deg(fitted, held_out)
    assert azimuth_after < 0.5 * azimuth_before
    assert elevation_after < 0.5 * elevation_before


def test_a_polynomial_needs_eight_anchors_and_something_to_bend_for() -> None:
    rng = np.random.default_rng(13)
    places = spread_out(24, rng)
    few = fit([bent(place, rng, 0.0) for place in places[:7]])
    assert there(few.offset).rung == "pitch"
    climbed = 0
    for _ in range(50):
        straight = [seen(*place, rng.normal(0.0, 3.0), 3.0 + rng.normal()) for place in spread_out(12, rng)]
        fitted = fit(straight)
        climbed += there(fitted.offset).rung == "polynomial"
        held_out = [seen(*place, 0.0, 3.0) for place in spread_out(20, rng)]
        assert left_deg(fitted, held_out)[1] < 2.0
    assert climbed <= 12  # by chance


def test_beyond_the_anchors_it_never_bends_wildly() -> None:
    """Anchors in one corner with a strong slope: 40 deg away the correction is within 5 deg of theirs."""
    rng = np.random.default_rng(17)
    for _ in range(30):
        places = [(rng.uniform(0.0, 12.0), rng.uniform(-20.0, -10.0)) for _ in range(10)]
        anchors = [seen(a, e, rng.normal(), 0.9 * (e + 15.0) + rng.normal(0.0, 0.5)) for a, e in places]
        offset = there(fit(anchors).offset)
        at = [apply(offset, each.azimuth_rad, each.elevation_rad)[1] for each in anchors]
        middle = sum(at) / len(at)
        allowed = max(5.0 * DEG, 2.0 * max(abs(each - middle) for each in at)) + 1e-9
        for azimuth in range(-3, 4):
            for elevation in (-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2):
                _, by_elevation = apply(offset, float(azimuth), elevation)
                assert abs(by_elevation - middle) <= allowed


def test_all_around_there_is_no_polynomial_and_no_seam() -> None:
    rng = np.random.default_rng(19)
    places = [(-180.0 + 15.0 * index, rng.uniform(-40.0, 0.0)) for index in range(24)]
    fitted = fit([seen(a, e, 0.0, 3.0 + a / 30.0) for a, e in places])
    assert there(fitted.offset).rung == "pitch"


def test_an_anchors_message_becomes_a_sighting() -> None:
    """A person at (1, 2), {H} turned by 90 deg, eyes at 1.6 m; the target 2 m ahead of them on the floor."""
    anchor = Anchor(
        stamp_ns=0,
        target_m=(1.0, 4.0, 0.0),
        origin_m=(0.0, 0.0, 1.6),
        raw_direction=vector.direction(0.1, -0.6),
        direction=vector.direction(0.3, 0.0),
        position_m=(1.0, 2.0, 0.0),
        yaw_rad=math.pi / 2,
    )
    found = there(sighting(anchor))
    assert found.azimuth_rad == pytest.approx(math.pi / 2 + 0.1)
    assert found.elevation_rad == pytest.approx(-0.6)
    assert found.target_azimuth_rad == pytest.approx(math.pi / 2)
    assert found.target_elevation_rad == pytest.approx(math.atan2(-1.6, 2.0))
    assert sighting(anchor.model_copy(update={"target_m": None})) is None
