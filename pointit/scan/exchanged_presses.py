"""Pairs of lamps whose presses from one place fit as well or better if they are exchanged.

Each pair is a hypothesis. All are ranked with the walk as it is estimated, where the misfit of a ray from the
first place and one from the second is a search over the distance. The best ones are fitted anew with all that
is unknown. Exchanging at the first place or at the second is the same up to the names, so it is tried once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pointit.geometry.array_types import Array
from pointit.scan.paced_model import (
    DISTANCE_SIGMA_M,
    FIRST,
    PRESS_SIGMA_RAD,
    SECOND,
    USUAL_M,
    PacedModel,
    PacedRay,
    PacedRoom,
    Walk,
)

DISTANCES_M = np.geomspace(0.4, 9.0, 60)
"""Distances along the floor at which rays are tried."""
MAX_FITTED = 8
"""Number of pairs that are fitted anew."""
MIN_RANKED_GAIN = -40.0
"""Gain in the ranking, below which a pair is not fitted: the ranking is not so wrong."""


@dataclass(frozen=True)
class Exchange:
    """Two lamps and the decrease of the sum of squares if their presses from one place are exchanged."""

    pair: tuple[str, str]
    gain: float


def find_exchanges(rays: Sequence[PacedRay], walk: Walk, solution: Any, room: PacedRoom) -> list[Exchange]:
    """Return the pairs that were fitted with their presses exchanged, that with the largest gain first.

    Args:
        rays: at most one for each lamp and place.
        walk: prior of the walk under which `solution` was found.
        solution: of the fit of `rays`.
        room: of `solution`.
    """
    first = {ray.target: ray for ray in rays if ray.place == FIRST}
    second = {ray.target: ray for ray in rays if ray.place == SECOND}
    names = [name for name in first if name in second]
    if len(names) < 2:
        return []

    # Gains with the walk as it is
    misfits = _misfits([first[name] for name in names], [second[name] for name in names], room)
    own = np.diag(misfits)
    gains = own[:, None] + own[None, :] - misfits - misfits.T
    ranked: list[tuple[float, int, int]] = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            if gains[i, j] > MIN_RANKED_GAIN:
                ranked.append((float(gains[i, j]), i, j))
    ranked.sort(reverse=True)

    exchanges: list[Exchange] = []
    for _, i, j in ranked[:MAX_FITTED]:
        pair = (names[i], names[j])
        model = PacedModel(_exchanged(rays, pair), walk)
        exchanged = model.fit()
        gain = 2.0 * float(solution.cost - exchanged.cost)
        is_behind = any(target.reason for target in model.room(exchanged).targets.values())
        if not is_behind:
            exchanges.append(Exchange(pair, gain))
    return sorted(exchanges, key=lambda exchange: -exchange.gain)


def _exchanged(rays: Sequence[PacedRay], pair: tuple[str, str]) -> list[PacedRay]:
    """Return `rays` with the presses of a pair from the second place exchanged."""
    others = {pair[0]: pair[1], pair[1]: pair[0]}
    result: list[PacedRay] = []
    for ray in rays:
        target = ray.target
        if ray.place == SECOND:
            target = others.get(target, target)
        result.append(replace(ray, target=target))
    return result


def _misfits(first: Sequence[PacedRay], second: Sequence[PacedRay], room: PacedRoom) -> Array:
    """Return the least sum of squares of each ray from the first place with each from the second."""
    azimuths, slopes = _angles(first)
    second_azimuths, second_slopes = _angles(second)
    second_azimuths = second_azimuths - room.drift_rad
    x_m, y_m = room.places_m[1]

    # Axes: first rays, second rays, distances
    d = DISTANCES_M[None, None, :]
    azimuth = azimuths[:, None, None]
    x = d * np.cos(azimuth) - x_m
    y = d * np.sin(azimuth) - y_m
    second_d = np.maximum(np.hypot(x, y), 0.2)
    share = d / second_d
    azimuth_error = np.arctan2(y, x) - second_azimuths[None, :, None]
    azimuth_error = (azimuth_error + math.pi) % math.tau - math.pi
    heights = d * slopes[:, None, None]
    elevation_error = np.arctan2(heights, second_d) - np.arctan(second_slopes)[None, :, None]

    # A misfit is shared by both rays; the first one moves the lamp, as seen from the second, by `share`
    variance = PRESS_SIGMA_RAD**2 * (1.0 + share**2)
    usual = ((d - USUAL_M) / DISTANCE_SIGMA_M) ** 2
    total = (azimuth_error**2 + elevation_error**2) / variance + usual
    return np.asarray(total.min(axis=2))


def _angles(rays: Sequence[PacedRay]) -> tuple[Array, Array]:
    """Return the azimuths and the slopes (tangents of the elevation) of rays."""
    directions = np.array([ray.direction for ray in rays])
    x, y, z = directions.T
    return np.arctan2(y, x), z / np.maximum(np.hypot(x, y), 1e-3)
