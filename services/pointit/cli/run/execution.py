"""A run from its plan to its summary: bus, clock, services, scenario requests, view, score."""

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncGenerator

from rich.console import Console
from rich.text import Text

from pointit.cli.display.summary import figures, write_summary
from pointit.cli.parts import DISPLAY_PARTS, LIVE_VIEWS
from pointit.launch.plan.plan import Beside, Plan
from pointit.launch.plan.startup_notices import stored_mounting_notices, stored_offset_notices
from pointit.launch.run.run_site import ScenarioRequests, ViewerPresence, adapt_to_site, clock_of, open_bus
from pointit.launch.run.running_scenario import RunningScenario
from pointit.runtime.bus.site_clock import publish_time
from pointit.runtime.clock import Clock, SimulatedClock, WallClock
from pointit.runtime.host.extras import present
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.plain_console import PlainConsole, say
from pointit.runtime.service.service import check_launches
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health
from pointit.schemas.topics import HEALTH, RUN_SCENARIO

log = logging.getLogger(__name__)

FIGURES_S = 10.0
"""Interval at which a run without a view logs its metrics."""


def execute(plan: Plan, log_level: str) -> int:
    """Run the plan. Return the exit code: 0, or 1 if it failed or no cursor ever appeared.

    Selected and missed objects are in the summary and do not affect the exit code.

    Raises:
        ConfigError: If a service cannot work as configured; nothing was started.
    """
    beside = [launch for each in plan.beside for launch in each.checked()]
    check_launches([*plan.launches, *beside], plan.link.addresses)
    console = PlainConsole(stderr=True)
    is_wanted = plan.view and console.is_terminal and not console.is_dumb_terminal
    drawn = is_wanted and bool(present(LIVE_VIEWS))
    setup_logging(log_level if not drawn else "warning", console if drawn else None)
    notes = [*plan.notes, *stored_mounting_notices(plan.launches)]
    if drawn:  # else the supervisors log their own
        notes += stored_offset_notices(plan.launches)
    for note in notes:
        _tell(note, console if drawn else None)
    return run_until_shutdown(_run(plan, console if drawn else None))


def _tell(sentence: str, console: Console | None) -> None:
    """Print `sentence` above the view, or log it."""
    if console is not None:
        console.print(Text(sentence))
    else:
        log.info("%s", sentence)


async def _run(plan: Plan, console: Console | None) -> int:
    bus = await open_bus(plan)
    try:
        run = _Run(await adapt_to_site(plan, bus), bus, console)
        failed = True
        try:
            await run.live(await clock_of(plan, bus))
            failed = False
        except asyncio.CancelledError:  # a requested end: the summary covers the elapsed time
            failed = False
            raise
        finally:
            if run.stage is not None and (not failed or run.stage.monitor.first_cursor_unix_s is not None):
                parts = present(DISPLAY_PARTS)
                write_summary(run.stage.plan, run.stage.monitor, run.lasted_s * plan.speed, parts)
    finally:
        await bus.close()
        for sentence in filter(None, (each.closing_note() for each in plan.beside)):
            _say(sentence)
    return 0 if run.stage is None else _verdict(run.stage)


def _verdict(scenario: RunningScenario) -> int:
    if scenario.plan.scored and scenario.monitor.first_cursor_unix_s is None and not scenario.saw_cursor:
        advice = (
            "; ".join(scenario.monitor.warnings()) or "`pointit doctor` during a run shows what is missing"
        )
        log.error("no cursor ever appeared; %s", advice)
        return 1
    return 0


class _Run:
    def __init__(self, plan: Plan, bus: ZenohBus, console: Console | None) -> None:
        self.stage: RunningScenario | None = None
        self.lasted_s = 0.0
        """Wall time of the last scenario."""
        self._plan = plan
        self._bus = bus
        self._console = console
        self._changed = asyncio.Event()
        """Set by events that may end or change the run."""
        self._requests = ScenarioRequests(self._changed.set)
        self._viewers = ViewerPresence()
        self._limit_s: float | None = None
        """Monotonic time at which it ends even with viewers. None: viewers extend it."""

    async def live(self, clock: Clock) -> None:
        """Run until its duration is over and there are no viewers, or until services have ended."""
        is_drawn = self._console is not None
        scenario = self.stage = RunningScenario(
            self._plan,
            self._bus,
            self._bus.link,
            clock,
            tell=lambda sentence: _tell(sentence, self._console),
            news=None if is_drawn else log.info,
            on_end=self._changed.set,
            on_beside=self._announce,
        )
        async with _printing(scenario, is_drawn=is_drawn):
            try:
                with contextlib.ExitStack() as listening:
                    listening.callback(self._bus.subscribe(HEALTH, self._on_health).close)
                    for each in self._plan.beside:
                        listening.enter_context(each.joined(self._bus))
                    await scenario.begin()
                    if self._plan.is_limited:
                        self._limit_s = scenario.end_s
                    if self._plan.scenario:
                        listening.callback(self._bus.serve(RUN_SCENARIO, self._requests.serve).close)
                    if self._console is not None:
                        parts = present(DISPLAY_PARTS)
                        for view in present(LIVE_VIEWS):
                            drawn = view(scenario, self._console, self._end_s, self._is_looked_on, parts)
                            listening.enter_context(drawn)
                    await self._until_over(scenario)
            finally:
                self.lasted_s = self._lasted_s(scenario)
                await scenario.end()

    def _announce(self, beside: Beside) -> None:
        for sentence in beside.greeting(is_drawn=self._console is not None):
            if self._console is None:
                _say(sentence)
            else:
                _tell(sentence, self._console)

    async def _until_over(self, scenario: RunningScenario) -> None:
        while not scenario.has_ended:
            self._changed.clear()
            if self._requests:
                await self._requests.apply_next(scenario)
                continue
            left_s = self._left_s()
            if left_s is not None and left_s <= 0.0:
                return
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(left_s):
                    await self._changed.wait()

    def _on_health(self, health: Health, _instance: str) -> None:
        if self._viewers.on_health(health, time.monotonic()):
            self._changed.set()

    def _is_looked_on(self) -> bool:
        return self._limit_s is None and time.monotonic() < self._viewers.until_s

    def _end_s(self) -> float | None:
        """Return the monotonic time at which it ends without viewers, or None."""
        if self._limit_s is not None or self.stage is None:
            return self._limit_s
        return self.stage.end_s

    def _left_s(self) -> float | None:
        end_s = self._end_s()
        if end_s is None:
            return None
        until_s = end_s if self._limit_s is not None else max(end_s, self._viewers.until_s)
        return until_s - time.monotonic()

    def _lasted_s(self, scenario: RunningScenario) -> float:
        """Return the time that `scenario` has run: its duration, if that ended it."""
        now_s, end_s = time.monotonic(), self._end_s()
        is_prolonged = self._limit_s is None and end_s is not None and self._viewers.until_s > end_s
        if end_s is not None and not is_prolonged:
            now_s = min(now_s, end_s)
        return now_s - scenario.began_s


def _say(sentence: str) -> None:
    """Log `sentence`, or print it if the log level hides it."""
    if log.isEnabledFor(logging.INFO):
        log.info("%s", sentence)
    else:
        say(sentence, err=True)


@contextlib.asynccontextmanager
async def _printing(scenario: RunningScenario, *, is_drawn: bool) -> AsyncGenerator[None]:
    """Publish the site's clock and, without a view, log metrics every `FIGURES_S`."""

    async def tell_figures() -> None:
        while True:
            await asyncio.sleep(FIGURES_S)
            if shown := figures(scenario.monitor).plain:
                log.info("%s", shown)

    tasks: list[asyncio.Task[None]] = []
    if isinstance(scenario.clock, WallClock | SimulatedClock):  # services that join use this clock
        tasks.append(asyncio.create_task(publish_time(scenario.clock, scenario.bus), name="clock"))
    if not is_drawn:
        tasks.append(asyncio.create_task(tell_figures(), name="figures"))
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
