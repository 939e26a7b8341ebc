"""Checks of lamps: heights, positions twice, bearings that determine no position."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import MapFinding, error, warning
from pointit.maps.model import LampEntry

FLOOR_M = 0.0
HIGHEST_LAMP_M = 5.0
SAME_PLACE_M = 0.01
ONE_BEARING_M = 0.2
"""Width of a column of lamps that has the same bearing from everywhere, m."""
MIN_SPREAD_DEG = 5.0


def check_lamps(
    lamps: Mapping[str, LampEntry], person_m: tuple[float, float] | None, *, has_heights: bool = True
) -> Iterator[MapFinding]:
    """Yield problems of lamps, as seen from `person_m`, or from anywhere if it is None.

    Without `has_heights` heights are not compared with those of a room.
    """
    names = list(lamps)
    places = np.array([lamp.position for lamp in lamps.values()]).reshape(-1, 3)
    for name, z in zip(names, places[:, 2].tolist(), strict=True):
        if z < FLOOR_M:
            yield error(f"lamps.{name}", f"is {-z:g} m below the floor; correct its z")
        elif z > HIGHEST_LAMP_M and has_heights:
            yield warning(
                f"lamps.{name}",
                f"is {z:g} m high, where pointing is difficult; mount it below {HIGHEST_LAMP_M:g} m",
            )
    for index, other in _at_one_place(places):
        yield error(
            f"lamps.{names[index]}",
            f"is where {names[other]} is, {places[index].tolist()}; correct one of them",
        )
    if len(lamps) < 2:
        yield warning(
            "lamps",
            f"{'there is one lamp' if lamps else 'there are no lamps'} and localizing by pointing needs two; "
            "add lamps, or say where people stand",
        )
    elif _one_bearing([lamp.position for lamp in lamps.values()], person_m):
        seen = "one above the other" if person_m is None else f"in one direction from {list(person_m)}"
        yield error("lamps", f"all lie {seen}, which determines no position; move one of them aside")


def _at_one_place(places: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs of a lamp and an earlier one where it is, at most one a lamp."""
    distinct, first, inverse = np.unique(places, axis=0, return_index=True, return_inverse=True)
    earlier = first[inverse.reshape(-1)]
    found = {int(index): int(earlier[index]) for index in np.flatnonzero(earlier != np.arange(len(places)))}
    if len(distinct) > 1:
        nearest = KDTree(distinct).query(distinct, k=[2])  # the first one is the lamp itself
        away_m, near = (np.asarray(each).reshape(-1) for each in nearest)
        for row in np.flatnonzero(away_m < SAME_PLACE_M):
            pair = sorted((int(first[row]), int(first[int(near[row])])))
            found.setdefault(pair[1], pair[0])
    return sorted(found.items())


def _one_bearing(places: Sequence[Vec3], person_m: tuple[float, float] | None) -> bool:
    flat = np.array(places)[:, :2]
    if person_m is None:
        return bool(np.linalg.norm(flat - flat[0], axis=1).max() < ONE_BEARING_M)
    bearings = np.arctan2(*(flat - person_m).T[::-1])
    apart = np.degrees(np.abs(np.angle(np.exp(1j * (bearings - bearings[0])))))
    return bool(apart.max() < MIN_SPREAD_DEG)
