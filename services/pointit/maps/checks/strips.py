"""Checks of strips, and of lines in general."""

import statistics
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pointit.geometry.polyline import SAME_M, Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import MapFinding, warning
from pointit.maps.lanes import Lane, lanes_of
from pointit.maps.light_files.wire import shared_pixels
from pointit.maps.model import MapFile, StripEntry
from pointit.schemas.environment import BESIDE_BELT_M

DENSITY_SPREAD = 0.2
LENGTH_SPREAD = 0.01
LENGTH_M = 0.01
SHARPEST_DEG = 120.0
FEW_PIXELS = 5
"""Number of pixels below which their density says nothing."""
TRACED = 0.2
"""Number of vertices a pixel above which a line follows the pixels, and means its sharp turns."""
SAMPLES = 50
OFF_SHARE = 0.1
"""Share of a strip that may lie beyond its belt's end."""


def check_strips(file: MapFile) -> Iterator[MapFinding]:
    """Yield problems of strips: beside no belt, too many pixels or too few."""
    lines = {name: Polyline(strip.line) for name, strip in file.strips.items()}
    if file.belts:
        lanes = lanes_of(file)
        for name, line in lines.items():
            yield from _check_beside(name, line, lanes)
    for name, other in shared_pixels(file.strips):
        yield warning(
            f"strips.{name}",
            f"has pixels of the wire that {other} has, too; correct an offset, or give each its own output",
        )
    densities = {
        name: strip.pixels / lines[name].length_m for name, strip in file.strips.items() if is_even(strip)
    }
    if len(densities) < 2:
        return
    median = statistics.median(densities.values())
    for name, density in densities.items():
        if abs(density / median - 1.0) > DENSITY_SPREAD:
            length = lines[name].length_m
            yield warning(
                f"strips.{name}",
                f"{file.strips[name].pixels} pixels on {length:.2f} m are {density:.1f} a metre and the "
                f"strips' median is {median:.1f}; correct pixels (to about {max(1, round(median * length))}) "
                "or the line, unless it is another kind of strip",
            )


def is_even(strip: StripEntry) -> bool:
    """Return True if the pixels per metre mean something: the strip is long enough and makes no detours.

    A line through pixels of another program makes a detour where they are irregular, as the wire does.
    """
    return strip.pixels >= FEW_PIXELS and not has_detours(strip)


def has_detours(strip: StripEntry) -> bool:
    """Return True if its line turns back between pixels, as one through irregular pixels does."""
    return len(strip.line) > TRACED * strip.pixels and bool(_sharp_turns(strip.line))


def check_lines(file: MapFile) -> Iterator[MapFinding]:
    """Yield problems of lines: a wrong `length`, vertices twice or out of order."""
    for name, strip in file.strips.items():
        yield from _check_line(f"strips.{name}", strip.line, strip.length, is_winding=has_detours(strip))
    for name, belt in file.belts.items():
        yield from _check_line(f"belts.{name}", belt.centerline, belt.length)


def _check_beside(name: str, line: Polyline, lanes: Mapping[str, Lane]) -> Iterator[MapFinding]:
    places = line.points_at(np.linspace(0.0, line.length_m, SAMPLES))
    beyond = {belt: lane.line.nearest_to(places)[1] - lane.width_m / 2 for belt, lane in lanes.items()}
    off = np.min(list(beyond.values()), axis=0) > BESIDE_BELT_M
    share = float(off.mean())
    if share <= OFF_SHARE:
        return
    nearest = min(beyond, key=lambda belt: float(beyond[belt].mean()))
    how_much = "lies" if share == 1.0 else f"{share:.0%} of it lies"
    far = float(beyond[nearest].max())
    yield warning(
        f"strips.{name}",
        f"{how_much} beside no belt, its pixels are up to {far:.2f} m from the edge of {nearest}; "
        f"correct its line (a strip shows what is on belts up to {BESIDE_BELT_M:g} m beside it)",
    )


def _check_line(
    where: str, vertices: Sequence[Vec3], given: float | None, *, is_winding: bool = False
) -> Iterator[MapFinding]:
    length = Polyline(vertices).length_m
    if given is not None and abs(given - length) > max(LENGTH_M, LENGTH_SPREAD * length):
        yield warning(
            where, f"length is given as {given:g} m and the line is {length:.3f} m long; correct one of them"
        )
    lengths = np.linalg.norm(np.diff(np.array(vertices), axis=0), axis=1)
    for index in np.flatnonzero(lengths <= SAME_M).tolist():
        yield warning(
            where, f"vertex {index + 1} is where vertex {index} is, {list(vertices[index])}; remove it"
        )
    for vertex, turn in [] if is_winding else _sharp_turns(vertices):
        yield warning(
            where, f"turns by {turn:.0f}° at vertex {vertex}, {list(vertices[vertex])}; put vertices in order"
        )


def _sharp_turns(vertices: Sequence[Vec3]) -> list[tuple[int, float]]:
    """Return index and angle (degrees) of the vertices where a line turns by more than `SHARPEST_DEG`."""
    steps = np.diff(np.array(vertices), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    distinct = lengths > SAME_M
    at, steps = np.flatnonzero(distinct), steps[distinct] / lengths[distinct, None]
    turns = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", steps[:-1], steps[1:]), -1.0, 1.0)))
    return [(int(at[1 + index]), float(turns[index])) for index in np.flatnonzero(turns > SHARPEST_DEG)]
