"""People who point, the lab's lamps, and what tests of the localizer have in common."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Lamp, Localization, PointingRay, UserPose
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.outputs import Output

START_NS = 1_700_000_000 * NS_PER_S
USER = "anna"
EYES_M = 1.64
CORNERS: tuple[Vec3, ...] = ((3.0, 2.0, 0.1), (-3.0, 2.5, 0.9), (-2.5, -3.0, 2.0), (3.0, -2.0, 0.1))
LAB: tuple[Vec3, ...] = (
    (3.572, -2.946, 2.08), (1.699, -2.609, 0.85), (0.762, -1.031, 0.15), (3.239, -0.606, 0.15),
)  # fmt: skip
LAMPS = tuple(Lamp(id=f"led_{index}", position_m=LAB[index]) for index in range(3))
PLACES = {lamp.id: lamp.position_m for lamp in LAMPS}
ROOM = Environment(stamp_ns=0, name="lab", lamps=LAMPS)
UNLIMITED = SolverSettings().unlimited()
LAX = dataclasses.replace(UNLIMITED, bias_sigma_rad=math.radians(30.0))
LOOSE = dataclasses.replace(LAX, max_act_residual_rad=9.0)

coordinates = st.floats(-2.0, 2.0)
angles = st.floats(-math.pi, math.pi)
far = st.floats(-1000.0, 1000.0)
biases = st.floats(math.radians(-10.0), math.radians(10.0))


def config(**fields: object) -> LocalizerConfig:
    """Return the parameters `fields`; lamps in the given order and holds that begin at once unless stated."""
    return LocalizerConfig.model_validate({"order": "given", "steady_degps": 0.0, **fields})


def told(outputs: list[Output]) -> list[Localization]:
    return [output for output in outputs if isinstance(output, Localization)]


def poses(outputs: list[Output]) -> list[UserPose]:
    return [output for output in outputs if isinstance(output, UserPose)]


@dataclass(frozen=True)
class Person:
    """Stands at x, y; {H}'s x axis has azimuth `yaw_rad` in {W}; points too high by `bias_rad`."""

    x: float = 0.0
    y: float = 0.0
    yaw_rad: float = 0.0
    bias_rad: float = 0.0

    def direction(self, target: Vec3) -> Vec3:
        """Return where the ray at `target` goes, in {H}."""
        seen = vector.rotate_z(vector.subtract(target, (self.x, self.y, 0.0)), -self.yaw_rad)
        reach = vector.subtract(seen, (0.0, 0.0, EYES_M))
        return vector.direction(vector.azimuth(reach), vector.elevation(reach) + self.bias_rad)

    def ray(self, target: Vec3, stamp_ns: int) -> PointingRay:
        return PointingRay(stamp_ns=stamp_ns, origin_m=(0.0, 0.0, EYES_M), direction=self.direction(target))


def pointings(
    person: Person,
    targets: Sequence[Vec3],
    *,
    each: int = 50,
    rate_hz: float = 25.0,
    noise_rad: float = 0.0,
    seed: int = 0,
) -> Pointings:
    """Return `each` rays at every target, one after the other, white noise on azimuth and elevation."""
    generator = np.random.default_rng(seed)
    directions: list[Vec3] = []
    for target in targets:
        exact = person.direction(target)
        for azimuth, elevation in generator.normal(0.0, noise_rad, (each, 2)):
            directions.append(
                vector.direction(
                    vector.azimuth(exact) + float(azimuth), vector.elevation(exact) + float(elevation)
                )
            )
    count = len(directions)
    return Pointings(
        np.arange(count) / rate_hz,
        np.tile([0.0, 0.0, EYES_M], (count, 1)),
        np.array(directions),
        np.repeat(np.array(targets, dtype=np.float64), each, axis=0),
    )


def yaw_difference(a_rad: float, b_rad: float) -> float:
    return math.remainder(a_rad - b_rad, math.tau)


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
