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
    """Return what pages show of `scan`."""
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
        is_complete=scan.complete(),
        advice=_advice(scan),
        map_text=functools.partial(_map_text, scan),
    )


def _advice(scan: "Scan") -> str:
    return " ".join(scan.problems)


def _map_text(scan: "Scan", origin: str) -> str:
    return f"{scan}{origin}"
