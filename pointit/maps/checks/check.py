"""Checks for probable mistakes in a readable map, and its summary: `pointit map check`."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
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
from pointit.maps.model import FenceEntry, LinkEntry, MapFile
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
    pixels = sum(strip.pixels for strip in file.strips.values())
    points = sum(len(cloud) for cloud in clouds.values())
    parts_of = {"strip": _counted(pixels, "pixel"), "cloud": _counted(points, "point")}
    sections: dict[str, Sized] = {
        "belt": file.belts,
        "link": file.links,
        "bay": file.bays,
        "strip": file.strips,
        "lamp": file.lamps,
        "box": file.boxes,
        "plane": file.planes,
        "cylinder": file.cylinders,
        "sphere": file.spheres,
        "cloud": clouds,
        "fence": file.fences,
        "frame": file.frames,
        "thing": file.things,
    }
    counts: list[str] = []
    for word, section in sections.items():
        if not section:
            continue
        count = _counted(len(section), word)
        if word in parts_of:
            count += f" with {parts_of[word]}"
        counts.append(count)
    summary = ", ".join(counts)
    return "; ".join(filter(None, (summary, pacing_text(file))))


def _counted(count: int, word: str) -> str:
    """Return `count` of what `word` means, as in `2 boxes`."""
    plural = "es" if word == "box" else "s"
    ending = "" if count == 1 else plural
    return f"{count} {word}{ending}"


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

    # Links to lanes that do not exist are reported as broken, and are of no use for the other checks
    lanes = lanes_of(file)
    links: list[tuple[int, LinkEntry]] = []
    for index, link in enumerate(file.links):
        if link.source in lanes and link.target in lanes:
            links.append((index, link))
    places_m = list(poses_m)
    if person_m:
        places_m.insert(0, person_m)

    # A wrong unit makes heights of lamps wrong, too, which needs no finding of its own
    wrong_units = list(check_extent(file, clouds))
    is_home = any(thing.home_assistant for thing in file.things.values())
    findings = [
        *wrong_units,
        *broken,
        *check_belts(file, lanes, links),
        *check_lines(file),
        *check_strips(file),
        *check_lamps(file.lamps, person_m, has_heights=not wrong_units, is_home=is_home),
        *_check_solids(file),
        *check_fences(file.fences),
        *check_things(file, clouds, places_m),
        *check_pacing(file, places_m),
        *_check_duplicates(file),
    ]
    return sorted(findings, key=lambda finding: finding.severity)


def _check_solids(file: MapFile) -> Iterator[MapFinding]:
    """Yield solids and things that are too thin to point at."""
    sizes: dict[str, tuple[float, ...]] = {}
    for name, box in file.boxes.items():
        sizes[f"boxes.{name}"] = box.size
    for name, thing in file.things.items():
        if thing.size:
            sizes[f"things.{name}"] = thing.size
    for name, plane in file.planes.items():
        if plane.size:
            sizes[f"planes.{name}"] = plane.size
    for name, cylinder in file.cylinders.items():
        sizes[f"cylinders.{name}"] = (cylinder.radius, cylinder.height)
    for name, sphere in file.spheres.items():
        sizes[f"spheres.{name}"] = (sphere.radius,)
    for where, measures in sizes.items():
        if min(measures) < THINNEST_M:
            yield error(
                where, f"is {min(measures):g} m small, too little to point at; give its size in metres"
            )


def _check_duplicates(file: MapFile) -> Iterator[MapFinding]:
    strip_lines = {name: strip.line for name, strip in file.strips.items()}
    belt_lines = {name: belt.centerline for name, belt in file.belts.items()}
    yield from _duplicates("strips", strip_lines)
    yield from _duplicates("belts", belt_lines)
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
    keep_in = {name: fence for name, fence in fences.items() if fence.kind == "keep_in"}
    for name, fence in keep_in.items():
        shorter_side = float(np.ptp(fence.outline, axis=0).min())
        if shorter_side < ROBOT_M:
            yield warning(
                f"fences.{name}",
                f"is {shorter_side:g} m wide, and robots stay inside; give its corners in metres",
            )
        if fence.high is not None and fence.high <= 0.0:
            yield error(f"fences.{name}", f"ends at {fence.high:g} m, not above the floor; raise high")
    has_several = bool(keep_in) and len(fences) > 1
    if has_several and not _have_room(fences):
        yield error(
            "fences." + ", ".join(keep_in),
            "leave no place for a robot: it stays inside every keep_in and outside every keep_out; "
            "correct one",
        )


def _have_room(fences: Mapping[str, FenceEntry]) -> bool:
    """Return True if a point is found inside every `keep_in` and outside every `keep_out`."""
    # Box in which every `keep_in` may have room
    keep_in = [fence for fence in fences.values() if fence.kind == "keep_in"]
    heights = [_heights_m(fence) for fence in keep_in]
    low_z = max(low for low, _ in heights)
    high_z = min(high for _, high in heights)
    lows = [np.min(fence.outline, axis=0) for fence in keep_in]
    highs = [np.max(fence.outline, axis=0) for fence in keep_in]
    low = np.max(lows, axis=0)
    high = np.min(highs, axis=0)
    if low_z >= high_z or np.any(low >= high):
        return False

    # A grid of it, each place with the heights that `keep_out` leaves
    areas = [(FloorArea(fence.outline), fence) for fence in fences.values()]
    steps = (np.arange(GRID) + 0.5) / GRID
    for x in low[0] + steps * (high[0] - low[0]):
        for y in low[1] + steps * (high[1] - low[1]):
            closed = _closed_heights(areas, (float(x), float(y)))
            if closed is not None and _has_gap(low_z, high_z, closed):
                return True
    return False


def _closed_heights(
    areas: Sequence[tuple[FloorArea, FenceEntry]], place_m: Point
) -> list[tuple[float, float]] | None:
    """Return the heights that `keep_out` closes at a place, None if a `keep_in` is not there."""
    closed: list[tuple[float, float]] = []
    for area, fence in areas:
        is_inside = area.contains(place_m)
        if fence.kind == "keep_in" and not is_inside:
            return None
        if fence.kind == "keep_out" and is_inside:
            closed.append(_heights_m(fence))
    return closed


def _heights_m(fence: FenceEntry) -> tuple[float, float]:
    """Return the lowest and the highest point of a fence, infinite where it has no end."""
    low = -math.inf if fence.low is None else fence.low
    high = math.inf if fence.high is None else fence.high
    return low, high


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
    try:
        file = read()
        clouds = read_clouds(path, file)
    except MapError as unreadable:
        return "", [error(where, text) for where, text in unreadable.mistakes]
    except ConfigError as unreadable:
        return "", [error(name, str(unreadable).removeprefix(f"{path}: "))]
    summary = contents(file, clouds)
    findings = check_map(file, clouds, person_m=person_m, poses_m=poses_m)

    # Only a map without errors has a message, which may be too large
    if not any(finding.severity == "error" for finding in findings):
        try:
            to_message(path, file, clouds, 0)
        except ConfigError as too_large:
            findings.append(error(name, str(too_large).removeprefix(f"{path}: ")))
    return summary, findings
