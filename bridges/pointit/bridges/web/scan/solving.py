"""The solver of scans for pages: a survey to what a page shows, and to the text of a map."""

import functools
import math
from typing import TYPE_CHECKING

from pointit.bridges.web.scan.session import Solution
from pointit.bridges.web.scan.wire import ScanStrip
from pointit.runtime.errors import ConfigError
from pointit.scan.views import Survey

if TYPE_CHECKING:
    from pointit.scan.result import Scan

UPRIGHT_M = 0.1
"""Level distance of a strip's ends below which it gives no heading, m."""

# scipy is loaded with the first scan, not with the page


def solve_survey(survey: Survey) -> "Scan":
    """Return the scan of `survey`; runs in a process of its own.

    Raises:
        PointItError: If the views determine nothing yet. One sentence.
    """
    from pointit.scan.solver import solve  # noqa: PLC0415

    return solve(survey.strips, survey.lamps, survey.views, known_length=survey.known_length)


def solution_of(scan: "Scan") -> Solution:
    """Return the solution for pages."""
    from pointit.scan.advice import next_view  # noqa: PLC0415

    strips = tuple(
        ScanStrip(
            name=name,
            pixels=strip.count,
            line_m=strip.line_m,
            sigma_m=strip.sigma_m if math.isfinite(strip.sigma_m) else None,
            reason=strip.reason,
        )
        for name, strip in scan.strips.items()
    )
    advice = next_view(scan)
    return Solution(
        strips=strips,
        cameras_m=tuple(camera.position_m for camera in scan.cameras if camera is not None),
        is_complete=scan.complete(),
        advice=f"{advice.text}." if advice is not None else " ".join(scan.problems),
        next_m=advice.position_m if advice is not None else None,
        map_text=functools.partial(_map_text, scan),
    )


def _map_text(scan: "Scan", origin: str) -> str:
    """Return the map of what is identified, with its origin at a strip, as YAML."""
    from pointit.scan.as_map import map_text  # noqa: PLC0415

    names = [name for name, strip in scan.strips.items() if strip.identified]
    if not names or (origin and origin not in scan.strips):
        raise ConfigError(f"strip {origin!r} is not known yet" if origin else "no strip is known yet")
    base = scan.strips[origin or names[0]]
    x_m, y_m, _ = base.start
    along_m, across_m = base.end[0] - x_m, base.end[1] - y_m
    is_upright = math.hypot(along_m, across_m) < UPRIGHT_M
    placed = scan.placed((x_m, y_m, 0.0), 0.0 if is_upright else math.atan2(across_m, along_m))
    x_axis = "" if is_upright else ", x points towards its last LED"
    return (
        f"# The origin is at the height of the lowest light, below the first LED of {base.name}{x_axis}.\n"
        + (map_text(placed))
    )
