"""What is found about a person beside the pose, and what is expected of one who is known."""

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
from tests.unit.localizer.person import Person, pointings, yaw_difference
from tests.unit.localizer.solving import (
    CORNERS,
    LAX,
    LOOSE,
    UNLIMITED,
    angles,
    coordinates,
    position_error_m,
    solved,
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


def test_who_is_known_to_exaggerate_heights_is_found() -> None:
    person = Person(0.6, -0.4, 1.0)
    rays = exaggerated(pointings(person, CORNERS), -0.2)
    unknown = solved(rays, UNLIMITED)
    known = solved(rays, dataclasses.replace(UNLIMITED, elevation_slope=1.0 - 1.0 / 0.8))
    assert position_error_m(known, person) < 0.01
    assert position_error_m(unknown, person) > 0.02
    assert known.elevation_slope == pytest.approx(-0.25, abs=0.01)


def test_slope_of_elevations_is_found_if_it_is_open() -> None:
    person = Person(0.6, -0.4, 1.0, math.radians(4.0))
    open_slope = dataclasses.replace(UNLIMITED, elevation_slope_sigma=0.3)
    plain = solved(pointings(person, CORNERS * 6), open_slope)
    lower = solved(exaggerated(pointings(person, CORNERS * 6), -0.2), open_slope)
    assert abs(plain.elevation_slope) < 0.05
    assert lower.elevation_slope < plain.elevation_slope - 0.1
    assert lower.elevation_slope_sigma < 0.15


@given(st.sampled_from(["elevation_slope_sigma", "azimuth_slope_sigma", "bias_sigma_rad", "body_sigma_m"]))
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


def test_scatter_is_that_of_the_person_and_makes_the_next_pose_as_sure() -> None:
    person = Person(0.3, 0.2, 0.5)
    calm, restless = (
        solved(pointings(person, CORNERS * 3, noise_rad=noise), LOOSE) for noise in (0.001, 0.9)
    )
    assert calm.scatter_rad < 0.7 * SolverSettings().act_sigma_rad < restless.scatter_rad
    rays = pointings(person, CORNERS)
    sigmas = [
        solved(rays, dataclasses.replace(LAX, scatter_rad=each)).yaw_sigma_rad for each in (None, 0.1, 0.2)
    ]
    assert sigmas == sorted(sigmas)


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
