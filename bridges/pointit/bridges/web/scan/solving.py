"""The solver of scans for pages: a survey to what a page shows, and to the text of a map."""

import functools
import json
import math
from typing import TYPE_CHECKING

from pointit.bridges.web.scan.session import Solution
from pointit.bridges.web.scan.wire import ScanStrip
from pointit.runtime.errors import ConfigError
from pointit.scan.views import Survey

if TYPE_CHECKING:
    from pointit.scan.result import Scan

COMPLETE_M = 0.01
"""Standard deviation of the ends at which a strip is known, m."""
UPRIGHT_M = 0.1
"""Level distance of a strip's ends below which it gives no heading, m."""


def solve_survey(survey: Survey) -> "Scan":
    """Return the scan of `survey`; runs in a process of its own.

    Raises:
        ConfigError: If the views determine nothing yet. One sentence.
    """
    # loads scipy, which the page's own process does not need
    from pointit.scan.result import ScanError  # noqa: PLC0415
    from pointit.scan.solver import solve  # noqa: PLC0415

    try:
        return solve(survey.strips, survey.lamps, survey.views, known_length=survey.known_length)
    except ScanError as error:
        raise ConfigError(str(error)) from error


def solution_of(scan: "Scan") -> Solution:
    """Return the solution for pages."""
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
    return Solution(
        strips=strips,
        cameras_m=tuple(camera.position_m for camera in scan.cameras if camera is not None),
        is_complete=scan.complete(COMPLETE_M),
        advice=_advice(scan),
        map_text=functools.partial(_map_text, scan),
    )


def _advice(scan: "Scan") -> str:
    """Return advice for the next view, or problems of the scan if everything is known."""
    unknown = [*scan.missing, *(name for name, strip in scan.strips.items() if not strip.identified)]
    unsure = [name for name, strip in scan.strips.items() if strip.sigma_m > COMPLETE_M]
    if not unknown and not unsure:
        return " ".join(scan.problems)
    wanted = unknown or sorted(unsure, key=lambda name: -scan.strips[name].sigma_m)
    return f"Now show {' and '.join(wanted[:2])} large in the picture, from a step to the side, with others."


def _map_text(scan: "Scan", origin: str) -> str:
    """Return the map as YAML. Strips that are not determined are comments with the reason."""
    names = [name for name, strip in scan.strips.items() if strip.identified]
    if not names or (origin and origin not in scan.strips):
        raise ConfigError(f"strip {origin!r} is not known yet" if origin else "no strip is known yet")
    base = scan.strips[origin or names[0]]
    x_m, y_m, _ = base.start
    along_m, across_m = base.end[0] - x_m, base.end[1] - y_m
    is_upright = math.hypot(along_m, across_m) < UPRIGHT_M
    placed = scan.placed((x_m, y_m, 0.0), 0.0 if is_upright else math.atan2(across_m, along_m))
    lines = [
        "# Mapped from photographs of its blinking strips, in metres: z is up, 0 at the lowest light.",
        f"# The origin is below the first LED of {base.name}, x points towards its last LED.",
        f"# All lengths are known to {100 * scan.scale_sigma:.1f} % (from the {scan.scale_from}).",
        "strips:",
    ]
    for name, strip in placed.strips.items():
        if strip.reason:
            lines.append(f"  # {name}: {strip.reason}")
        places = ", ".join(f"[{x:.4f}, {y:.4f}, {z:.4f}]" for x, y, z in strip.line_m)
        text = f"{json.dumps(name)}: {{line: [{places}], pixels: {strip.count}}}"
        lines.append(f"  {'' if strip.identified else '# '}{text}  # ends to {1000 * strip.sigma_m:.0f} mm")
    lines += [f"  # not known: {name}" for name in scan.missing]
    return "\n".join([*lines, ""])
