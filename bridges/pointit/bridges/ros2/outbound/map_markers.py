"""Markers of the static room: belts, strips, lamps, solids, things, fences; sent once per map."""

from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any

import numpy as np

from pointit.bridges.ros2.outbound.marker_builder import MarkerBuilder
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.geometry import rotation, vector
from pointit.geometry.plane import plane_axes
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment
from pointit.schemas.base import Rgb

MAX_MARKERS = 2000
"""Maximum number of markers of a map; a label says that there are more."""
MAX_VERTICES = 200
"""Maximum number of vertices of a line; longer ones are sampled evenly."""

ENDLESS_M = 20.0
"""Drawn size of an infinite plane."""
STRIP_M, LAMP_M, THIN_M = 0.02, 0.1, 0.005

BELT: Rgb = (70, 74, 84)
STRIP: Rgb = (150, 155, 165)
LAMP: Rgb = (255, 240, 200)
SOLID: Rgb = (140, 150, 170)
KEEP_IN: Rgb = (60, 180, 75)
KEEP_OUT: Rgb = (230, 60, 50)
GLASS = 0.35
"""Opacity of solids, so that objects behind them are visible."""


def map_markers(room: Environment, context: ConversionContext) -> Converted:
    """Return the map's markers, after one that deletes the previous map's."""
    markers = MarkerBuilder(context)
    drawn = _room(markers, context.state, room)
    made = [markers.blank(), *islice(drawn, MAX_MARKERS)]
    if next(drawn, None) is not None:
        words = f"the map has more than the {MAX_MARKERS} things that are drawn"
        made.append(markers.label(words, "more", 0, (0.0, 0.0, 2.8), 0.3))
    return (markers.array(made),)


def _room(markers: MarkerBuilder, state: ConversionState, room: Environment) -> Iterator[Any]:
    widths_m = {belt.id: belt.width_m for belt in room.belts}
    for number, ((kind, name), line) in enumerate(state.lines.items()):
        if kind == "belt":
            corners_m = ribbon(line, widths_m[name])
            one_m = (1.0, 1.0, 1.0)
            yield markers.shape("triangles", "belts", number, size_m=one_m, rgb=BELT, places_m=corners_m)
        else:
            size_m = (STRIP_M, 0.0, 0.0)
            yield markers.shape("line", "strips", number, size_m=size_m, rgb=STRIP, places_m=_vertices(line))
    for number, lamp in enumerate(room.lamps):
        size_m = (LAMP_M, LAMP_M, LAMP_M)
        yield markers.shape("sphere", "lamps", number, size_m=size_m, rgb=LAMP, at_m=lamp.position_m)
        above_m = vector.add(lamp.position_m, (0.0, 0.0, LAMP_M))
        yield markers.label(lamp.id, "lamps/names", number, above_m, 0.1)
    yield from _fences(markers, room)
    yield from _solids(markers, room)


def _fences(markers: MarkerBuilder, room: Environment) -> Iterator[Any]:
    """Yield the outlines of fences at their lowest and highest place; one without end at the floor only."""
    for number, fence in enumerate(room.fences):
        rgb = KEEP_IN if fence.kind == "keep_in" else KEEP_OUT
        heights_m = dict.fromkeys((fence.low_m or 0.0, fence.high_m or fence.low_m or 0.0))
        for level, height_m in enumerate(heights_m):
            corners_m = [(x, y, height_m) for x, y in (*fence.outline_m, fence.outline_m[0])]
            size_m = (STRIP_M, 0.0, 0.0)
            group = f"fences/{fence.kind}/{level}"
            yield markers.shape("line", group, number, size_m=size_m, rgb=rgb, places_m=corners_m)
        x, y = fence.outline_m[0]
        yield markers.label(fence.id, "fences/names", number, (x, y, max(heights_m) + LAMP_M), LAMP_M)


def _solids(markers: MarkerBuilder, room: Environment) -> Iterator[Any]:
    for number, box in enumerate((*room.boxes, *room.fixed_things)):
        turned = rotation.from_yaw(box.yaw_rad)
        yield markers.shape(
            *("cube", "boxes", number),
            size_m=box.size_m,
            rgb=SOLID,
            alpha=GLASS,
            at_m=box.center_m,
            turned=turned,
        )
    for number, thing in enumerate(room.fixed_things):
        above_m = vector.add(thing.center_m, (0.0, 0.0, thing.size_m[2] / 2.0 + LAMP_M))
        yield markers.label(thing.label or thing.id, "things/names", number, above_m, LAMP_M)
    for number, plane in enumerate(room.planes):
        u, v = plane_axes(plane.normal)
        wide_m, high_m = plane.size_m or (ENDLESS_M, ENDLESS_M)
        turned = _of_axes(u, v)
        size_m = (wide_m, high_m, THIN_M)
        yield markers.shape(
            *("cube", "planes", number),
            size_m=size_m,
            rgb=SOLID,
            alpha=GLASS,
            at_m=plane.center_m,
            turned=turned,
        )
    for number, each in enumerate(room.cylinders):
        size_m = (2.0 * each.radius_m, 2.0 * each.radius_m, each.height_m)
        middle_m = vector.add(each.center_m, (0.0, 0.0, each.height_m / 2.0))
        yield markers.shape(
            "cylinder", "cylinders", number, size_m=size_m, rgb=SOLID, alpha=GLASS, at_m=middle_m
        )
    for number, ball in enumerate(room.spheres):
        wide_m = 2.0 * ball.radius_m
        size_m = (wide_m, wide_m, wide_m)
        yield markers.shape(
            "sphere", "spheres", number, size_m=size_m, rgb=SOLID, alpha=GLASS, at_m=ball.center_m
        )
    for number, cloud in enumerate(room.clouds):
        size_m = vector.subtract(cloud.high_m, cloud.low_m)
        middle_m = vector.scale(vector.add(cloud.low_m, cloud.high_m), 0.5)
        yield markers.shape("cube", "clouds", number, size_m=size_m, rgb=SOLID, alpha=0.1, at_m=middle_m)


def ribbon(line: Polyline, width_m: float) -> list[Vec3]:
    """Return triangles, three corners each, of a level ribbon along `line`, visible from above and below."""
    vertices_m = _vertices(line)
    corners_m: list[Vec3] = []
    for start_m, end_m in pairwise(vertices_m):
        way = vector.subtract(end_m, start_m)
        level_m = float(np.hypot(way[0], way[1]))
        if level_m == 0.0:
            continue
        half = width_m / 2.0 / level_m
        across_m = (-way[1] * half, way[0] * half, 0.0)
        a, b = vector.add(start_m, across_m), vector.subtract(start_m, across_m)
        c, d = vector.add(end_m, across_m), vector.subtract(end_m, across_m)
        corners_m += [a, b, c, c, b, d, a, c, b, c, d, b]
    return corners_m


def _vertices(line: Polyline) -> list[Vec3]:
    count = len(line.vertices_m)
    kept = np.unique(np.linspace(0, count - 1, min(count, MAX_VERTICES)).round().astype(int))
    return [(x, y, z) for x, y, z in line.vertices_m[kept].tolist()]


def _of_axes(u: Vec3, v: Vec3) -> rotation.Quaternion:
    """Return the rotation whose x and y axes are `u` and `v`, orthonormal."""
    azimuth, elevation = vector.azimuth(u), vector.elevation(u)
    level = rotation.from_azimuth_elevation(azimuth, elevation)
    across, up = rotation.rotate(level, (0.0, 1.0, 0.0)), rotation.rotate(level, (0.0, 0.0, 1.0))
    roll = float(np.arctan2(vector.dot(v, up), vector.dot(v, across)))
    return rotation.from_azimuth_elevation(azimuth, elevation, roll)
