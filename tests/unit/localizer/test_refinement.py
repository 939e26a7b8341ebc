"""Quantities of a person that are found beside the pose, and expectations of one who is known."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.estimator import Pointings, SolverSettings
from tests.unit.localizer.person import (
    CORNERS,
    LAX,
    UNLIMITED,
    Person,
    angles,
    coordinates,
    pointings,
    position_error_m,
    solved,
    yaw_difference,
)

WAY: tuple[Vec3, ...] = tuple(
    (3.0 + 1.2 * math.cos(a), 1.2 * math.sin(a), 0.8 + 0.7 * math.sin(0.6 * a)) for a in np.arange(300) * 0.03
)
"""A robot that flies for 12 s."""


def exaggerated(given_pointings: Pointings, slope: float) -> Pointings:
    """Return the rays with 1 + `slope` times their elevations."""
    rays: NDArray[np.float64] = np.array(
        [
            vector.direction(vector.azimuth(ray), (1.0 + slope) * vector.elevation(ray))
            for ray in given_pointings.directions.tolist()
        ]
    )
    return dataclasses.replace(given_pointings, directions=rays)


@pytest.mark.parametrize("slope", [-0.3, -0.15, 0.1])
def test_poses_of_people_who_exaggerate_are_within_their_uncertainty(slope: float) -> None:
    person = Person(0.6, -0.4, 1.0)
    found = solved(exaggerated(pointings(person, CORNERS), slope), UNLIMITED)
    off = np.array([found.x_m - person.x, found.y_m - person.y])
    assert float(off @ np.linalg.solve(found.covariance[:2, :2], off)) < 6.0


@given(st.sampled_from(["elevation_slope_sigma", "azimuth_slope_sigma", "body_sigma_m", "rate_sigma_radps"]))
def test_less_known_about_a_person_is_less_known_about_their_pose(name: str) -> None:
    known: list[dict[str, Any]] = [{name: sigma} for sigma in (0.0001, 0.05, 0.3)]
    for rays in (pointings(Person(0.6, -0.4, 1.0), CORNERS), pointings(Person(), WAY, each=1)):
        sigmas_m = [solved(rays, dataclasses.replace(UNLIMITED, **each)).position_sigma_m for each in known]
        assert sigmas_m == sorted(sigmas_m)
        assert sigmas_m[-1] > sigmas_m[0]


def test_bias_that_is_expected_is_no_reason_for_a_refusal() -> None:
    person = Person(0.3, 0.2, 0.5, math.radians(9.0))
    trust = SolverSettings(bias_rad=math.radians(9.0), bias_sigma_rad=math.radians(1.5))
    solution = solved(pointings(person, CORNERS, noise_rad=0.01), trust)
    assert solution.bias_rad == pytest.approx(person.bias_rad, abs=math.radians(1.0))
    assert position_error_m(solution, person) < 0.05


@pytest.mark.parametrize("rate_degps", [-0.3, 0.0, 0.3])
def test_drift_while_following_stays_within_the_uncertainty(rate_degps: float) -> None:
    person = Person(0.6, -0.4, 1.0)
    rays = pointings(person, WAY, each=1)
    turned = math.radians(rate_degps) * (rays.stamps_s - rays.stamps_s.mean())
    cos, sin = np.cos(turned), np.sin(turned)
    x, y, z = rays.directions.T
    drifted = dataclasses.replace(rays, directions=np.column_stack([cos * x - sin * y, sin * x + cos * y, z]))
    assert position_error_m(solved(drifted, UNLIMITED), person) < 0.15


@settings(max_examples=20)
@given(coordinates, angles, angles, st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-9, 9)))
def test_following_does_not_depend_on_the_origins_of_world_and_yaw(
    x: float, yaw_rad: float, turn_rad: float, shift: Vec3
) -> None:
    here = pointings(Person(0.3 * x, 0.2, yaw_rad), WAY, each=1, noise_rad=0.02)
    turned = pointings(Person(0.3 * x, 0.2, yaw_rad - turn_rad), WAY, each=1, noise_rad=0.02)
    there = dataclasses.replace(turned, targets_m=turned.targets_m + np.array(shift))
    a, b = solved(here, LAX), solved(there, LAX, floor_m=shift[2])
    assert (b.x_m - a.x_m, b.y_m - a.y_m) == pytest.approx(shift[:2], abs=1e-5)
    assert abs(yaw_difference(a.yaw_rad - turn_rad, b.yaw_rad)) < 1e-5
    assert np.allclose(a.covariance, b.covariance, rtol=1e-4, atol=1e-8)
    assert float(np.linalg.eigvalsh(a.covariance)[0]) > 0.0
