"""The solver in a process of its own, so that the site and its pages go on meanwhile."""

import asyncio
import functools
import math
import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from typing import TYPE_CHECKING

from pointit.bridges.web.scan.session import Solution
from pointit.bridges.web.scan.wire import ScanStrip, ScanThing
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


def solution_of(scan: "Scan", size: tuple[int, int]) -> Solution:
    """Return the solution for pages; `size`: of the views' images, image pixels."""
    from pointit.scan.advice import next_view  # noqa: PLC0415

    lines = {name: (strip.count, strip.line_m) for name, strip in scan.strips.items()}
    points = {name: (1, (lamp.position_m,)) for name, lamp in scan.lamps.items()}
    scanned: list[ScannedStrip | ScannedLamp] = [*scan.strips.values(), *scan.lamps.values()]
    strips = tuple(
        ScanStrip(
            name=each.name,
            pixels=(lines | points)[each.name][0],
            line_m=(lines | points)[each.name][1],
            sigma_m=each.sigma_m if math.isfinite(each.sigma_m) else None,
            reason=each.reason,
        )
        for each in scanned
    )
    advice = next_view(scan)
    sentences = [each for each in scan.problems if not each.startswith(tuple(map(repr, scan.missing)))]
    if scan.level_from != "gravity":
        sentences.append("no view tells where down is, so that most strips are taken as level or upright")
    if advice is not None:  # it has the positions for photographs of what is missing
        sentences.append(advice.text)
    return Solution(
        strips=strips,
        cameras_m=tuple(camera.position_m for camera in scan.cameras if camera is not None),
        is_complete=scan.complete(),
        advice=" ".join(
            each if each.partition(":")[0] in lines | points else f"{each[:1].upper()}{each[1:]}"
            for each in (f"{sentence}." for sentence in sentences)
        ),
        next_m=advice.position_m if advice is not None else None,
        thing=functools.partial(_thing, scan, size),
        map_text=functools.partial(_map_text, scan, size),
    )


def _corners(scan: "Scan", size: tuple[int, int], thing: ScanThing) -> "list[PointedAt]":
    from pointit.scan.by_tapping import Tap, locate  # noqa: PLC0415

    return [locate(scan, size, [Tap(*tap) for tap in taps]) for taps in thing.corners]


def _thing(scan: "Scan", size: tuple[int, int], thing: ScanThing) -> ScanStrip:
    """Return a thing for pages. Raises RefusedError if its corners span none."""
    from pointit.scan.by_tapping import tapped_text  # noqa: PLC0415

    corners = _corners(scan, size, thing)
    if reason := next((corner.reason for corner in corners if corner.reason), ""):
        raise RefusedError(reason)
    tapped_text({thing.name: (thing.shape, corners)})
    return ScanStrip(
        name=thing.name,
        pixels=0,
        line_m=tuple(corner.position_m for corner in corners),
        sigma_m=max(corner.sigma_m for corner in corners),
        seen=min(corner.places for corner in corners),
    )


def _map_text(scan: "Scan", size: tuple[int, int], origin: str, things: Sequence[ScanThing]) -> str:
    """Return the map of what is identified, with its origin at a strip, as YAML."""
    from pointit.scan.by_tapping import tapped_text  # noqa: PLC0415
    from pointit.scan.result import map_text  # noqa: PLC0415

    names = [name for name, strip in scan.strips.items() if strip.identified]
    if not names or (origin and origin not in scan.strips):
        raise ConfigError(f"strip {origin!r} is not known yet" if origin else "no strip is known yet")
    base = scan.strips[origin or names[0]]
    x_m, y_m, _ = base.start
    along_m = base.end[0] - x_m
    across_m = base.end[1] - y_m
    is_upright = math.hypot(along_m, across_m) < UPRIGHT_M
    placed = scan.placed((x_m, y_m, 0.0), 0.0 if is_upright else math.atan2(across_m, along_m))
    x_axis = "" if is_upright else ", x points towards its last LED"
    return (
        "# Origin of the scan: at the height of the lowest light, "
        f"below the first LED of {base.name}{x_axis}.\n"
        + map_text(placed)
        + tapped_text({thing.name: (thing.shape, _corners(placed, size, thing)) for thing in things})
    )


class SolverProcess:
    """Solves surveys one after the other. The process begins with the first one."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    async def solve(self, survey: Survey) -> Solution:
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
        try:
            scan = await asyncio.get_running_loop().run_in_executor(self._pool, solve_survey, survey)
        except BrokenExecutor as error:
            self.close()
            raise ConfigError("the solver's process has ended; take the next view") from error
        return solution_of(scan, (survey.views[0].width, survey.views[0].height))

    def close(self) -> None:
        """End the process."""
        pool = self._pool
        self._pool = None
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
