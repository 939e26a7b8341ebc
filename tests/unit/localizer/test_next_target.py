"""Selection of the next lamp, and the accuracy that any solver can reach."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.levenberg_marquardt import PARAMETERS, Array, Rays, residuals
from pointit.services.localizer.static_targets import (
    ObservationModel,
    best_for_yaw,
    fisher_information,
    next_target,
    prior,
)
from tests.unit.localizer.person import EYES_M, LAB, Person

CONVEYOR: tuple[Vec3, ...] = ((0.15, 0.05, 1.55), (-2.4, -0.025, 1.25), (-2.85, -3.775, 2.55))
SIGMA = math.radians(2.0)
ONE = ObservationModel(ray_sigma_rad=SIGMA, elevation_sigma_rad=SIGMA, body_sigma_m=0.0, bias_sigma_rad=1e-6)
"""One pointing of 2° a target, whose bias is known: the bound that pointing.md §4 gives."""


def bounds(targets_m: Sequence[Vec3], eyes_m: Vec3, acuity: ObservationModel) -> tuple[float, float]:
    """Return 1 sigma of position (m, both directions together) and yaw (rad) after a hold at each."""
    told: Array = fisher_information(np.array(targets_m), np.array([eyes_m]), acuity)[0].sum(axis=0)
    covariance = np.linalg.inv(told + prior(acuity)).astype(np.float64)
    return math.sqrt(covariance[0, 0] + covariance[1, 1]), math.sqrt(covariance[2, 2])


def around(distance_m: float, *azimuths_deg: float) -> list[Vec3]:
    return [
        (distance_m * math.cos(math.radians(a)), distance_m * math.sin(math.radians(a)), 0.0)
        for a in azimuths_deg
    ]


@pytest.mark.parametrize(
    ("targets", "stand", "position_m", "yaw_deg"),
    [
        # the maps are the original's; where people stood is not written down, so these are places in the
        # room from which the bound is as stated
        pytest.param(CONVEYOR[:2], (1.5, 1.1), 0.98, 9.0, id="two LEDs of the conveyor"),
        pytest.param(LAB[:2], (0.5, -0.3), 0.50, 7.2, id="two LEDs of the lab"),
        pytest.param(around(2.45, -64, 0, 64), (0.0, 0.0), 0.14, 2.3, id="three on the floor"),
        pytest.param(around(4.0, 45, 135, 225, 315), (0.0, 0.0), 0.14, 1.1, id="four in corners"),
    ],
)
def test_the_bounds_are_as_stated(
    targets: Sequence[Vec3], stand: tuple[float, float], position_m: float, yaw_deg: float
) -> None:
    sigma_m, sigma_rad = bounds(targets, (*stand, EYES_M), ONE)
    assert sigma_m == pytest.approx(position_m, rel=0.05)
    assert math.degrees(sigma_rad) == pytest.approx(yaw_deg, rel=0.05)


@given(st.integers(0, 10_000))
def test_the_information_is_that_of_the_solvers_residuals(seed: int) -> None:
    """J'J of the solver's own Jacobian at the truth; yaw does not matter."""
    generator = np.random.default_rng(seed)
    x, y, yaw = generator.uniform(-1, 1, 3)
    person = Person(float(x), float(y), float(yaw))
    targets = np.column_stack([around(3.0, *generator.uniform(0, 360, 4))])
    targets[:, 2] = generator.uniform(0, 2.5, 4)
    directions = np.array([person.direction((t[0], t[1], t[2])) for t in targets])
    rays = Rays.of(np.tile([0.0, 0.0, EYES_M], (4, 1)), directions, targets)
    _, slope = residuals(rays, np.array([[person.x, person.y, person.yaw_rad, *[0.0] * (PARAMETERS - 3)]]))
    flat = slope[0, :4].reshape(4, -1)
    told = fisher_information(targets, np.array([[person.x, person.y, EYES_M]]), ONE)[0].sum(axis=0)
    assert np.allclose(flat @ flat.T / ONE.ray_sigma_rad**2, told, rtol=1e-6, atol=1e-4 * told.max())


@given(st.integers(0, 10_000))
def test_the_choice_is_the_one_that_leaves_the_least_uncertainty(seed: int) -> None:
    generator = np.random.default_rng(seed)
    lamps: list[Vec3] = [
        (x, y, z) for x, y, z in generator.uniform((-4, -4, 0), (4, 4, 2.5), (5, 3)).tolist()
    ]
    place = (float(generator.uniform(-1, 1)), float(generator.uniform(-1, 1)))
    acuity = ObservationModel()
    chosen = next_target(lamps, [1, 1, 0, 0, 0], acuity, place_m=place)
    assert chosen in (2, 3, 4)
    eyes = (*place, EYES_M)

    def volume(index: int) -> float:
        seen = np.array([lamps[0], lamps[1], lamps[index]])
        told: Array = fisher_information(seen, np.array([eyes]), acuity)[0].sum(axis=0)
        prior = np.diag([1e-2, 1e-2, 1.0 / math.pi**2, acuity.bias_sigma_rad**-2])
        return float(np.linalg.det(np.linalg.inv(told + prior)[:3, :3]))

    assert volume(chosen) == pytest.approx(min(volume(index) for index in (2, 3, 4)), rel=1e-6)


def test_before_a_pose_is_known_the_same_direction_twice_is_avoided() -> None:
    lamps: list[Vec3] = [(3.0, 0.0, 1.6), (3.05, 0.0, 1.6), (0.0, 3.0, 0.1), (-3.0, 0.0, 0.1)]
    first = next_target(lamps, [0, 0, 0, 0], ObservationModel())
    visits = [0, 0, 0, 0]
    visits[first] = 1
    second = next_target(lamps, visits, ObservationModel())
    assert {first, second} == {2, 3}  # low and far apart


def test_the_worlds_origin_and_the_order_of_lamps_do_not_matter() -> None:
    shifted = [(x + 100.0, y - 50.0, z + 7.0) for x, y, z in LAB]
    for visits in ([0, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0]):
        here = next_target(LAB, visits, ObservationModel())
        assert next_target(shifted, visits, ObservationModel(), floor_m=7.0) == here
        back = next_target(LAB[::-1], visits[::-1], ObservationModel())
        assert LAB[::-1][back] == LAB[here]


def test_used_lamps_come_again_only_when_all_were_used() -> None:
    visits = [0, 0, 0, 0]
    order: list[int] = []
    for _ in range(8):
        index = next_target(LAB, visits, ObservationModel(), place_m=(2.0, 0.5))
        visits[index] += 1
        order.append(index)
    assert sorted(order[:4]) == sorted(order[4:]) == [0, 1, 2, 3]


def test_the_yaw_is_told_best_by_a_far_and_level_lamp() -> None:
    lamps: list[Vec3] = [(0.1, 0.0, 0.0), (1.0, 0.0, 1.6), (6.0, 0.0, 1.6), (1.0, 1.0, 5.0)]
    vague = np.diag([0.04, 0.04, 0.3])
    assert best_for_yaw(lamps, (0.0, 0.0), vague, ObservationModel()) == 2
    assert (
        best_for_yaw(lamps[:2], (0.0, 0.0), np.diag([0.0, 0.0, 0.3]), ObservationModel()) == 1
    )  # not at the feet
    assert best_for_yaw(lamps[:1], (0.0, 0.0), vague, ObservationModel()) == 0
    across = np.diag([0.0, 0.25, 0.3])  # uncertain sideways for the lamps ahead
    beside: list[Vec3] = [(4.0, 0.0, 1.6), (0.0, 4.0, 1.6)]
    assert best_for_yaw(beside, (0.0, 0.0), across, ObservationModel()) == 1
