"""`pointit run`: a whole scenario, from its plan to its summary."""

import asyncio
import contextlib
import dataclasses
import logging
import sys
import time
from collections.abc import AsyncGenerator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.text import Text

from pointit.cli.common.completions import scenarios
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.parts import DISPLAY_PARTS, LIVE_VIEWS, joined_addition
from pointit.cli.run import run_options
from pointit.cli.summary import check_writable, figures, write_summary
from pointit.launch.plan.launches import (
    Choices,
    assumed_places,
    check_settings,
    stored_mounting_notices,
    stored_offset_notices,
)
from pointit.launch.plan.plan import USUAL, Beside, Plan, read_scenario, scenario_names
from pointit.launch.plan.scenario_catalog import ScenarioCatalog, scenario_launches
from pointit.launch.run.run_site import ScenarioRequests, ViewerPresence, adapt_to_site, clock_of, open_bus
from pointit.launch.run.running_scenario import RunningScenario
from pointit.runtime.bus.site_clock import publish_time
from pointit.runtime.clock import Clock, SimulatedClock, WallClock, wait_up_to
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import present
from pointit.runtime.link.link import DEFAULT_ENDPOINT
from pointit.runtime.link.options import given_credentials, link_options
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.plain_console import PlainConsole, say
from pointit.runtime.service.process import log_options, run_until_shutdown
from pointit.runtime.service.service import check_launches
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health
from pointit.schemas.topics import HEALTH, RUN_SCENARIO

log = logging.getLogger(__name__)

FIGURES_S = 10.0
"""Interval at which a run without a view logs its metrics."""

NO_PEOPLE = "there are no people in this run: `pointit person add anna`, from another terminal, adds one"
"""Notice at the start of a run with `--users 0` or `--site-only`."""


def execute(plan: Plan, log_level: str) -> int:
    """Run the plan. Return the exit code: 0, or 1 if it failed or no cursor ever appeared.

    Selected and missed objects are in the summary and do not affect the exit code.

    Raises:
        ConfigError: If a service cannot work as configured; nothing was started.
    """
    beside = chain.from_iterable(companion.checked() for companion in plan.beside)
    check_launches([*plan.launches, *beside], plan.link.addresses)

    # The view, if there is a terminal for it. Without one, the run logs
    terminal = PlainConsole(stderr=True)
    can_draw = terminal.is_terminal and not terminal.is_dumb_terminal
    is_wanted = plan.view and can_draw
    console = terminal if is_wanted and present(LIVE_VIEWS) else None
    setup_logging(log_level if console is None else "warning", console)

    notes = [*plan.notes, *stored_mounting_notices(plan.launches)]
    if console is not None:  # else the supervisors log their own
        notes += stored_offset_notices(plan.launches)
    for note in notes:
        _print_event(note, console)
    return run_until_shutdown(_run(plan, console))


def _print_event(sentence: str, console: Console | None) -> None:
    """Print `sentence` above the view, or log it."""
    if console is not None:
        console.print(Text(sentence))
    else:
        log.info("%s", sentence)


async def _run(plan: Plan, console: Console | None) -> int:
    bus = await open_bus(plan)
    try:
        run = _Run(await adapt_to_site(plan, bus), bus, console)
        has_failed = True
        try:
            await run.live(await clock_of(plan, bus))
            has_failed = False
        except asyncio.CancelledError:  # a requested end: the summary covers the elapsed time
            has_failed = False
            raise
        finally:
            if run.stage is not None:
                # A run that failed before anybody pointed has nothing to sum up
                has_pointed = run.stage.monitor.first_cursor_unix_s is not None
                if has_pointed or not has_failed:
                    duration_s = run.lasted_s * plan.speed
                    write_summary(run.stage.plan, run.stage.monitor, duration_s, present(DISPLAY_PARTS))
    finally:
        await bus.close()
        for companion in plan.beside:
            closing_note = companion.closing_note()
            if closing_note:
                _print_sentence(closing_note)
    return 0 if run.stage is None else _verdict(run.stage)


def _verdict(scenario: RunningScenario) -> int:
    has_cursor = scenario.saw_cursor or scenario.monitor.first_cursor_unix_s is not None
    if has_cursor or not scenario.plan.scored:
        return 0
    advice = "; ".join(scenario.monitor.warnings())
    if not advice:
        advice = "`pointit doctor` during a run shows what is missing"
    log.error("no cursor ever appeared; %s", advice)
    return 1


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

        def tell(sentence: str) -> None:
            _print_event(sentence, self._console)

        scenario = self.stage = RunningScenario(
            self._plan,
            self._bus,
            self._bus.link,
            clock,
            tell=tell,
            news=None if is_drawn else log.info,
            on_end=self._changed.set,
            on_beside=self._announce,
        )
        async with _printing(scenario, is_drawn=is_drawn):
            try:
                with contextlib.ExitStack() as listening:
                    # Companions join before the services, whose first messages they need
                    listening.callback(self._bus.subscribe(HEALTH, self._on_health).close)
                    for companion in self._plan.beside:
                        listening.enter_context(companion.joined(self._bus))
                    await scenario.begin()
                    if self._plan.is_limited:
                        self._limit_s = scenario.end_s
                    if self._plan.scenario:
                        listening.callback(self._bus.serve(RUN_SCENARIO, self._requests.serve).close)

                    # The view last: until then, errors and notes are lines
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
                _print_sentence(sentence)
            else:
                _print_event(sentence, self._console)

    async def _until_over(self, scenario: RunningScenario) -> None:
        while not scenario.has_ended:
            self._changed.clear()
            if self._requests:
                await self._requests.apply_next(scenario)
                continue
            remaining_s = self._remaining_s()
            if remaining_s is not None and remaining_s <= 0.0:
                return
            await wait_up_to(self._changed, remaining_s)

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

    def _remaining_s(self) -> float | None:
        end_s = self._end_s()
        if end_s is None:
            return None
        if self._limit_s is None:
            end_s = max(end_s, self._viewers.until_s)
        return end_s - time.monotonic()

    def _lasted_s(self, scenario: RunningScenario) -> float:
        """Return the time that `scenario` has run: its duration, if that ended it."""
        now_s = time.monotonic()
        end_s = self._end_s()
        if end_s is not None:
            is_prolonged = self._limit_s is None and self._viewers.until_s > end_s
            if not is_prolonged:
                now_s = min(now_s, end_s)
        return now_s - scenario.began_s


def _print_sentence(sentence: str) -> None:
    """Log `sentence`, or print it on a terminal, as the log hides links, and if the log level hides it."""
    if log.isEnabledFor(logging.INFO) and not sys.stderr.isatty():
        log.info("%s", sentence)
    else:
        say(sentence, err=True)


def new_warnings(health: Mapping[str, Health], shown: set[tuple[str, ...]]) -> list[str]:
    """Return the warnings of services that are not in `shown`, in full, and add them there."""
    sentences: list[str] = []
    for instance, report in list(health.items()):
        for problem in report.all_problems:
            if problem.severity != "warning":
                continue
            identity = (instance, *problem.identity)
            if identity not in shown:
                shown.add(identity)
                sentences.append(f"{instance}: {problem.sentence}")
    return sentences


@contextlib.asynccontextmanager
async def _printing(scenario: RunningScenario, *, is_drawn: bool) -> AsyncGenerator[None]:
    """Publish the site's clock and, without a view, log metrics every `FIGURES_S`."""

    async def tell_figures() -> None:
        shown = set[tuple[str, ...]]()
        while True:
            await asyncio.sleep(FIGURES_S)
            for sentence in new_warnings(scenario.monitor.health, shown):
                log.warning("%s", sentence)
            line = figures(scenario.monitor).plain
            if line:
                log.info("%s", line)

    tasks: list[asyncio.Task[None]] = []
    if isinstance(scenario.clock, WallClock | SimulatedClock):  # services that join use this clock
        clock = publish_time(scenario.clock, scenario.bus)
        tasks.append(asyncio.create_task(clock, name="clock"))
    if not is_drawn:
        tasks.append(asyncio.create_task(tell_figures(), name="figures"))
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _check_people(choices: Choices, people: int) -> None:
    """Raise ConfigError if an option is given for more people than there are."""
    for option, given in (("--imu", choices.imu), ("--pose", choices.poses)):
        if len(given) > people:
            raise ConfigError(f"{option} is given for {len(given)} people, but there are {people} (--users)")


def _explain(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    for name in scenario_names():
        scenario = read_scenario(name)
        click.echo(f"{name}: {scenario.about}")
        if scenario.explained:
            click.echo(click.wrap_text(scenario.explained, 100, "    ", "    "))
        click.echo(f"    pointit run {name}\n")
    context.exit()


@click.command("run", cls=PanelCommand, panels=run_options.PANELS, usual=run_options.USUAL)
@click.argument("scenario", default=USUAL, shell_complete=scenarios)
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_explain, help="explain the scenarios"
)
@run_options.shared_options
@click.option(
    "--users",
    default=1,
    type=click.IntRange(0, 64),
    help="number of people; with 0, add them later with `pointit person add`",
)
@click.option(
    "--method",
    default="",
    show_default=False,
    metavar="METHOD",
    help="selection method. hold: on the object at every timestep of a window; fraction: at "
    "most of them; gauge: a gauge fills during steady pointing, and drains otherwise; "
    "`pointit plugin list` lists others  [default: the scenario's]",
)
@click.option(
    "--output",
    "output",
    default="",
    show_default=False,
    metavar="OUTPUT",
    help="controller of lights: ddp:HOST (WLED), expander:PORT; `pointit plugin list` lists others",
)
@click.option(
    "--ros2",
    is_flag=True,
    help="also join or start a ROS 2 graph, with topics under the names and types of ROS nodes; "
    "`--set ros2.backend.distro=kilted`, domain and more: `pointit service run ros2 --help`",
)
@click.option("--site-only", is_flag=True, help="only shared services; add people with `pointit person add`")
@click.option("--speed", default=1.0, type=Finite(0.1, 20), help="factor of simulated time")
@run_options.part_options
@click.option("--summary", type=click.Path(path_type=Path), help="write the summary to this file, as JSON")
@click.option("--json", "as_json", is_flag=True, help="print the summary as JSON")
@click.option("--connect", multiple=True, help="join this address instead of listening")
@click.option(
    "--listen", multiple=True, help=f"listen here  [default: {DEFAULT_ENDPOINT} or the next free port]"
)
def run(
    scenario: str,
    users: int,
    output: str,
    *,
    site_only: bool,
    speed: float,
    summary: Path | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Run SCENARIO, in which people point at objects: packages on a conveyor (scenario_4) by default.

    `pointit list scenarios` explains all. A .yaml file is a scenario of your own, or a map with things.

    Opens a page in the browser: watch the scene there, or point with the mouse or a phone. The run ends by
    itself, unless a page is open or you run a map of your own. Ctrl-C ends it at once.

    Example: pointit run scenario_4 --users 2 --method gauge
    """
    if summary is not None:
        check_writable(summary)
    if options["listen"] and options["connect"]:
        raise ConfigError("--listen and --connect exclude each other: a run is joined, or joins another")
    chosen = read_scenario(scenario)
    typed = run_options.choices_of(options, output)
    people = 0 if site_only else users
    _check_people(typed, people)

    # What optional rooms add. Their settings come first, since --set wins over them
    part_values = options | {"site_only": not people}
    addition = joined_addition(part.add(chosen, typed, part_values) for part in run_options.PARTS)
    choices = dataclasses.replace(
        typed,
        page=addition.moves_wrists,
        services=(*typed.services, *addition.site_services),
        settings=(*addition.settings, *typed.settings),
    )

    # Only what was typed is checked: parts may set parameters of services that this run lacks
    launches = scenario_launches(chosen, choices, people)
    check_settings(launches, typed, *addition.services)

    duration_s = options["duration"]
    if duration_s is None and not site_only:
        duration_s = chosen.duration_s
    name = Path(scenario).stem
    program = None if site_only else ScenarioCatalog.beginning_with(name, scenario, chosen, choices)
    notes = list(addition.notes)
    if not people:
        notes.append(NO_PEOPLE)
    notes += _ros2_notes(options)
    notes += assumed_places(launches, choices)
    has_address = options["listen"] or options["connect"]
    plan = Plan(
        name=name,
        launches=launches,
        link=run_options.joining(options),
        target_kinds=chosen.target_kinds,
        goal=chosen.goal,
        seed=choices.seed,
        duration_s=duration_s,
        is_limited=options["duration"] is not None,
        speed=speed,
        processes=options["processes"],
        notes=tuple(notes),
        closing_note=addition.closing_note,
        may_move=not has_address,
        scored=not site_only,
        view=not options["no_view"],
        summary=summary,
        as_json=as_json,
        beside=list(addition.beside),
        watchers=list(addition.watchers),
        scenario=name,
        title=chosen.title_as(name),
        offers=() if program is None else program.offered,
        localizes=choices.localize,
        another=None if program is None else program.plan,
    )
    return execute(plan, options["log_level"])


def _ros2_notes(options: dict[str, Any]) -> tuple[str, ...]:
    has_address = options["listen"] or options["connect"]
    if has_address or not options["ros2"] or given_credentials() is not None:
        return ()
    return (f"7447 is the ROS router's port: give other commands --connect {run_options.BESIDE_ROS}",)


for _parameter in link_options():
    if _parameter.name not in {known.name for known in run.params}:
        run.params.append(_parameter)
run.params += log_options()
