"""Draws belts, strips, links and bays from above."""

import math
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.maps.picture.palette import ARROW, BAY, BELT, BELT_EDGE, INK, LINK, ON_TOP, STRIP, Axes
from pointit.schemas import Environment
from pointit.schemas.environment import Belt, Strip

ARROWS_ACROSS = 14
"""Number of direction arrows that fit into the map's longer side."""
LETTER = 0.0075
"""Width of a letter of a belt's name, as a share of the longer side."""


def draw_belts(axes: Axes, room: Environment, side_m: float) -> list[Any]:
    """Draw the belts of a map that is `side_m` long. Return their entries of the legend."""
    for belt in room.belts:
        line = Polyline(belt.line_m)
        left, right = beside(line, belt.width_m / 2), beside(line, -belt.width_m / 2)
        outline = np.vstack([left, right[::-1]])
        axes.add_patch(Polygon(outline, facecolor=BELT, edgecolor=BELT_EDGE, linewidth=0.8, zorder=2))
        name_at, arrows_at = _spaced(line.length_m, side_m / ARROWS_ACROSS, len(belt.id) * side_m * LETTER)
        _label_along(axes, line, name_at, belt.id, INK, fontweight="bold", fontsize=8)
        for at in arrows_at:
            _draw_chevron(axes, line, at, 0.22 * belt.width_m)
    patch = Patch(facecolor=BELT, edgecolor=BELT_EDGE, label="belt, arrows: where it moves")
    return [patch] if room.belts else []


def draw_strips(axes: Axes, room: Environment) -> list[Any]:
    """Draw the strips. Return their entries of the legend."""
    for strip in room.strips:
        line = Polyline(strip.line_m)
        axes.plot(*line.vertices_m[:, :2].T, color=STRIP, lw=2.2, solid_capstyle="butt", zorder=4)
        first = line.vertices_m[0 if strip.direction == 1 else -1]
        axes.plot(first[0], first[1], "o", ms=4.5, mfc="white", mec=STRIP, mew=1.3, zorder=5)
        _label_along(axes, line, line.length_m / 2, strip.id, STRIP, fontsize=7)
    if not room.strips:
        return []
    return [
        Line2D([], [], color=STRIP, lw=2.2, label="strip"),
        Line2D([], [], marker="o", ls="", ms=4.5, mfc="white", mec=STRIP, mew=1.3, label="its pixel 0"),
    ]


def draw_links(axes: Axes, room: Environment) -> list[Any]:
    """Draw the links. Return their entries of the legend."""
    lines = _lanes(room)
    for link in room.links:
        source, target = lines[link.source], lines[link.target]
        leaves = source.length_m if link.source_position_m is None else link.source_position_m
        start, end = source.point_at(leaves)[:2], target.point_at(link.target_position_m)[:2]
        axes.plot(*start, "o", ms=3, color=LINK, zorder=6)
        if math.dist(start, end) < 0.05:
            continue  # an arrow would be shorter than its head
        look: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 9, "shrinkA": 0, "shrinkB": 0}
        axes.add_patch(FancyArrowPatch(start, end, color=LINK, lw=1.4, zorder=6, **look))
    return [Line2D([], [], color=LINK, lw=1.4, marker=">", ms=4, label="link")] if room.links else []


def draw_bays(axes: Axes, room: Environment) -> list[Any]:
    """Draw the bays. Return their entries of the legend."""
    lines = _lanes(room)
    for bay in room.bays:
        line = lines[bay.belt]
        dx, dy, _ = line.tangent_at(line.length_m)
        side = "left" if dx > 0 else "right"
        level = abs(dx) > abs(dy)
        axes.annotate(
            f"bay {bay.id}", line.point_at(line.length_m)[:2], xytext=(9 * dx, 9 * dy),
            textcoords="offset points", color="white", fontsize=8, fontweight="bold",
            ha=side if level else "center", va="center" if level else ("bottom" if dy > 0 else "top"),
            bbox={"boxstyle": "round,pad=0.25", "facecolor": BAY, "edgecolor": "white"}, zorder=8,
        )  # fmt: skip
    return [Patch(facecolor=BAY, label="bay, where things leave")] if room.bays else []


def beside(line: Polyline, offset_m: float) -> NDArray[np.float64]:
    """Return the vertices of `line`, moved to its left by `offset_m` as seen from above, n x 2."""
    flat = line.tangents[:, :2]
    normals = np.column_stack([-flat[:, 1], flat[:, 0]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    ends = np.vstack([normals[:1], normals]), np.vstack([normals, normals[-1:]])
    mitre = ends[0] + ends[1]
    mitre /= np.maximum(np.einsum("ij,ij->i", mitre, ends[0])[:, None], 0.5)
    moved: NDArray[np.float64] = line.vertices_m[:, :2] + offset_m * mitre
    return moved


def _lanes(room: Environment) -> dict[str, Polyline]:
    lanes: tuple[Belt | Strip, ...] = room.belts or room.strips
    return {lane.id: Polyline(lane.line_m) for lane in lanes}


def _spaced(length_m: float, step_m: float, name_m: float) -> tuple[float, list[float]]:
    """Return the positions of a belt's name and of its arrows, about `step_m` apart beside the name."""
    half = length_m / 2
    count = max(2, 2 * round(half / step_m))  # even: the name is in the middle
    places = [(index + 0.5) * length_m / count for index in range(count)]
    free = [place for place in places if abs(place - half) > name_m / 2 + step_m / 8]
    return (half, free) if free else (0.4 * length_m, [0.86 * length_m])


def _draw_chevron(axes: Axes, line: Polyline, at_m: float, size_m: float) -> None:
    place, along = np.array(line.point_at(at_m)[:2]), np.array(line.tangent_at(at_m)[:2])
    across = 1.1 * np.array([along[1], -along[0]])
    tips = np.array([across - along / 2, along / 2, -across - along / 2])
    axes.plot(*(place + size_m * tips).T, color=ARROW, lw=1.3, zorder=3)


def _label_along(axes: Axes, line: Polyline, at_m: float, text: str, color: str, **look: Any) -> None:
    """Write `text` along `line`, never upside down."""
    x, y, _ = line.point_at(at_m)
    dx, dy, _ = line.tangent_at(at_m)
    angle = (math.degrees(math.atan2(dy, dx)) + 89.0) % 180.0 - 89.0
    axes.text(
        x, y, text, color=color, rotation=angle, rotation_mode="anchor", ha="center", va="center",
        **ON_TOP, **look,
    )  # fmt: skip
