"""Draws fences from above."""

from typing import Any

import numpy as np
from matplotlib.patches import Patch, Polygon

from pointit.maps.picture.palette import KEEP_IN, KEEP_OUT, ON_TOP, Axes
from pointit.schemas import Environment
from pointit.schemas.environment import Fence

_LOOKS: dict[str, dict[str, Any]] = {
    "keep_in": {"facecolor": "none", "edgecolor": KEEP_IN, "linewidth": 1.6, "linestyle": (0, (6, 2))},
    "keep_out": {"facecolor": KEEP_OUT + "22", "edgecolor": KEEP_OUT, "linewidth": 1.2, "hatch": "///"},
}
_TEXTS = {"keep_in": "robots stay inside", "keep_out": "robots stay outside"}


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
