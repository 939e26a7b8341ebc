"""Checks for probable mistakes in a readable map, and its summary: `pointit map check`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.floor_area import FloorArea
from pointit.maps.checks.finding import MapFinding, error, warning
from pointit.maps.checks.lines import check_belts, check_extent, check_lines, check_strips
from pointit.maps.checks.pacing import check_pacing, pacing_text
from pointit.maps.checks.things import check_lamps, check_things
from pointit.maps.environment import broken_references, lanes_of
from pointit.maps.file import MapError, read_clouds, to_message
from pointit.maps.model import FenceEntry, MapFile
from pointit.runtime.errors import ConfigError

Point = tuple[float, float]

THINNEST_M = 0.001
ROBOT_M = 0.5
"""Width below which a volume to stay in has hardly room for a robot."""

GRID = 48
"""Places along x and y at which a common area is looked for."""


def about_map(path: Path) -> str:
    """Return the first line of the file at `path` if it is a comment, without its end, or `""`."""
    with path.open(encoding="utf-8") as file:
        line = file.readline().strip()
    return line.lstrip("# ").rstrip(".:") if line.startswith("#") else ""


def contents(file: MapFile, clouds: Mapping[str, NDArray[np.float64]]) -> str:
    """Return a summary of a map, `8 belts, 8 links, 4 bays, 22 strips with 1228 pixels, 3 lamps`."""
    counts = (
        (len(file.belts), "belt", ""),
        (len(file.links), "link", ""),
        (len(file.bays), "bay", ""),
        (len(file.strips), "strip", _with(sum(strip.pixels for strip in file.strips.values()), "pixel")),
        (len(file.lamps), "lamp", ""),
        (len(file.boxes), "box", ""),
        (len(file.planes), "plane", ""),
        (len(file.cylinders), "cylinder", ""),
        (len(file.spheres), "sphere", ""),
        (len(clouds), "cloud", _with(sum(len(points) for points in clouds.values()), "point")),
        (len(file.fences), "fence", ""),
        (len(file.frames), "frame", ""),
        (len(file.things), "thing", ""),
    )
    counted = ", ".join(
        f"{count} {word}{'' if count == 1 else 'es' if word == 'box' else 's'}{more}"
        for count, word, more in counts
        if count
    )
    return "; ".join(filter(None, (counted, pacing_text(file))))


def _with(count: int, what: str) -> str:
    return f" with {count} {what}{'s' if count > 1 else ''}"


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
    is_home = any(thing.home_assistant for thing in file.things.values())
    found = [
        *wrong_units,
        *broken,
        *check_belts(file, lanes, links),
        *check_lines(file),
        *check_strips(file),
        *check_lamps(file.lamps, person_m, has_heights=not wrong_units, is_home=is_home),
        *_check_solids(file),
        *check_fences(file.fences),
        *check_things(file, clouds, [*((person_m,) if person_m else ()), *poses_m]),
        *check_pacing(file, [*((person_m,) if person_m else ()), *poses_m]),
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


def examined(
    name: str,
    path: Path,
    read: Callable[[], MapFile],
    person_m: Point | None = None,
    poses_m: Sequence[Point] = (),
) -> tuple[str, list[MapFinding]]:
    """Return a map's contents in words, `""` if it cannot be read, and findings on all readable sections.

    Args:
        name: name of the map, for findings without a section.
        path: its current or future path; its clouds lie beside it.
        read: returns the map, or raises `ConfigError`.
        person_m: position of the person. None: anywhere.
        poses_m: further positions from which people point at things.
    """
    has = ""
    try:
        file = read()
        clouds = read_clouds(path, file)
    except MapError as unreadable:
        return has, [error(where, text) for where, text in unreadable.mistakes]
    except ConfigError as unreadable:
        return has, [error(name, str(unreadable).removeprefix(f"{path}: "))]
    has = contents(file, clouds)
    findings = check_map(file, clouds, person_m=person_m, poses_m=poses_m)
    if not any(each.severity == "error" for each in findings):
        try:
            to_message(path, file, clouds, 0)
        except ConfigError as too_large:
            findings.append(error(name, str(too_large).removeprefix(f"{path}: ")))
    return has, findings
