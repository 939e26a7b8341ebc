"""Picture of a map from above: to scale, on white, in colours distinguishable for colour-blind people."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.font_manager
import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Patch, Polygon
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import plane_axes
from pointit.geometry.vector import Vec3, scale
from pointit.maps.floor import extent, floor_edges
from pointit.runtime.host.state_file import replaced_file
from pointit.schemas import Environment, Thing
from pointit.schemas.environment import Belt, Box, Cylinder, Fence, Plane, Sphere, Strip

Axes = Any
"""Matplotlib's axes. Its stubs leave the types of keywords open, which strict checkers reject."""

BELT = "#e3e6ea"
BELT_EDGE = "#a4abb5"
ARROW = "#7c8591"
INK = "#2b2f36"
STRIP = "#0072b2"
LAMP = "#e69f00"
LINK = "#d55e00"
BAY = "#009e73"
CLOUD = "#56b4e9"
SOLID = "#8a4a77"
"""The palette's purple, darker for lines and text."""
SOLID_FILL = "#cc79a733"
"""The same for surfaces."""

KEEP_IN = "#009e73"
KEEP_OUT = "#d55e00"

HALO: list[Any] = [withStroke(linewidth=2.5, foreground="white")]
ON_TOP: dict[str, Any] = {"path_effects": HALO, "zorder": 9}
"""Properties of text."""


font_manager: Any = matplotlib.font_manager
"""Its types are partly unknown."""
FALLBACKS = (
    *("Noto Sans CJK JP", "Noto Sans CJK SC", "Droid Sans Fallback", "WenQuanYi Zen Hei", "Hiragino Sans"),
    *("PingFang SC", "Microsoft YaHei", "Malgun Gothic", "Noto Sans Arabic", "Noto Sans Devanagari"),
)
"""Families that are used, where they are installed, for letters that the usual one lacks."""

ARROWS_ACROSS = 14
"""Number of direction arrows that fit into the map's longer side."""
LETTER = 0.0075
"""Width of a letter of a belt's name, as a share of the longer side."""

_FILL: dict[str, Any] = {"facecolor": SOLID_FILL, "edgecolor": SOLID, "linewidth": 1.1, "zorder": 1.8}
LEVEL = 0.999
"""Vertical component of the normal above which a plane is drawn as a floor, everywhere if unbounded."""

MAX_NAMED = 200
"""Number of solids up to which names are drawn. More would overlap, and each takes 3 ms."""

MAX_CLOUD_POINTS = 20_000

WIDEST_IN = 10.5
TALLEST_IN = 8.5

DPI = 150

_STYLE: dict[str, Any] = {
    "font.size": 8.5,
    "svg.hashsalt": "pointit",
    "text.parse_math": False,  # names and labels are no formulas
    "axes.edgecolor": "#8a919b",
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}

_LOOKS: dict[str, dict[str, Any]] = {
    "keep_in": {"facecolor": "none", "edgecolor": KEEP_IN, "linewidth": 1.6, "linestyle": (0, (6, 2))},
    "keep_out": {"facecolor": KEEP_OUT + "22", "edgecolor": KEEP_OUT, "linewidth": 1.2, "hatch": "///"},
}

_TEXTS = {"keep_in": "robots stay inside", "keep_out": "robots stay outside"}


def draw_belts(axes: Axes, room: Environment, side_m: float) -> list[Any]:
    """Draw the belts of a map that is `side_m` long. Return their entries of the legend."""
    for belt in room.belts:
        line = Polyline(belt.line_m)
        left = beside(line, belt.width_m / 2)
        right = beside(line, -belt.width_m / 2)
        outline = np.vstack([left, right[::-1]])
        axes.add_patch(Polygon(outline, facecolor=BELT, edgecolor=BELT_EDGE, linewidth=0.8, zorder=2))
        name_width_m = len(belt.id) * side_m * LETTER
        name_m, arrows_m = _spaced(line.length_m, side_m / ARROWS_ACROSS, name_width_m)
        _label_along(axes, line, name_m, belt.id, INK, fontweight="bold", fontsize=8)
        for arrow_m in arrows_m:
            _draw_chevron(axes, line, arrow_m, 0.22 * belt.width_m)
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
        source = lines[link.source]
        target = lines[link.target]
        leaves = source.length_m if link.source_position_m is None else link.source_position_m
        start = source.point_at(leaves)[:2]
        end = target.point_at(link.target_position_m)[:2]
        axes.plot(*start, "o", ms=3, color=LINK, zorder=6)
        if math.dist(start, end) < 0.05:
            continue  # an arrow would be shorter than its head
        look: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 9, "shrinkA": 0, "shrinkB": 0}
        axes.add_patch(FancyArrowPatch(start, end, color=LINK, lw=1.4, zorder=6, **look))
    if not room.links:
        return []
    return [Line2D([], [], color=LINK, lw=1.4, marker=">", ms=4, label="link")]


def draw_bays(axes: Axes, room: Environment) -> list[Any]:
    """Draw the bays. Return their entries of the legend."""
    lines = _lanes(room)
    for bay in room.bays:
        line = lines[bay.belt]
        dx, dy, _ = line.tangent_at(line.length_m)

        # The text goes on in the direction of the belt
        horizontal = "left" if dx > 0 else "right"
        vertical = "bottom" if dy > 0 else "top"
        if abs(dx) > abs(dy):
            vertical = "center"
        else:
            horizontal = "center"
        axes.annotate(
            f"bay {bay.id}", line.point_at(line.length_m)[:2], xytext=(9 * dx, 9 * dy),
            textcoords="offset points", color="white", fontsize=8, fontweight="bold",
            ha=horizontal, va=vertical,
            bbox={"boxstyle": "round,pad=0.25", "facecolor": BAY, "edgecolor": "white"}, zorder=8,
        )  # fmt: skip
    return [Patch(facecolor=BAY, label="bay, where things leave")] if room.bays else []


def beside(line: Polyline, offset_m: float) -> NDArray[np.float64]:
    """Return the vertices of `line`, moved to its left by `offset_m` as seen from above, n x 2."""
    flat = line.tangents[:, :2]
    x, y = flat.T
    normals = np.column_stack([-y, x])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)

    # Mitre of the segments before and after each vertex. It is limited, else a sharp corner had a long spike.
    before = np.vstack([normals[:1], normals])
    after = np.vstack([normals, normals[-1:]])
    mitre = before + after
    lengths = np.einsum("ij,ij->i", mitre, before)
    mitre /= np.maximum(lengths[:, None], 0.5)
    shifted: NDArray[np.float64] = line.vertices_m[:, :2] + offset_m * mitre
    return shifted


def _lanes(room: Environment) -> dict[str, Polyline]:
    lanes: tuple[Belt | Strip, ...] = room.belts or room.strips
    return {lane.id: Polyline(lane.line_m) for lane in lanes}


def _spaced(length_m: float, step_m: float, name_m: float) -> tuple[float, list[float]]:
    """Return the positions of a belt's name and of its arrows, about `step_m` apart beside the name."""
    half = length_m / 2
    count = max(2, 2 * round(half / step_m))  # even: the name is in the middle
    places = [(index + 0.5) * length_m / count for index in range(count)]
    clearance = name_m / 2 + step_m / 8
    free = [place for place in places if abs(place - half) > clearance]
    if not free:
        return 0.4 * length_m, [0.86 * length_m]
    return half, free


def _draw_chevron(axes: Axes, line: Polyline, at_m: float, size_m: float) -> None:
    place = np.array(line.point_at(at_m)[:2])
    dx, dy, _ = line.tangent_at(at_m)
    across = 1.1 * np.array([dy, -dx])
    ahead = np.array([dx, dy]) / 2
    tips = np.array([across - ahead, ahead, -across - ahead])
    x, y = (place + size_m * tips).T
    axes.plot(x, y, color=ARROW, lw=1.3, zorder=3)


def _label_along(axes: Axes, line: Polyline, at_m: float, text: str, color: str, **look: Any) -> None:
    """Write `text` along `line`, never upside down."""
    x, y, _ = line.point_at(at_m)
    dx, dy, _ = line.tangent_at(at_m)
    heading = math.degrees(math.atan2(dy, dx))
    angle = (heading + 89.0) % 180.0 - 89.0
    axes.text(
        x, y, text, color=color, rotation=angle, rotation_mode="anchor", ha="center", va="center",
        **ON_TOP, **look,
    )  # fmt: skip


def draw_solids(axes: Axes, room: Environment) -> list[Any]:
    """Draw the solids of `room`. Return their entries of the legend."""
    boxes: tuple[Box, ...] = (*room.boxes, *room.fixed_things)
    solids = len(boxes) + len(room.planes) + len(room.cylinders) + len(room.spheres)
    is_named = solids <= MAX_NAMED

    # Outlines, in one collection
    patches: list[Patch] = []
    for box in boxes:
        patches.append(Polygon(_box_outline(box), **_FILL))
    for cylinder in room.cylinders:
        patches.append(Circle(cylinder.center_m[:2], cylinder.radius_m, **_FILL))
    dashed: dict[str, Any] = {**_FILL, "linestyle": (0, (3, 2))}
    for sphere in room.spheres:
        patches.append(Circle(sphere.center_m[:2], sphere.radius_m, **dashed))
    for plane in room.planes:
        _draw_plane(axes, plane, patches, is_named=is_named)
    axes.add_collection(PatchCollection(patches, match_original=True, zorder=_FILL["zorder"]))

    # Names, and what the legend says instead or besides
    legend: list[Any] = []
    if is_named:
        named: tuple[Box | Cylinder | Sphere, ...] = (*boxes, *room.cylinders, *room.spheres)
        for solid in named:
            label = solid.label if isinstance(solid, Thing) else ""
            _label_solid(axes, label or solid.id, solid.center_m)
    else:
        legend.append(Line2D([], [], ls="", label=f"{solids} solids, names left out"))
    if solids:
        legend.append(
            Patch(facecolor=SOLID_FILL, edgecolor=SOLID, label="box, thing, plane, cylinder; sphere dashed")
        )
    for plane in room.planes:
        if plane.size_m is None and abs(plane.normal[2]) >= LEVEL:
            legend.append(Line2D([], [], ls="", label=f"{plane.id}: level, without end"))
    return legend


def _box_outline(box: Box) -> NDArray[np.float64]:
    """Return the corners of an upright box as seen from above, 4 x 2."""
    c = math.cos(box.yaw_rad)
    s = math.sin(box.yaw_rad)
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    own_corners = signs * np.array(box.size_m[:2]) / 2
    turned_corners = own_corners @ np.array([[c, s], [-s, c]])
    outline: NDArray[np.float64] = turned_corners + np.array(box.center_m[:2])
    return outline


def _draw_plane(axes: Axes, plane: Plane, patches: list[Patch], *, is_named: bool) -> None:
    """Draw a plane as a line, or add its rectangle to `patches`."""
    x, y, _ = plane.center_m
    if plane.size_m is None:
        nx, ny, nz = plane.normal
        if abs(nz) < LEVEL:  # a level plane is everywhere
            axes.axline((x, y), (x - ny, y + nx), color=SOLID, lw=1.3, ls=(0, (6, 2)), zorder=1.8)
            if is_named:
                _label_solid(axes, f"{plane.id} (without end)", plane.center_m)
        return
    u, v = plane_axes(plane.normal)
    width_m, height_m = plane.size_m
    ux, uy, _ = scale(u, width_m / 2)
    vx, vy, _ = scale(v, height_m / 2)
    corners: list[tuple[float, float]] = []
    for sign_u, sign_v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        corner_x = x + sign_u * ux + sign_v * vx
        corner_y = y + sign_u * uy + sign_v * vy
        corners.append((corner_x, corner_y))
    look: dict[str, Any] = {**_FILL, "linewidth": 2.0}
    patches.append(Polygon(corners, **look))
    if is_named:
        _label_solid(axes, plane.id, plane.center_m)


def _label_solid(axes: Axes, text: str, center_m: Vec3) -> None:
    axes.text(*center_m[:2], text, color=SOLID, fontsize=7.5, ha="center", va="center", **ON_TOP)


def draw_map(
    path: Path,
    room: Environment,
    clouds: Mapping[str, NDArray[np.float64]],
    title: str,
    person_m: tuple[float, float] | None = None,
    *,
    separability: Callable[[float, float], float] | None = None,
) -> bool:
    """Write a picture of `room` from above to `path` (svg, png, pdf), with clouds (n x 3), a person (x, y).

    Return True if letters are drawn as boxes, since no font has them.

    `separability`: share of things that pointing tells apart from a place, by which the floor is coloured.

    Raises:
        ConfigError: If the file cannot be written.
    """
    # Fonts for all letters. Matplotlib would report each family that is not installed.
    settings: Any = mpl  # its stubs list every parameter there is
    installed = {entry.name for entry in font_manager.fontManager.ttflist}
    families = ["sans-serif"]
    families += [family for family in FALLBACKS if family in installed]

    # Letters are looked up while the file is written: until then no warning names a missing one
    with (
        settings.rc_context({**_STYLE, "font.family": families}),
        warnings.catch_warnings(action="always", record=True) as caught,
    ):
        figure: Any = map_figure(room, clouds, title, person_m, separability=separability)
        metadata = {"Date": None} if path.suffix.lower() == ".svg" else None  # reproducible
        with replaced_file(path) as part:
            figure.savefig(part, dpi=DPI, metadata=metadata, bbox_inches="tight", pad_inches=0.15)
    return any("missing from font" in str(message.message) for message in caught)


def map_figure(
    room: Environment,
    clouds: Mapping[str, NDArray[np.float64]],
    title: str,
    person_m: tuple[float, float] | None = None,
    *,
    separability: Callable[[float, float], float] | None = None,
) -> Any:
    """Return matplotlib's figure for `draw_map`, in the current style."""
    # To scale, as large as fits
    low, high = extent(room, clouds, person_m)
    width_m, height_m = high - low
    side = float(max(width_m, height_m))
    inches_per_m = min(WIDEST_IN / width_m, TALLEST_IN / height_m)
    figure: Any = Figure(figsize=(width_m * inches_per_m, height_m * inches_per_m), facecolor="white")
    axes: Axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    _grid(axes, side)

    # The legend has the order of drawing
    legend: list[Any] = []
    if separability is not None:
        legend += _draw_separability(axes, low, high, separability)
    legend += _draw_clouds(axes, clouds)
    legend += draw_solids(axes, room)
    legend += draw_fences(axes, room)
    legend += draw_belts(axes, room, side)
    legend += draw_strips(axes, room)
    legend += draw_links(axes, room)
    legend += draw_bays(axes, room)
    legend += _draw_lamps(axes, room, side * 0.05)
    if person_m is not None:
        legend += _draw_person(axes, person_m)
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", pad=8)
    axes.legend(handles=legend, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure


def _draw_separability(
    axes: Axes, low: NDArray[np.float64], high: NDArray[np.float64], share: Callable[[float, float], float]
) -> list[Any]:
    """Colour the floor, squares of about the 24th part of the longer side."""
    x_edges_m, y_edges_m = floor_edges(low, high)
    columns_m = [(west + east) / 2.0 for west, east in pairwise(x_edges_m)]
    rows_m = [(south + north) / 2.0 for south, north in pairwise(y_edges_m)]
    shares = np.empty((len(rows_m), len(columns_m)))
    for row, y in enumerate(rows_m):
        for column, x in enumerate(columns_m):
            shares[row, column] = share(x, y)
    style: dict[str, Any] = {"cmap": "RdYlBu", "vmin": 0.0, "vmax": 1.0, "alpha": 0.55}
    mesh = axes.pcolormesh(x_edges_m, y_edges_m, shares, zorder=0.2, linewidth=0, rasterized=True, **style)
    texts = {1.0: "from here all things are told apart", 0.5: "half of them", 0.0: "none, without light"}
    legend: list[Any] = []
    for value, text in texts.items():
        legend.append(Patch(facecolor=mesh.cmap(value), alpha=style["alpha"], label=text))
    return legend


def _grid(axes: Axes, side_m: float) -> None:
    """Draw a line each step, of which there are at most 20, or matplotlib's own on huge maps."""
    for step_m in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0):
        if side_m / step_m <= 20:
            axes.xaxis.set_major_locator(MultipleLocator(step_m))
            axes.yaxis.set_major_locator(MultipleLocator(step_m))
            break
    axes.grid(color="#eceef1", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    for side in axes.spines.values():
        side.set_linewidth(0.6)


def on_belt(room: Environment, x: float, y: float) -> bool:
    """Return True if the point is on a belt, as seen from above."""
    for belt in room.belts:
        try:
            floor_line = [(vertex_x, vertex_y, 0.0) for vertex_x, vertex_y, _ in belt.line_m]
            floor_polyline = Polyline(floor_line)
        except ValueError:  # vertical belts have no area
            continue
        _, distances_m = floor_polyline.nearest_to(np.array([[x, y, 0.0]]))
        if distances_m[0] <= belt.width_m / 2:
            return True
    return False


def _draw_lamps(axes: Axes, room: Environment, beside_m: float) -> list[Any]:
    for lamp in room.lamps:
        x, y, z = lamp.position_m
        axes.plot(x, y, "o", ms=11, color=LAMP, alpha=0.25, zorder=7)
        axes.plot(x, y, "o", ms=5.5, mfc=LAMP, mec=INK, mew=0.8, zorder=7)

        # The text is to the right, unless only there is a belt
        offset = 8
        alignment = "left"
        if on_belt(room, x + beside_m, y) and not on_belt(room, x - beside_m, y):
            offset = -8
            alignment = "right"
        axes.annotate(
            f"{lamp.id}\n{z:.2f} m high", (x, y), xytext=(offset, 0), textcoords="offset points",
            ha=alignment, va="center", fontsize=7.5, **ON_TOP,
        )  # fmt: skip
    if not room.lamps:
        return []
    return [Line2D([], [], marker="o", ls="", ms=5.5, mfc=LAMP, mec=INK, label="lamp")]


def _draw_clouds(axes: Axes, clouds: Mapping[str, NDArray[np.float64]]) -> list[Any]:
    for name, points in clouds.items():
        step = math.ceil(len(points) / MAX_CLOUD_POINTS)
        xs, ys, _ = points[::step].T
        axes.plot(xs, ys, ".", ms=1.2, color=CLOUD, alpha=0.5, rasterized=True, zorder=1.4)
        x = float(points[:, 0].mean())
        y = float(points[:, 1].max())
        axes.text(x, y, name, color=SOLID, fontsize=7.5, ha="center", va="bottom", **ON_TOP)
    if not clouds:
        return []
    return [Line2D([], [], marker=".", ls="", color=CLOUD, label="point cloud")]


def _draw_person(axes: Axes, person_m: Sequence[float]) -> list[Any]:
    x, y = person_m
    style: dict[str, Any] = {"marker": "P", "ms": 9, "color": INK, "mec": "white", "mew": 1.0}
    axes.plot(x, y, zorder=10, **style)
    return [Line2D([], [], ls="", **style, label=f"person at {x:g}, {y:g}")]


def draw_fences(axes: Axes, room: Environment) -> list[Any]:
    """Draw the fences of `room`. Return their entries of the legend."""
    for fence in room.fences:
        axes.add_patch(Polygon(fence.outline_m, **_LOOKS[fence.kind], zorder=1.9))

        # Inside the area that robots leave out, else at a corner
        x, y = fence.outline_m[0]
        if fence.kind == "keep_out":
            x, y = np.mean(fence.outline_m, axis=0)
        color = _LOOKS[fence.kind]["edgecolor"]
        axes.text(x, y, f"{fence.id}{_heights(fence)}", color=color, fontsize=7.5, ha="center", **ON_TOP)
    kinds = {fence.kind for fence in room.fences}
    return [Patch(**look, label=_TEXTS[kind]) for kind, look in _LOOKS.items() if kind in kinds]


def _heights(fence: Fence) -> str:
    """Return a line with the lowest and the highest point of a fence, `""` if it has no ends."""
    limits: list[str] = []
    if fence.low_m is not None:
        limits.append(f"from {fence.low_m:g} m")
    if fence.high_m is not None:
        limits.append(f"to {fence.high_m:g} m")
    return "\n" + " ".join(limits) if limits else ""
