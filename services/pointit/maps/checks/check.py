"""Checks for probable mistakes in a readable map: `pointit map check`."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.floor_area import FloorArea
from pointit.maps.checks.belts import check_belts
from pointit.maps.checks.extent import check_extent
from pointit.maps.checks.finding import MapFinding, error, warning
from pointit.maps.checks.lamps import check_lamps
from pointit.maps.checks.strips import check_lines, check_strips
from pointit.maps.checks.things import check_things
from pointit.maps.lanes import broken_references, lanes_of
from pointit.maps.model import FenceEntry, MapFile

THINNEST_M = 0.001

Point = tuple[float, float]

ROBOT_M = 0.5
"""Width below which a volume to stay in has hardly room for a robot."""

GRID = 48
"""Places along x and y at which a common area is looked for."""


def check_map(
    file: MapFile,
    clouds: Mapping[str, NDArray[np.float64]],
    *,
    person_m: Point | None = None,
    poses_m: Sequence[Point] = (),
) -> list[MapFinding]:
    """Return the findings, errors first; `clouds` are in {W}, n x 3; a person may stand anywhere if None.

    Things are also compared as seen from `poses_m`.
    """
    broken = [error(where, text) for where, text in broken_references(file)]
    lanes = lanes_of(file)
    links = [
        (index, link)
        for index, link in enumerate(file.links)
        if link.source in lanes and link.target in lanes
    ]
    wrong_units = list(check_extent(file, clouds))
    found = [
        *wrong_units,
        *broken,
        *check_belts(file, lanes, links),
        *check_lines(file),
        *check_strips(file),
        *check_lamps(file.lamps, person_m, has_heights=not wrong_units),
        *_check_solids(file),
        *_check_clouds(clouds),
        *check_fences(file.fences),
        *check_things(file, clouds, [*((person_m,) if person_m else ()), *poses_m]),
        *_check_duplicates(file),
    ]
    return sorted(found, key=lambda each: each.severity)


def _check_solids(file: MapFile) -> Iterator[MapFinding]:
    sizes = {
        **{f"boxes.{name}": box.size for name, box in file.boxes.items()},
        **{f"things.{name}": thing.size for name, thing in file.things.items() if thing.size},
        **{f"planes.{name}": plane.size for name, plane in file.planes.items() if plane.size},
        **{f"cylinders.{name}": (each.radius, each.height) for name, each in file.cylinders.items()},
        **{f"spheres.{name}": (each.radius,) for name, each in file.spheres.items()},
    }
    for where, measures in sizes.items():
        if min(measures) < THINNEST_M:
            yield error(
                where, f"is {min(measures):g} m small, too little to point at; give its size in metres"
            )


def _check_clouds(clouds: Mapping[str, NDArray[np.float64]]) -> Iterator[MapFinding]:
    for name, points in clouds.items():
        extent = float(np.ptp(points, axis=0).max())
        if len(points) > 1 and extent < THINNEST_M:
            yield error(
                f"clouds.{name}", f"all its {len(points)} points are at one place; correct scale, or the file"
            )


def _check_duplicates(file: MapFile) -> Iterator[MapFinding]:
    yield from _duplicates("strips", {name: strip.line for name, strip in file.strips.items()})
    yield from _duplicates("belts", {name: belt.centerline for name, belt in file.belts.items()})
    for section in ("boxes", "planes", "cylinders", "spheres", "clouds", "fences"):
        yield from _duplicates(section, getattr(file, section))


def _duplicates(section: str, entries: Mapping[str, object]) -> Iterator[MapFinding]:
    seen: dict[str, str] = {}
    for name, entry in entries.items():
        place = repr(entry)
        if place in seen:
            yield warning(f"{section}.{name}", f"is exactly where {seen[place]} is; remove it, or correct it")
        seen.setdefault(place, name)


def check_fences(fences: Mapping[str, FenceEntry]) -> Iterator[MapFinding]:
    """Yield volumes that hold no robot, alone or together."""
    inside = {name: each for name, each in fences.items() if each.kind == "keep_in"}
    for name, each in inside.items():
        xs, ys = zip(*each.outline, strict=True)
        shorter_side = min(max(xs) - min(xs), max(ys) - min(ys))
        if shorter_side < ROBOT_M:
            yield warning(
                f"fences.{name}",
                f"is {shorter_side:g} m wide, and robots stay inside; give its corners in metres",
            )
        if each.high is not None and each.high <= 0.0:
            yield error(f"fences.{name}", f"ends at {each.high:g} m, not above the floor; raise high")
    if inside and len(fences) > 1 and not _have_room(fences):
        yield error(
            "fences." + ", ".join(inside),
            "leave no place for a robot: it stays inside every keep_in and outside every keep_out; "
            "correct one",
        )


def _have_room(fences: Mapping[str, FenceEntry]) -> bool:
    """Return True if a point is found inside every `keep_in` and outside every `keep_out`."""
    inside = [each for each in fences.values() if each.kind == "keep_in"]
    low_z = max(_or(each.low, -np.inf) for each in inside)
    high_z = min(_or(each.high, np.inf) for each in inside)
    low = np.max([np.min(each.outline, axis=0) for each in inside], axis=0)
    high = np.min([np.max(each.outline, axis=0) for each in inside], axis=0)
    if low_z >= high_z or np.any(low >= high):
        return False
    outlines = {name: FloorArea(each.outline) for name, each in fences.items()}
    steps = (np.arange(GRID) + 0.5) / GRID
    for x in low[0] + steps * (high[0] - low[0]):
        for y in low[1] + steps * (high[1] - low[1]):
            place = (float(x), float(y))
            closed: list[tuple[float, float]] = []
            for name, each in fences.items():
                if outlines[name].contains(place) == (each.kind == "keep_out"):
                    if each.kind == "keep_in":
                        break
                    closed.append((_or(each.low, -np.inf), _or(each.high, np.inf)))
            else:
                if _has_gap(low_z, high_z, closed):
                    return True
    return False


def _or(height: float | None, otherwise: float) -> float:
    return otherwise if height is None else height


def _has_gap(low: float, high: float, closed: list[tuple[float, float]]) -> bool:
    """Return True if the intervals of heights `closed` leave some of that from `low` to `high`."""
    for start, end in sorted(closed):
        if start > low:
            return True
        low = max(low, end)
    return low < high
