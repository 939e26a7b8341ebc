"""Correction of a ray: bounded, continuous, and constant beyond the anchors."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.schemas import PointingOffset
from pointit.services.pointing.arm_ray import FADE_RAD, MAX_CORRECTION_RAD, apply

angles = st.floats(-10.0, 10.0)
elevations = st.floats(-math.pi / 2, math.pi / 2)
terms = st.tuples(*[st.floats(-3.0, 3.0)] * 6)
ranges = st.tuples(st.floats(-1.5, 0.0), st.floats(0.0, 1.5))
AROUND = (-0.8, 0.8)
offsets = st.builds(
    PointingOffset, rung=st.sampled_from(["pitch", "polynomial"]), azimuth=terms, elevation=terms,
    reference_rad=angles, azimuth_range_rad=ranges, elevation_range_rad=ranges,
)  # fmt: skip


def test_pitch_is_a_constant_whatever_else_stands_there() -> None:
    offset = PointingOffset(
        rung="pitch", elevation=(0.05, 1.0, 1.0, 1.0, 1.0, 1.0), azimuth=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    assert apply(offset, 1.2, 0.3) == (0.0, 0.05)
    assert apply(offset, None, 0.3) == (0.0, 0.05)


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


@given(offsets, angles, elevations)
def test_it_is_bounded_and_never_leads_over_the_pole(
    offset: PointingOffset, azimuth_rad: float, elevation_rad: float
) -> None:
    azimuth, elevation = apply(offset, azimuth_rad, elevation_rad)
    assert abs(azimuth) <= MAX_CORRECTION_RAD
    assert abs(elevation) <= MAX_CORRECTION_RAD
    assert abs(elevation_rad + elevation) <= math.pi / 2 + 1e-12


@given(offsets, st.floats(-0.5, 0.5), st.floats(0.0, 1.5))
def test_beyond_the_anchors_azimuths_it_stays(
    offset: PointingOffset, elevation_rad: float, further: float
) -> None:
    edge = offset.reference_rad + offset.azimuth_range_rad[1]
    at_edge = apply(offset, edge, elevation_rad)
    assert apply(offset, edge + further, elevation_rad) == pytest.approx(at_edge)


@given(offsets, angles, st.floats(0.0, 0.4))
def test_beyond_the_anchors_elevations_it_stays(
    offset: PointingOffset, azimuth_rad: float, further: float
) -> None:
    offset = offset.model_copy(update={"elevation_range_rad": (-0.6, 0.6)})
    at_edge = apply(offset, azimuth_rad, -0.6)
    assert apply(offset, azimuth_rad, -0.6 - further) == pytest.approx(at_edge)


@given(offsets, angles, st.sampled_from([-1.0, 1.0]))
def test_straight_up_and_down_nothing_jumps(offset: PointingOffset, azimuth_rad: float, up: float) -> None:
    """Across the pole the azimuth turns round; the corrected ray must not."""
    rays: list[vector.Vec3] = []
    for side in (0.0, math.pi):
        elevation_rad = up * (math.pi / 2 - 1e-6)
        by_azimuth, by_elevation = apply(offset, azimuth_rad + side, elevation_rad)
        rays.append(vector.direction(azimuth_rad + side + by_azimuth, elevation_rad + by_elevation))
    assert vector.angle_between(rays[0], rays[1]) < 2e-6 * (1.0 + MAX_CORRECTION_RAD / math.sin(FADE_RAD))
