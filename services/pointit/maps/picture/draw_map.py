"""Draws a map from above: to scale, on white, in colours distinguishable for colour-blind people."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.maps.picture.belts import draw_bays, draw_belts, draw_links, draw_strips
from pointit.maps.picture.floor import extent, floor_edges
from pointit.maps.picture.fonts import use_fonts_with_letters
from pointit.maps.picture.palette import CLOUD, INK, KEEP_IN, KEEP_OUT, LAMP, ON_TOP, SOLID, Axes
from pointit.maps.picture.solids import draw_solids
from pointit.runtime.host.atomic_file import replaced_file
from pointit.schemas import Environment
from pointit.schemas.environment import Fence

MAX_CLOUD_POINTS = 20_000

WIDEST_IN, TALLEST_IN = 10.5, 8.5

DPI = 150

_STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
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


def draw_map(
    path: Path,
    room: Environment,
    clouds: Mapping[str, NDArray[np.float64]],
    title: str,
    person_m: tuple[float, float] | None = None,
    *,
    separability: Callable[[float, float], float] | None = None,
) -> str:
    """Write a picture of `room` from above to `path` (svg, png, pdf), with clouds (n x 3), a person (x, y).

    Return the letters that no font has, which are drawn as `?`.

    `separability`: share of things that pointing tells apart from a place, by which the floor is coloured.

    Raises:
        ConfigError: If the file cannot be written.
    """
    settings: Any = mpl  # its stubs list every parameter there is
    with settings.rc_context(_STYLE):
        figure: Any = map_figure(room, clouds, title, person_m, separability=separability)
        missing = use_fonts_with_letters(figure)
        metadata = {"Date": None} if path.suffix.lower() == ".svg" else None  # reproducible
        with replaced_file(path) as part:
            figure.savefig(part, dpi=DPI, metadata=metadata, bbox_inches="tight", pad_inches=0.15)
    return missing


def map_figure(
    room: Environment,
    clouds: Mapping[str, NDArray[np.float64]],
    title: str,
    person_m: tuple[float, float] | None = None,
    *,
    separability: Callable[[float, float], float] | None = None,
) -> Any:
    """Return matplotlib's figure for `draw_map`, in the current style."""
    low, high = extent(room, clouds, person_m)
    wide, tall = high - low
    side = float(max(wide, tall))
    scale = min(WIDEST_IN / wide, TALLEST_IN / tall)
    figure: Any = Figure(figsize=(wide * scale, tall * scale), facecolor="white")
    axes: Axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    _grid(axes, side)
    legend = [
        *(() if separability is None else _draw_separability(axes, low, high, separability)),
        *_draw_clouds(axes, clouds),
        *draw_solids(axes, room),
        *draw_fences(axes, room),
        *draw_belts(axes, room, side),
        *draw_strips(axes, room),
        *draw_links(axes, room),
        *draw_bays(axes, room),
        *_draw_lamps(axes, room, side * 0.05),
        *(() if person_m is None else _draw_person(axes, person_m)),
    ]
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", pad=8)
    axes.legend(handles=legend, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure


def _draw_separability(
    axes: Axes, low: NDArray[np.float64], high: NDArray[np.float64], share: Callable[[float, float], float]
) -> list[Any]:
    """Colour the floor, squares of about the 24th part of the longer side."""
    x_m, y_m = floor_edges(low, high)
    shares = [[share((x + x2) / 2.0, (y + y2) / 2.0) for x, x2 in pairwise(x_m)] for y, y2 in pairwise(y_m)]
    style: dict[str, Any] = {"cmap": "RdYlBu", "vmin": 0.0, "vmax": 1.0, "alpha": 0.55}
    mesh = axes.pcolormesh(x_m, y_m, np.array(shares), zorder=0.2, linewidth=0, rasterized=True, **style)
    texts = {1.0: "from here all things are told apart", 0.5: "half of them", 0.0: "none, without light"}
    return [Patch(facecolor=mesh.cmap(at), alpha=style["alpha"], label=text) for at, text in texts.items()]


def _grid(axes: Axes, side_m: float) -> None:
    step = next((each for each in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if side_m / each <= 20), None)
    if step is not None:
        axes.xaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_locator(MultipleLocator(step))
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
            floor_polyline = Polyline([(*vertex[:2], 0.0) for vertex in belt.line_m])
        except ValueError:  # vertical belts have no area
            continue
        if floor_polyline.nearest_to(np.array([[x, y, 0.0]]))[1][0] <= belt.width_m / 2:
            return True
    return False


def _draw_lamps(axes: Axes, room: Environment, beside_m: float) -> list[Any]:
    for lamp in room.lamps:
        x, y, z = lamp.position_m
        axes.plot(x, y, "o", ms=11, color=LAMP, alpha=0.25, zorder=7)
        axes.plot(x, y, "o", ms=5.5, mfc=LAMP, mec=INK, mew=0.8, zorder=7)
        left = on_belt(room, x + beside_m, y) and not on_belt(room, x - beside_m, y)
        axes.annotate(
            f"{lamp.id}\n{z:.2f} m high", (x, y), xytext=(-8 if left else 8, 0), textcoords="offset points",
            ha="right" if left else "left", va="center", fontsize=7.5, **ON_TOP,
        )  # fmt: skip
    return [Line2D([], [], marker="o", ls="", ms=5.5, mfc=LAMP, mec=INK, label="lamp")] if room.lamps else []


def _draw_clouds(axes: Axes, clouds: Mapping[str, NDArray[np.float64]]) -> list[Any]:
    for name, points in clouds.items():
        step = math.ceil(len(points) / MAX_CLOUD_POINTS)
        axes.plot(*points[::step, :2].T, ".", ms=1.2, color=CLOUD, alpha=0.5, rasterized=True, zorder=1.4)
        x, y = points[:, 0].mean(), points[:, 1].max()
        axes.text(float(x), float(y), name, color=SOLID, fontsize=7.5, ha="center", va="bottom", **ON_TOP)
    return [Line2D([], [], marker=".", ls="", color=CLOUD, label="point cloud")] if clouds else []


def _draw_person(axes: Axes, person_m: Sequence[float]) -> list[Any]:
    x, y = person_m
    style: dict[str, Any] = {"marker": "P", "ms": 9, "color": INK, "mec": "white", "mew": 1.0}
    axes.plot(x, y, zorder=10, **style)
    return [Line2D([], [], ls="", **style, label=f"person at {x:g}, {y:g}")]


def draw_fences(axes: Axes, room: Environment) -> list[Any]:
    """Draw the fences of `room`. Return their entries of the legend."""
    for fence in room.fences:
        axes.add_patch(Polygon(fence.outline_m, **_LOOKS[fence.kind], zorder=1.9))
        x, y = np.mean(fence.outline_m, axis=0) if fence.kind == "keep_out" else fence.outline_m[0]
        color = _LOOKS[fence.kind]["edgecolor"]
        axes.text(x, y, f"{fence.id}{_heights(fence)}", color=color, fontsize=7.5, ha="center", **ON_TOP)
    kinds = [kind for kind in _LOOKS if any(fence.kind == kind for fence in room.fences)]
    return [Patch(**_LOOKS[kind], label=_TEXTS[kind]) for kind in kinds]


def _heights(fence: Fence) -> str:
    low = "" if fence.low_m is None else f"from {fence.low_m:g} m"
    high = "" if fence.high_m is None else f"to {fence.high_m:g} m"
    return "\n" + f"{low} {high}".strip() if low or high else ""
