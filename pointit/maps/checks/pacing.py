"""Accuracy of paced maps, which are made without measured lengths, by pointing from one place or two.

Such a map is wrong along the lines from its places to its things, by a share of their length, and in its
scale. Both cancel out in directions from these places and from between them, and grow with the distance from
there.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import MapFinding, warning
from pointit.maps.model import MapFile
from pointit.maps.things import broken_things, things_of
from pointit.schemas.environment import PacedPlace, Thing
from pointit.schemas.text import first_of

DEPTH_SHARE = 0.2
"""Standard deviation of a distance in a map from two places, as a share of it (`scan/paced.py`)."""
ONE_PLACE_SHARE = 0.5
"""The same from one place, where each distance is an assumption."""
PRESS_DEG = 2.5
"""Standard deviation of a direction as seen from one of the places, °."""
MAX_DIRECTION_DEG = 5.0
"""Standard deviation of a direction up to which people can point by it, °."""
NEAREST_M = 0.2
NAMED = 3
"""Number of things or places that are named."""
STEP_M = 0.1
FARTHEST_M = 5.0
BEARINGS = 16
"""Steps, maximum and number of directions in which the border of the covered floor is searched."""


def direction_sigma_deg(
    places_m: Sequence[tuple[float, float]], thing_m: Vec3, eyes_m: Sequence[float]
) -> float:
    """Return the standard deviation (°) of the direction to a thing at `thing_m` as seen from `eyes_m`.

    Args:
        places_m: places from which the map was paced, one or two. 0 is returned if there are none.
        thing_m: {W}.
        eyes_m: place of a person, {W}. Heights do not matter.
    """
    if not places_m:
        return 0.0
    origin = _nearest_between(places_m, np.array(eyes_m[:2]))
    line = np.array(thing_m[:2]) - origin
    sight = np.array(thing_m[:2]) - np.array(eyes_m[:2])
    length_m = float(np.linalg.norm(line))
    range_m = max(float(np.linalg.norm(sight)), NEAREST_M)
    share = DEPTH_SHARE if len(places_m) > 1 else ONE_PLACE_SHARE

    # An error along the line from the place is seen from the side by the sine of the angle between both
    line_x, line_y = line
    sight_x, sight_y = sight
    cross = abs(float(line_x * sight_y - line_y * sight_x))
    sine = cross / max(length_m, NEAREST_M) / range_m
    beside_m = share * length_m * sine
    return math.hypot(PRESS_DEG, math.degrees(math.atan2(beside_m, range_m)))


def uncovered_things(places: Sequence[PacedPlace], things: Sequence[Thing], x: float, y: float) -> list[int]:
    """Return the indices of `things` to which the map knows no direction as seen from (x, y)."""
    places_m = [place.position_m for place in places]
    if not places_m:
        return []
    uncovered: list[int] = []
    for index, thing in enumerate(things):
        if direction_sigma_deg(places_m, thing.center_m, (x, y)) > MAX_DIRECTION_DEG:
            uncovered.append(index)
    return uncovered


def covered_m(places_m: Sequence[tuple[float, float]], things: Sequence[Thing]) -> float:
    """Return the distance (m) from the places up to which directions to all things are good for pointing."""
    angles = np.arange(BEARINGS) * math.tau / BEARINGS
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    distance_m = 0.0
    while distance_m < FARTHEST_M:
        for place_m in places_m:
            for direction in around:
                eyes_m = np.array(place_m) + (distance_m + STEP_M) * direction
                for thing in things:
                    if direction_sigma_deg(places_m, thing.center_m, eyes_m.tolist()) > MAX_DIRECTION_DEG:
                        return distance_m
        distance_m += STEP_M
    return FARTHEST_M


def pacing_text(file: MapFile) -> str:
    """Return a clause on the accuracy of a paced map for its summary, or `""` if it is not paced."""
    if not file.paced_from:
        return ""
    places: list[str] = []
    for name, entry in file.paced_from.items():
        x, y = entry.position
        places.append(f"{name} ({x:g}, {y:g})")
    text = f"lengths are paced from {' and '.join(places)}"
    if not file.things or any(broken_things(file)):
        return text
    things = [thing for thing in things_of(file) if not thing.is_tracked]
    limit_m = covered_m([entry.position for entry in file.paced_from.values()], things)
    between = ", from between them" if len(places) > 1 else ""
    return f"{text}: directions are good from there{between}, and up to {limit_m:.1f} m around"


def check_pacing(file: MapFile, people_m: Sequence[tuple[float, float]]) -> Iterator[MapFinding]:
    """Yield the things of a paced map whose directions it does not know as seen from `people_m`."""
    if not file.paced_from or any(broken_things(file)):
        return
    things = [thing for thing in things_of(file) if not thing.is_tracked]
    places = [PacedPlace(id=name, position_m=entry.position) for name, entry in file.paced_from.items()]
    for x, y in people_m:
        uncovered = [things[index].id for index in uncovered_things(places, things, x, y)]
        if uncovered:
            text = f"directions to {first_of(uncovered, NAMED)} are not known from {x:g},{y:g}"
            yield warning("paced_from", f"{text}: pace a map from there")


def _nearest_between(places_m: Sequence[tuple[float, float]], point: np.ndarray) -> np.ndarray:
    """Return the point nearest to `point` on the line from the first to the last of `places_m`."""
    start = np.array(places_m[0])
    step = np.array(places_m[-1]) - start
    square = float(step @ step)
    share = 0.0
    if square != 0.0:
        share = float(np.clip((point - start) @ step / square, 0.0, 1.0))
    return start + share * step
