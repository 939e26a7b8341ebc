"""A run from its plan to its summary: bus, clock, services here or as processes, view, score."""

import asyncio
import contextlib
import json
import logging
import os
import sys
import time
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.live import Live

from pointit.cli.monitor import Monitor
from pointit.cli.processes import Processes
from pointit.cli.score import Score, summary_lines
from pointit.cli.view import REFRESH_HZ, draw
from pointit.runtime import Clock, ConfigError, Launch, ListenError, SimulatedClock, WallClock, run_services
from pointit.runtime.log import setup_logging
from pointit.runtime.process import run_async
from pointit.runtime.zenoh_bus import ZenohBus
from pointit.runtime.zenoh_session import DEFAULT_ENDPOINT, Link
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.topics import CLOCK, DEPLOYMENT

log = logging.getLogger(__name__)

PORTS_TO_TRY = 10
"""Ports from the default on that `run` tries before it gives up."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run needs to know."""

    name: str
    launches: Sequence[Launch]
    link: Link
    target_kinds: Sequence[str] = ()
    seed: int = 0
    duration_s: float | None = None
    speed: float = 1.0
    processes: bool = False
    may_move: bool = False
    """The address to listen on is only the default: take the next port when it is taken."""
    scored: bool = True
    """A whole scenario: sum it up at the end, and without any cursor it has failed."""
    view: bool = True
    summary: Path | None = None
    as_json: bool = False


def check_writable(summary: Path) -> None:
    """Make sure, before a run, that its summary can be written after it.

    Raises:
        ConfigError: says why not.
    """
    if summary.is_dir():
        raise ConfigError(f"--summary {summary}: is a directory, give a file in it")
    if not summary.parent.is_dir():
        raise ConfigError(f"--summary {summary}: there is no directory {summary.parent}")
    if not os.access(summary if summary.exists() else summary.parent, os.W_OK):
        raise ConfigError(f"--summary {summary}: cannot be written (Permission denied)")


def execute(plan: Plan, log_level: str) -> int:
    """Run the plan; return the exit code: 0 well, 1 when it failed or no cursor ever appeared.

    What people selected or missed is in the summary and does not make the run itself a failure.
    """
    console = Console(stderr=True)
    drawn = plan.view and console.is_terminal and not console.is_dumb_terminal
    setup_logging(log_level if not drawn else "warning", console if drawn else None)
    return run_async(_run(plan, console if drawn else None))


async def _run(plan: Plan, console: Console | None) -> int:
    """Run the plan to its end; sum it up even when it is cut short."""
    bus = await _open(plan)
    try:
        clock: Clock = SimulatedClock(plan.speed) if plan.speed != 1.0 else WallClock()
        monitor = Monitor(Score(plan.target_kinds), clock)
        monitor.attach(bus)
        if isinstance(clock, SimulatedClock):
            bus.publisher(CLOCK).put(clock.tick())
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
                _sum_up(plan, monitor, (time.monotonic() - began_s) * plan.speed)
    finally:
        await bus.close()
    if plan.scored and monitor.first_cursor_unix_s is None:
        log.error("no cursor ever appeared; `pointit doctor` during a run says what is missing")
        return 1
    return 0


async def _live(plan: Plan, bus: ZenohBus, clock: Clock, monitor: Monitor, console: Console | None) -> None:
    """Run the services for the plan's duration, or until they end."""
    end_s = None if plan.duration_s is None else time.monotonic() + plan.duration_s / plan.speed
    async with _services(plan, bus, clock) as work:
        with _view(plan, monitor, console, end_s):
            timeout = None if end_s is None else max(0.0, end_s - time.monotonic())
            await asyncio.wait({work}, timeout=timeout)
            if work.done():
                work.result()


async def _open(plan: Plan) -> ZenohBus:
    """Open the bus; when the default address is taken, take the next port and say so."""
    link = plan.link
    for number in range(PORTS_TO_TRY):
        try:
            bus = await ZenohBus.open(link)
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
            simulated = isinstance(clock, SimulatedClock)
            children = Processes(plan.launches, site=bus.link.site, connect=here, simulated_time=simulated)
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


def _view(
    plan: Plan, monitor: Monitor, console: Console | None, end_s: float | None
) -> contextlib.AbstractContextManager[Any]:
    if console is None:
        return contextlib.nullcontext()

    def remaining_s() -> float:
        return 0.0 if end_s is None else max(0.0, end_s - time.monotonic())

    title = f"PointIt {plan.name}"
    return Live(
        get_renderable=lambda: draw(monitor, title, remaining_s),
        console=console,
        refresh_per_second=REFRESH_HZ,
        transient=True,
    )


def _sum_up(plan: Plan, monitor: Monitor, duration_s: float) -> None:
    """Print the summary, and write it where it is wanted; `duration_s` may hold the time that ending took."""
    if not (plan.scored or plan.summary is not None or plan.as_json):
        return
    summary: dict[str, Any] = {
        "scenario": plan.name,
        "site": plan.link.site,
        "seed": plan.seed,
        "duration_s": round(min(duration_s, plan.duration_s or duration_s), 3),
        "speed": plan.speed,
        "target_kinds": list(plan.target_kinds),
        **monitor.score.counts(),
        "latency_ms": monitor.latency.quantiles_ms(),
        "cursors": monitor.cursor_count,
        "frames": monitor.frame_count,
        "first_cursor_unix_s": monitor.first_cursor_unix_s,
        "services": [launch.instance for launch in plan.launches],
    }
    if plan.as_json:
        click.echo(json.dumps(summary, indent=2))
    else:
        for line in summary_lines(summary):
            click.echo(line)
    if plan.summary is not None:
        try:
            plan.summary.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{plan.summary}: cannot be written ({error.strerror or error})") from error


def _names(launches: Sequence[Launch]) -> str:
    return ", ".join(launch.instance for launch in launches)
