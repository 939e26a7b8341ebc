"""Simulated people who point at lamps from several places, with errors of their own."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.scan.by_pointing import HEADING_SIGMA_RAD, PLACE_SIGMA_M, TargetRay, locate

BIAS_RAD = math.radians(3.0)
"""Standard deviation of people's common error, per axis, as in shared recordings (2 to 5 degrees)."""
HOLD_RAD = math.radians(1.5)
EYES_M = 1.64
LAMPS = 5


@dataclass(frozen=True)
class MeasuredStrip:
    """A lamp found by pointing: error and stated sigma, m, and whether a further place is asked for."""

    error_m: float
    sigma_m: float
    one_more: bool


def point_at_lamps(seed: int, places: int) -> list[MeasuredStrip]:
    """Return the five lamps that one person finds, pointed at once each from `places` places."""
    rng = np.random.default_rng(seed)
    width, depth = rng.uniform(3.5, 6.0, 2)
    lamps = rng.uniform([-width / 2, depth / 2 - 0.2, 0.4], [width / 2, depth / 2, 2.2], (LAMPS, 3))
    bias = rng.normal(0.0, BIAS_RAD, 2)
    first = rng.uniform(0.3, 0.7) * np.pi
    pointings: list[TargetRay] = []
    for place in range(places):
        angle = first + (0.6, -0.6, 0.0, 0.3)[place] + rng.normal(0.0, 0.1)
        reach = (0.45, 0.45, 0.2, 0.3)[place] * depth
        stands = np.array(
            [2.0 * reach * math.cos(angle), depth / 2 - 0.3 - 1.6 * reach * abs(math.sin(angle)), EYES_M]
        )
        pointed_m = stands + np.append(rng.normal(0.0, PLACE_SIGMA_M, 2), 0.0)
        heading = rng.normal(0.0, HEADING_SIGMA_RAD)
        for number, lamp in enumerate(lamps):
            x, y, z = lamp - stands
            azimuth = math.atan2(y, x) + bias[0] + heading + rng.normal(0.0, HOLD_RAD)
            elevation = math.atan2(z, math.hypot(x, y)) + bias[1] + rng.normal(0.0, HOLD_RAD)
            level = math.cos(elevation)
            direction = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
            origin = (float(pointed_m[0]), float(pointed_m[1]), float(pointed_m[2]))
            pointings.append(TargetRay(f"l{number}", "anna", str(place), origin, direction))
    found = locate(pointings)
    return [
        MeasuredStrip(
            float(np.linalg.norm(np.array(found[f"l{number}"].position_m) - lamp)),
            found[f"l{number}"].sigma_m,
            bool(found[f"l{number}"].reason),
        )
        for number, lamp in enumerate(lamps)
    ]
