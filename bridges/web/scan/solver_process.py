"""The solver in a process of its own, so that the site and its pages go on meanwhile.

No core: it waits for a process.
"""

import asyncio
import functools
import math
import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from typing import TYPE_CHECKING

from pointit.bridges.web.scan.session import ScanSolution
from pointit.bridges.web.scan.wire import ScanStrip, ScanThing
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.scan.views import Survey

if TYPE_CHECKING:
    from pointit.scan.by_pointing import PointedAt
    from pointit.scan.result import Scan, ScannedLamp, ScannedStrip

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


def solution_of(scan: "Scan", size: tuple[int, int]) -> ScanSolution:
    """Return the solution for pages; `size`: of the views' images, image pixels."""
    from pointit.scan.advice import next_view  # noqa: PLC0415

    # Strips and lamps alike: a lamp is a line of one point
    lights: dict[str, tuple[int, tuple[Vec3, ...]]] = {}
    for name, strip in scan.strips.items():
        lights[name] = (strip.count, strip.line_m)
    for name, lamp in scan.lamps.items():
        lights[name] = (1, (lamp.position_m,))
    scanned: list[ScannedStrip | ScannedLamp] = [*scan.strips.values(), *scan.lamps.values()]
    scan_strips: list[ScanStrip] = []
    for light in scanned:
        pixels, line_m = lights[light.name]
        sigma_m = light.sigma_m if math.isfinite(light.sigma_m) else None
        scan_strips.append(
            ScanStrip(name=light.name, pixels=pixels, line_m=line_m, sigma_m=sigma_m, reason=light.reason)
        )

    # Problems of lights that are missing are those of their lines already
    missing = tuple(map(repr, scan.missing))
    sentences = [problem for problem in scan.problems if not problem.startswith(missing)]
    if scan.level_from != "gravity":
        sentences.append("no view tells where down is, so that most strips are taken as level or upright")
    advice = next_view(scan)
    next_m = None
    if advice is not None:  # it has the positions for photographs of what is missing
        sentences.append(advice.text)
        next_m = advice.position_m
    capitalized: list[str] = []
    for sentence in sentences:
        text = f"{sentence}."
        subject, _, _ = text.partition(":")
        if subject not in lights:
            text = text[:1].upper() + text[1:]
        capitalized.append(text)

    # Views that show too little have no camera
    cameras_m = tuple(camera.position_m for camera in scan.cameras if camera is not None)
    return ScanSolution(
        strips=tuple(scan_strips),
        cameras_m=cameras_m,
        is_complete=scan.complete(),
        advice=" ".join(capitalized),
        next_m=next_m,
        thing=functools.partial(_solved_thing, scan, size),
        map_text=functools.partial(_map_text, scan, size),
    )


def _located_corners(scan: "Scan", size: tuple[int, int], thing: ScanThing) -> "list[PointedAt]":
    from pointit.scan.by_tapping import Tap, locate  # noqa: PLC0415

    corners: list[PointedAt] = []
    for taps in thing.corners:
        taps_of_corner = [Tap(*tap) for tap in taps]
        corners.append(locate(scan, size, taps_of_corner))
    return corners


def _solved_thing(scan: "Scan", size: tuple[int, int], thing: ScanThing) -> ScanStrip:
    """Return a thing for pages. Raises RefusedError if its corners span none."""
    from pointit.scan.by_tapping import tapped_text  # noqa: PLC0415

    corners = _located_corners(scan, size, thing)
    for corner in corners:
        if corner.reason:
            raise RefusedError(corner.reason)
    tapped_text({thing.name: (thing.shape, corners)})  # refuses corners that span nothing
    line_m = tuple(corner.position_m for corner in corners)
    sigma_m = max(corner.sigma_m for corner in corners)
    places = min(corner.places for corner in corners)
    return ScanStrip(name=thing.name, pixels=0, line_m=line_m, sigma_m=sigma_m, seen=places)


def _map_text(scan: "Scan", size: tuple[int, int], origin: str, things: Sequence[ScanThing]) -> str:
    """Return the map of what is identified, with its origin at a strip, as YAML."""
    from pointit.scan.by_tapping import tapped_text  # noqa: PLC0415
    from pointit.scan.result import map_text  # noqa: PLC0415

    names = [name for name, strip in scan.strips.items() if strip.identified]
    if not names or origin not in ("", *scan.strips):
        raise ConfigError(f"strip {origin!r} is not known yet" if origin else "no strip is known yet")
    base = scan.strips[origin or names[0]]

    # x along the strip, unless it stands upright and so has no heading
    x_m, y_m, _ = base.start
    along_m = base.end[0] - x_m
    across_m = base.end[1] - y_m
    heading_rad = 0.0
    x_axis = ""
    if math.hypot(along_m, across_m) >= UPRIGHT_M:
        heading_rad = math.atan2(across_m, along_m)
        x_axis = ", x points towards its last LED"
    placed = scan.placed((x_m, y_m, 0.0), heading_rad)

    # Things are located in the same frame as the strips
    shapes = {thing.name: (thing.shape, _located_corners(placed, size, thing)) for thing in things}
    head = (
        "# Origin of the scan: at the height of the lowest light, "
        f"below the first LED of {base.name}{x_axis}.\n"
    )
    return head + map_text(placed) + tapped_text(shapes)


class SolverProcess:
    """Solves surveys one after the other. The process begins with the first one."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    async def solve(self, survey: Survey) -> ScanSolution:
        """Solve `survey`.

        Raises:
            PointItError: If its views determine nothing yet, or the process has ended.
        """
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                1,
                mp_context=multiprocessing.get_context("spawn"),  # threads of this process hold locks
                initializer=signal.signal,
                initargs=(signal.SIGINT, signal.SIG_IGN),
            )
        loop = asyncio.get_running_loop()
        try:
            scan = await loop.run_in_executor(self._pool, solve_survey, survey)
        except BrokenExecutor as error:
            self.close()
            raise ConfigError("the solver's process has ended; take the next view") from error
        first_view = survey.views[0]
        return solution_of(scan, (first_view.width, first_view.height))

    def close(self) -> None:
        """End the process."""
        pool = self._pool
        self._pool = None
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
