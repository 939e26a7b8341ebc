"""A run from its plan to its summary: bus, clock, services here or as processes, view, score."""

import asyncio
import contextlib
import logging
import sys
import time
from collections.abc import AsyncGenerator, Generator, Sequence

from rich.console import Console
from rich.live import Live
from rich.text import Text

from pointit.cli.at_start import kept_mountings, kept_offsets
from pointit.cli.keyboard import has_keyboard, keys
from pointit.cli.monitor import Monitor
from pointit.cli.plan import Plan
from pointit.cli.processes import Processes
from pointit.cli.score import Score
from pointit.cli.summary import sum_up
from pointit.cli.view import REFRESH_HZ, draw, figures
from pointit.runtime import (
    Clock,
    ConfigError,
    Launch,
    ListenError,
    SimulatedClock,
    SiteClock,
    WallClock,
    run_services,
)
from pointit.runtime.clock import keep_time
from pointit.runtime.log import setup_logging
from pointit.runtime.presence import present
from pointit.runtime.process import run_async
from pointit.runtime.service import check_launches
from pointit.runtime.zenoh_bus import ZenohBus
from pointit.runtime.zenoh_session import DEFAULT_ENDPOINT, Link
from pointit.schemas import ButtonEvent, Deployment, ExpectedService
from pointit.schemas.topics import BUTTON, DEPLOYMENT, USER_ALIVE

log = logging.getLogger(__name__)

PORTS_TO_TRY = 10
"""Ports from the default on that `run` tries before it gives up."""

CLOCK_PATIENCE_S = 0.5
"""How long to wait for the time of a site that is joined; a site of bare services has none."""

PRESENCE_PATIENCE_S = 0.3
"""How long to listen for who is there already."""

FIGURES_S = 10.0
"""How often a run without a view logs its figures."""


def execute(plan: Plan, log_level: str) -> int:
    """Run the plan; return the exit code: 0 well, 1 when it failed or no cursor ever appeared.

    What people selected or missed is in the summary and does not make the run itself a failure.

    Raises:
        ConfigError: a service cannot work as configured; nothing was started.
    """
    check_launches(plan.launches)
    console = Console(stderr=True)
    drawn = plan.view and console.is_terminal and not console.is_dumb_terminal
    setup_logging(log_level if not drawn else "warning", console if drawn else None)
    notes = [*plan.notes, *kept_mountings(plan.launches)]
    if drawn:  # else the supervisors log their own
        notes += kept_offsets(plan.launches)
    for note in notes:
        if drawn:
            console.print(Text(note))
        else:
            log.info("%s", note)
    return run_async(_run(plan, console if drawn else None))


async def _run(plan: Plan, console: Console | None) -> int:
    """Run the plan to its end; sum it up even when it is cut short."""
    bus = await _open(plan)
    try:
        await _refuse_names_in_use(plan, bus)
        clock = await _clock(plan, bus)
        monitor = Monitor(Score(plan.target_kinds), clock, person=plan.person)
        if console is None:
            monitor.tell = log.info
        monitor.attach(bus)
        for launch in plan.launches:
            launch.service.begin_anew(bus.link.site, clock.now_ns())
        began_s = time.monotonic()
        failed = True
        try:
            await _live(plan, bus, clock, monitor, console)
            failed = False
        except asyncio.CancelledError:  # asked to end: what was reached counts
            failed = False
            raise
        finally:
            if not failed or monitor.first_cursor_unix_s is not None:
                sum_up(plan, monitor, (time.monotonic() - began_s) * plan.speed)
    finally:
        await bus.close()
    if plan.scored and monitor.first_cursor_unix_s is None:
        advice = "; ".join(monitor.complaints()) or "`pointit doctor` during a run says what is missing"
        log.error("no cursor ever appeared; %s", advice)
        return 1
    return 0


async def _clock(plan: Plan, bus: ZenohBus) -> Clock:
    """Return the time of this run: its own, or that of the site it joins."""
    if plan.speed != 1.0:
        return SimulatedClock(plan.speed)
    if bus.link.connect:
        clock = SiteClock(bus)
        await clock.found(CLOCK_PATIENCE_S)
        return clock
    return WallClock()


async def _refuse_names_in_use(plan: Plan, bus: ZenohBus) -> None:
    """Make sure that nobody else runs services under the same people's names.

    Raises:
        ConfigError: somebody does.
    """
    users = {launch.user for launch in plan.launches} - {""}
    taken = users & await present(bus, USER_ALIVE, PRESENCE_PATIENCE_S) if bus.link.connect else set[str]()
    if taken:
        names = ", ".join(sorted(taken))
        raise ConfigError(
            f"{names}: already on site {bus.link.site}; choose another name, or end the other one first"
        )


async def _live(plan: Plan, bus: ZenohBus, clock: Clock, monitor: Monitor, console: Console | None) -> None:
    """Run the services for the plan's duration, or until they end."""
    end_s = None if plan.duration_s is None else time.monotonic() + plan.duration_s / clock.speed
    async with _told(bus, clock, monitor, console), _services(plan, bus, clock) as work:
        with _view(plan, bus, monitor, console, end_s):
            timeout = None if end_s is None else max(0.0, end_s - time.monotonic())
            await asyncio.wait({work}, timeout=timeout)


@contextlib.asynccontextmanager
async def _told(
    bus: ZenohBus, clock: Clock, monitor: Monitor, console: Console | None
) -> AsyncGenerator[None]:
    """Tell the site what time it is, and without a view the log the figures, now and then."""

    async def tell_figures() -> None:
        while True:
            await asyncio.sleep(FIGURES_S)
            log.info("%s", figures(monitor).plain)

    tasks: list[asyncio.Task[None]] = []
    if isinstance(clock, WallClock | SimulatedClock):  # whoever joins has this time, not its own
        tasks.append(asyncio.create_task(keep_time(clock, bus), name="clock"))
    if console is None:
        tasks.append(asyncio.create_task(tell_figures(), name="figures"))
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _open(plan: Plan) -> ZenohBus:
    """Open the bus; when the default address is taken, take the next port and say so."""
    link = plan.link
    for number in range(PORTS_TO_TRY):
        try:
            bus = await ZenohBus.open(link, patience_s=plan.duration_s)
        except ListenError:
            if not plan.may_move or number == PORTS_TO_TRY - 1:
                raise
            address, _, port = link.listen[0].rpartition(":")
            link = Link(site=link.site, listen=(f"{address}:{int(port) + 1}",))
        else:
            if number:
                log.warning(
                    "%s is taken; listening at %s: tell other commands with --connect %s",
                    DEFAULT_ENDPOINT,
                    link.listen[0],
                    link.listen[0],
                )
            return bus
    raise AssertionError("unreachable: the last try raises")


@contextlib.asynccontextmanager
async def _services(plan: Plan, bus: ZenohBus, clock: Clock) -> AsyncGenerator[asyncio.Task[None]]:
    """Run the services, here or as processes; yield the task that ends when they do."""
    here = (bus.link.listen or bus.link.connect)[0]
    log.info("%s of site %s at %s: %s", plan.name, bus.link.site, here, _names(plan.launches))
    async with contextlib.AsyncExitStack() as stack:
        if plan.processes:
            children = Processes(plan.launches, site=bus.link.site, connect=here)
            _tell_what_runs(plan, bus, [children.command(launch) for launch in plan.launches])
            await stack.enter_async_context(children)
            work = asyncio.create_task(_forever(), name="children")
        else:
            _tell_what_runs(plan, bus, [("pointit", *sys.argv[1:])] * len(plan.launches))
            work = asyncio.create_task(run_services(plan.launches, bus, clock), name="services")
        try:
            yield work
        finally:
            work.cancel()
            await asyncio.wait({work})
            if not work.cancelled():
                work.result()  # a service that failed ends the run with its error, whenever it did


def _tell_what_runs(plan: Plan, bus: ZenohBus, commands: Sequence[tuple[str, ...]]) -> None:
    """Publish what should be running, for `doctor`."""
    services = tuple(
        ExpectedService(service=launch.service.NAME, user=launch.user, command=command)
        for launch, command in zip(plan.launches, commands, strict=True)
    )
    deployment = Deployment(stamp_ns=time.time_ns(), name=plan.name, services=services)
    bus.publisher(DEPLOYMENT, plan.name).put(deployment)


async def _forever() -> None:
    await asyncio.Event().wait()


@contextlib.contextmanager
def _view(
    plan: Plan, bus: ZenohBus, monitor: Monitor, console: Console | None, end_s: float | None
) -> Generator[None]:
    """Draw what happens, if there is a terminal; its Space key is the first person's button."""
    if console is None:
        yield
        return

    def remaining_s() -> float:
        return 0.0 if end_s is None else max(0.0, end_s - time.monotonic())

    person = next((launch.user for launch in plan.launches if launch.user), "")
    title = f"PointIt {plan.name}"
    live = Live(
        get_renderable=lambda: draw(monitor, title, remaining_s, person if has_keyboard() else ""),
        console=console,
        refresh_per_second=REFRESH_HZ,
        transient=True,
    )
    with contextlib.ExitStack() as stack:
        if person and has_keyboard():
            button = bus.publisher(BUTTON, person)

            def press() -> None:
                button.put(ButtonEvent(stamp_ns=monitor.clock.now_ns(), source="keyboard"))

            stack.enter_context(keys(press))
        stack.enter_context(live)
        yield


def _names(launches: Sequence[Launch]) -> str:
    return ", ".join(launch.instance for launch in launches)
