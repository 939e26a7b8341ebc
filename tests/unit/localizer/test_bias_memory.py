"""Elevation bias remembered between localizations: its filter and its guard."""

import dataclasses
import math

import numpy as np
import pytest

from pointit.schemas import RememberedBias
from pointit.services.localizer.estimation.bias_memory import (
    REFERENCE_RAD,
    WANDER_RAD,
    BiasMemory,
    expected_bias,
    updated,
)
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from tests.unit.localizer.person import EYES_M, Person, solved

SETTINGS = SolverSettings().unlimited()
NEW = RememberedBias(
    localizations=0,
    origin_height_m=EYES_M,
    bias_rad=0.0,
    slope=0.0,
    covariance=(math.radians(10.0) ** 2, 0.0, 0.0, 0.15**2),
)


def following(person: Person, seconds: float, *, start_s: float = 0.0) -> Pointings:
    """Return rays of `person` at a robot that flies a figure of eight 2 m ahead, 25 a second."""
    times_s = start_s + np.arange(0.0, seconds + 1e-9, 0.04)
    x_m = 2.0 + 0.8 * np.sin(2.0 * times_s)
    y_m = 1.0 * np.sin(times_s)
    targets_m = np.stack([x_m, y_m, 0.8 + 0.3 * np.sin(1.3 * times_s)], axis=1)
    directions = np.array([person.direction(tuple(target)) for target in targets_m.tolist()])
    origins_m = np.tile([0.0, 0.0, EYES_M], (len(times_s), 1))
    return Pointings(times_s - times_s[0], origins_m, directions, targets_m)


def learned(person: Person, seconds: float = 10.0) -> BiasMemory:
    memory = BiasMemory()
    assert memory.learn(following(person, seconds), SETTINGS, 0.0)
    return memory


def test_the_filter_is_the_least_squares_fit_of_all_measurements() -> None:
    elevations = np.radians([-20.0, -45.0, -5.0])
    biases = np.radians([6.0, 9.0, 3.5])
    sigmas = np.radians([3.0, 4.0, 2.5])
    memory = NEW
    for elevation, bias, sigma in zip(elevations.tolist(), biases.tolist(), sigmas.tolist(), strict=True):
        memory = updated(memory, bias, sigma, elevation)
    # one row a measurement and one a prior, each divided by its standard deviation
    spreads = np.hypot(sigmas, WANDER_RAD)
    rows = np.vstack([np.stack([1.0 / spreads, (elevations - REFERENCE_RAD) / spreads], axis=1),
                      np.diag([1.0 / math.radians(10.0), 1.0 / 0.15])])  # fmt: skip
    fit, *_ = np.linalg.lstsq(rows, np.concatenate([biases / spreads, [0.0, 0.0]]), rcond=None)
    covariance = np.linalg.inv(rows.T @ rows)

    assert (memory.bias_rad, memory.slope) == pytest.approx(fit, rel=1e-9)
    np.testing.assert_allclose(memory.covariance, covariance.ravel())
    assert memory.localizations == 3

    mean_rad, sigma_rad = expected_bias(memory, math.radians(-30.0))
    row = np.array([1.0, math.radians(-30.0) - REFERENCE_RAD])
    assert mean_rad == pytest.approx(row @ fit)
    assert sigma_rad == pytest.approx(math.sqrt(row @ covariance @ row + WANDER_RAD**2))


def test_bias_is_measured_by_three_seconds_but_not_by_less() -> None:
    person = Person(0.5, -0.3, 0.4, math.radians(7.0))
    memory = learned(person)
    assert memory.remembered is not None
    rays = following(person, 2.0, start_s=20.0)
    believed = memory.believed(rays, SETTINGS, 0.0)
    assert math.degrees(believed.bias_rad) == pytest.approx(7.0, abs=1.5)
    assert math.degrees(believed.bias_sigma_rad) < 5.0
    assert solved(rays, believed).bias_sigma_rad < solved(rays, SETTINGS).bias_sigma_rad
    short = BiasMemory()
    assert not short.learn(following(person, 2.8), SETTINGS, 0.0)
    assert short.remembered is None
    assert short.learn(following(person, 3.0), SETTINGS, 0.0)


def test_bias_memory_is_replaced_by_another_persons_accepted_pose() -> None:
    memory = learned(Person(bias_rad=math.radians(-12.0)))
    before = memory.remembered
    other = Person(bias_rad=math.radians(9.0))
    assert memory.believed(following(other, 5.0), SETTINGS, 0.0) is SETTINGS
    assert memory.remembered is before  # no pose is accepted yet
    assert not memory.learn(following(other, 2.2), SETTINGS, 0.0)
    assert memory.remembered is before  # too short to tell
    assert memory.learn(following(other, 10.0), SETTINGS, 0.0)
    assert memory.remembered is not None
    assert memory.remembered.localizations == 1
    assert math.degrees(expected_bias(memory.remembered, math.radians(-22.0))[0]) == pytest.approx(9.0, abs=2)


def test_rays_of_another_body_are_solved_without_memory() -> None:
    person = Person(bias_rad=math.radians(5.0))
    memory = learned(person)
    rays = following(person, 4.0)
    assert memory.believed(rays, SETTINGS, 0.0).bias_rad > 0.0
    taller = dataclasses.replace(rays, origins_m=np.add(rays.origins_m, [0.0, 0.0, 0.06]))
    assert memory.believed(taller, SETTINGS, 0.0) is SETTINGS


def test_rays_of_a_differently_worn_sensor_are_solved_without_memory() -> None:
    person = Person(bias_rad=math.radians(5.0))
    memory = learned(person)
    rays = following(person, 4.0)
    memory.mounting = "another"
    assert memory.believed(rays, SETTINGS, 0.0) is SETTINGS
    assert memory.learn(following(person, 4.0, start_s=30.0), SETTINGS, 0.0)
    assert memory.remembered is not None
    assert (memory.remembered.localizations, memory.remembered.mounting) == (1, "another")


def test_no_larger_bias_is_pointing_than_without_memory() -> None:
    person = Person(bias_rad=math.radians(19.0))
    memory = learned(person)
    rays = following(Person(bias_rad=math.radians(27.0)), 5.0)
    believed = memory.believed(rays, SETTINGS, 0.0)
    assert believed is not SETTINGS
    assert isinstance(solve(following(person, 5.0), believed), Solution)
    assert isinstance(solve(rays, SETTINGS), Refusal)
    assert isinstance(solve(rays, believed), Refusal)
    memory.remembered = NEW.model_copy(
        update={"bias_rad": math.radians(26.0), "covariance": (math.radians(3.0) ** 2, 0.0, 0.0, 0.01)}
    )
    assert memory.believed(following(Person(bias_rad=math.radians(24.0)), 5.0), SETTINGS, 0.0) is SETTINGS


def test_single_rays_that_miss_by_far_teach_nothing() -> None:
    rays = following(Person(bias_rad=math.radians(6.0)), 5.0)
    elevations = np.arcsin(rays.directions[:, 2])
    elevations[40:46] -= math.radians(25.0)  # the arm sinks for a quarter of a second
    level = rays.directions[:, :2] / np.hypot(*rays.directions[:, :2].T)[:, None]
    turned = np.column_stack([level * np.cos(elevations)[:, None], np.sin(elevations)])
    memory = BiasMemory()
    assert memory.learn(dataclasses.replace(rays, directions=turned), SETTINGS, 0.0)
    assert memory.remembered is not None
    assert math.degrees(expected_bias(memory.remembered, math.radians(-22.0))[0]) == pytest.approx(6.0, abs=2)


def test_values_that_are_no_covariance_are_harmless() -> None:
    wrong = NEW.model_copy(update={"covariance": (-1.0, 0.0, 0.0, -1.0), "localizations": 2**31 - 1})
    assert expected_bias(wrong, REFERENCE_RAD) == (0.0, WANDER_RAD)
    memory = BiasMemory()
    memory.remembered = wrong
    assert isinstance(
        solve(following(Person(), 5.0), memory.believed(following(Person(), 5.0), SETTINGS, 0.0)), Solution
    )
    assert memory.learn(following(Person(), 5.0), SETTINGS, 0.0)
    RememberedBias.model_validate(memory.remembered.model_dump())
