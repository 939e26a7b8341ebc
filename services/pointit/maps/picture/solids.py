"""Draws boxes, planes, cylinders and spheres from above."""

import math
from typing import Any

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

from pointit.geometry.plane import plane_axes
from pointit.geometry.vector import Vec3, scale
from pointit.maps.picture.palette import ON_TOP, SOLID, SOLID_FILL, Axes
from pointit.schemas import Environment, Thing
from pointit.schemas.environment import Box, Cylinder, Plane, Sphere

_FILL: dict[str, Any] = {"facecolor": SOLID_FILL, "edgecolor": SOLID, "linewidth": 1.1, "zorder": 1.8}
LEVEL = 0.999
"""Vertical component of the normal above which a plane is drawn as a floor, everywhere if unbounded."""


MAX_NAMED = 200
"""Number of solids up to which names are drawn. More would overlap, and each takes 3 ms."""


def draw_solids(axes: Axes, room: Environment) -> list[Any]:
    """Draw the solids of `room`. Return their entries of the legend."""
    boxes: tuple[Box, ...] = (*room.boxes, *room.fixed_things)
    solids = len(boxes) + len(room.planes) + len(room.cylinders) + len(room.spheres)
    is_named = solids <= MAX_NAMED
    patches: list[Patch] = []
    for box in boxes:
        c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(box.size_m[:2]) / 2
        outline = corners @ np.array([[c, s], [-s, c]]) + np.array(box.center_m[:2])
        patches.append(Polygon(outline, **_FILL))
    patches += [Circle(each.center_m[:2], each.radius_m, **_FILL) for each in room.cylinders]
    dashed: dict[str, Any] = {**_FILL, "linestyle": (0, (3, 2))}
    patches += [Circle(each.center_m[:2], each.radius_m, **dashed) for each in room.spheres]
    for plane in room.planes:
        _draw_plane(axes, plane, patches, is_named=is_named)
    axes.add_collection(PatchCollection(patches, match_original=True, zorder=_FILL["zorder"]))
    legend: list[Any] = []
    if is_named:
        named: tuple[Box | Cylinder | Sphere, ...] = (*boxes, *room.cylinders, *room.spheres)
        for each in named:
            _name(axes, (isinstance(each, Thing) and each.label) or each.id, each.center_m)
    else:
        legend.append(Line2D([], [], ls="", label=f"{solids} solids, names left out"))
    if solids:
        legend.append(
            Patch(facecolor=SOLID_FILL, edgecolor=SOLID, label="box, thing, plane, cylinder; sphere dashed")
        )
    floors = [plane.id for plane in room.planes if plane.size_m is None and abs(plane.normal[2]) >= LEVEL]
    legend += [Line2D([], [], ls="", label=f"{name}: level, without end") for name in floors]
    return legend


def _draw_plane(axes: Axes, plane: Plane, patches: list[Patch], *, is_named: bool) -> None:
    x, y, _ = plane.center_m
    if plane.size_m is None:
        nx, ny, nz = plane.normal
        if abs(nz) < LEVEL:  # a level plane is everywhere
            axes.axline((x, y), (x - ny, y + nx), color=SOLID, lw=1.3, ls=(0, (6, 2)), zorder=1.8)
            if is_named:
                _name(axes, f"{plane.id} (without end)", plane.center_m)
        return
    u, v = plane_axes(plane.normal)
    half_u, half_v = scale(u, plane.size_m[0] / 2), scale(v, plane.size_m[1] / 2)
    corners = [
        (x + a * half_u[0] + b * half_v[0], y + a * half_u[1] + b * half_v[1])
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    look: dict[str, Any] = {**_FILL, "linewidth": 2.0}
    patches.append(Polygon(corners, **look))
    if is_named:
        _name(axes, plane.id, plane.center_m)


def _name(axes: Axes, text: str, center_m: Vec3) -> None:
    axes.text(*center_m[:2], text, color=SOLID, fontsize=7.5, ha="center", va="center", **ON_TOP)
