"""Rooms, settings and helpers for tests of the solver."""

import dataclasses
import math

from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from tests.unit.localizer.person import Person

CORNERS: tuple[Vec3, ...] = ((3.0, 2.0, 0.1), (-3.0, 2.5, 0.9), (-2.5, -3.0, 2.0), (3.0, -2.0, 0.1))
LAB: tuple[Vec3, ...] = (
    (3.572, -2.946, 2.08),
    (1.699, -2.609, 0.85),
    (0.762, -1.031, 0.15),
    (3.239, -0.606, 0.15),
)
UNLIMITED = SolverSettings(max_position_sigma_m=1e6, max_yaw_sigma_rad=1e6)
LAX = SolverSettings(max_position_sigma_m=1e6, max_yaw_sigma_rad=1e6, bias_sigma_rad=math.radians(30.0))
LOOSE = dataclasses.replace(LAX, max_act_residual_rad=9.0)

coordinates = st.floats(-2.0, 2.0)
angles = st.floats(-math.pi, math.pi)
far = st.floats(-1000.0, 1000.0)
biases = st.floats(math.radians(-10.0), math.radians(10.0))


def solved(given_pointings: Pointings, trust: SolverSettings | None = None, floor_m: float = 0.0) -> Solution:
    result = solve(given_pointings, trust, floor_m=floor_m)
    assert isinstance(result, Solution), result
    return result


def refused(given_pointings: Pointings, trust: SolverSettings | None = None) -> str:
    result = solve(given_pointings, trust)
    assert isinstance(result, Refusal), result
    return result.reason


def position_error_m(solution: Solution, person: Person) -> float:
    return math.hypot(solution.x_m - person.x, solution.y_m - person.y)
