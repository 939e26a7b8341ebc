"""The descents of the solver: their costs, and minima compared with SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize as scipy_minimize

from pointit.services.localizer.estimation.levenberg_marquardt import evaluate_costs, minimize
from tests.unit.localizer.person import CORNERS, UNLIMITED, Person, angles, coordinates, pointings

NOISE_RAD = 0.08


@settings(max_examples=15)
@given(coordinates, coordinates, angles, st.integers(0, 1000))
def test_costs_of_a_descent_are_those_of_its_pose_and_no_search_finds_less_nearby(
    x: float, y: float, yaw_rad: float, seed: int
) -> None:
    rays = UNLIMITED.rays(
        pointings(Person(x, y, yaw_rad), CORNERS, each=5, noise_rad=NOISE_RAD, seed=seed), np.zeros(3)
    )
    weights = UNLIMITED.weights()
    start = np.array([[x + 0.3, y - 0.3, yaw_rad + 0.3, 0.05, 0.0]])
    found = minimize(rays, start, weights)
    assert evaluate_costs(rays, found.poses, weights) == pytest.approx(found.costs)

    def cost(pose: NDArray[np.float64]) -> float:
        return float(evaluate_costs(rays, pose[None], weights)[0])

    searched = scipy_minimize(cost, found.poses[0])
    assert found.costs[0] <= searched.fun + 1e-4


def test_exact_rays_lead_to_the_exact_pose_in_all_digits() -> None:
    """Damping falls after good steps; with a constant one, the last digits would be missing."""
    true = np.array([0.5, -0.4, 1.0, 0.0, 0.0])
    rays = UNLIMITED.rays(pointings(Person(0.5, -0.4, 1.0), CORNERS, each=5), np.zeros(3))
    aside = np.random.default_rng(1).uniform(-1.0, 1.0, (25, 5)) * [1.0, 1.0, 1.0, 0.0, 0.0]
    for start in true + aside:
        assert minimize(rays, start[None], UNLIMITED.weights()).poses[0] == pytest.approx(true, abs=1e-10)
