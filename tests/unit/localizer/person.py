"""A person who points: rays in {H} at places in {W}, for tests."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import PointingRay
from pointit.services.localizer.estimation.estimator import Pointings

EYES_M = 1.64


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
