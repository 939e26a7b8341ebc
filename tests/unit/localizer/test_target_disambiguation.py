"""Choice of the followed robot: probabilities, ambiguity, and no flicker."""

import math

import numpy as np
import pytest

from pointit.services.localizer.estimation.estimator import Refusal, Solution, SolverSettings
from pointit.services.localizer.moving_target import TargetDisambiguator, rank_by_posterior

TRUST = SolverSettings()
N = 9.0


def solution(residual_deg: float, x_m: float = 0.0) -> Solution:
    return Solution(
        x_m=x_m,
        y_m=0.0,
        yaw_rad=0.0,
        bias_rad=0.0,
        covariance=np.eye(3) * 0.01,
        residual_rad=math.radians(residual_deg),
        samples=100,
    )


def decide(meant: TargetDisambiguator, **residuals_deg: float) -> str:
    """Return the chosen robot, or the reason for no choice."""
    results = [(name, solution(deg, ord(name[0]))) for name, deg in residuals_deg.items()]
    fits = rank_by_posterior(results, N, TRUST.ray_sigma_rad)
    told = meant.choose(fits)
    return told.reason if isinstance(told, Refusal) else meant.object_id


def test_probabilities_are_those_of_the_residuals() -> None:
    fits = rank_by_posterior(
        [("b", solution(3.0)), ("a", solution(2.0)), ("c", Refusal("few rays"))], N, 0.0349
    )
    assert [fit.object_id for fit in fits] == ["a", "b", "c"]
    odds = math.exp(-0.5 * N * (math.radians(3.0) ** 2 - math.radians(2.0) ** 2) / 0.0349**2)
    assert fits[0].probability == pytest.approx(1.0 / (1.0 + odds))
    assert sum(fit.probability for fit in fits) == pytest.approx(1.0)
    assert fits[2].probability == 0.0


def test_choice_stays_until_another_robot_is_clearly_meant() -> None:
    meant = TargetDisambiguator()
    assert "two robots move alike, a and b" in decide(meant, a=2.0, b=2.1)
    assert decide(meant, a=1.0, b=6.0) == "a"
    assert decide(meant, a=2.0, b=2.1) == "a"  # at first that would be undecided
    # hardly better: the pose is not changed
    assert "two robots move alike" in decide(meant, a=2.1, b=2.0)
    assert decide(meant, a=2.0, b=2.1) == "a"
    # clearly better, but once is not enough
    assert "two robots move alike" in decide(meant, a=6.0, b=1.0)
    assert decide(meant, a=1.0, b=6.0) == "a"
    decide(meant, a=6.0, b=1.0)
    assert decide(meant, a=6.0, b=1.0) == "b"


def test_one_that_leaves_is_let_go() -> None:
    meant = TargetDisambiguator()
    assert (decide(meant, a=1.0, b=6.0), decide(meant, b=1.0)) == ("a", "b")


def test_noise_about_equal_does_not_flicker() -> None:
    generator = np.random.default_rng(3)
    meant = TargetDisambiguator()
    assert decide(meant, a=1.0, b=5.0) == "a"
    named = set[str]()
    for _ in range(200):
        told = decide(meant, a=2.0 + generator.normal(0, 0.3), b=2.2 + generator.normal(0, 0.3))
        if "alike" not in told:
            named.add(told)
    assert named == {"a"}


def test_two_that_fit_differently_well_are_told_apart_by_their_probability_alone() -> None:
    """1.0° against 1.5° is half as much again; of nine pointings that may still be chance."""
    assert "two robots move alike, a and b" in decide(TargetDisambiguator(), a=1.0, b=1.5)
    assert decide(TargetDisambiguator(), a=1.0, b=3.5) == "a"
