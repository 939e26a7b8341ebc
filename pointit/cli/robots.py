"""`pointit robot list` and `stop`, and robots in the terminal view."""

import asyncio
from collections.abc import Collection, Mapping
from typing import Any, Literal

import click
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import OutputSection, Row, json_option, print_json, say, show
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.summary import DisplayPart
from pointit.cli.view import ROOMY_WIDTH, color_of
from pointit.launch.robots import RobotWatcher, goal_lines, score_lines
from pointit.launch.run.monitor import Monitor
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import PointItError
from pointit.runtime.service.process import EXIT_FAILED
from pointit.schemas import RobotPlan, RobotState, StopRobot
from pointit.schemas.system import split_instance
from pointit.schemas.topics import ROBOT_PLAN, ROBOT_STATE, SERVICE_ALIVE, STOP_ROBOT, check_name

Found = RobotState | Literal["silent", "lost"]
"""A robot's state; `silent`: its process says nothing, `lost`: its process has ended."""
WITHOUT_STATE = {
    "silent": "its service says nothing: see `pointit doctor`",
    "lost": "its process has ended: look after the robot, then start its process again",
}

LOOK_S = 0.5
"""Time in which robots are found; they say their state ten times a second."""


def robot_lines(monitor: Monitor, width: int) -> RenderableType | None:
    """Return a row for each robot in columns of constant width, or None if none is known."""
    robots = _robots(monitor)
    if not robots:
        return None
    is_roomy = width >= ROOMY_WIDTH
    columns = [("robot", 6), ("steered by", 10), ("phase", 10), ("target", 14)]
    if is_roomy:
        columns += [("at", 18), ("battery", 7)]
    gap = 2 if is_roomy else 1
    table = Table(box=None, padding=(0, gap, 0, 0), header_style="dim")
    for column, least in columns:
        table.add_column(column, no_wrap=True, min_width=least)
    for name, state in robots:
        cells = [Text(name, style="bold"), *_state_cells(monitor, state)]
        table.add_row(*cells[: len(columns)])
    return table


def _state_cells(monitor: Monitor, state: RobotState) -> list[Text]:
    user = Text("-")
    if state.user:
        user = Text(state.user, style=color_of(monitor, state.user))
    has_problem = state.phase in ("stopped", "lost")
    phase_name = state.phase.replace("_", " ")
    phase = Text(phase_name, style="yellow" if has_problem else "")
    target = "-"
    if state.target_m is not None:
        target_x_m, target_y_m = state.target_m[:2]
        target = f"{target_x_m:.1f}, {target_y_m:.1f} m"
    x_m, y_m, z_m = state.position_m
    position = f"{x_m:.1f}, {y_m:.1f}, {z_m:.1f} m"
    battery = "-" if state.battery is None else f"{state.battery:.0%}"
    return [user, phase, Text(target), Text(position), Text(battery)]


def reason_lines(monitor: Monitor) -> list[Text]:
    """Return a line with the reason of each robot that does not move as asked."""
    lines: list[Text] = []
    for name, state in _robots(monitor):
        if state.reason:
            lines.append(Text.assemble((f"{name}: ", "bold"), (state.reason, "yellow")))
    return lines


def _robots(monitor: Monitor) -> list[tuple[str, RobotState]]:
    """Return the robots; in the view of one person, theirs and those that nobody steers."""
    robots: list[tuple[str, RobotState]] = []
    for watcher in monitor.watchers:
        if isinstance(watcher, RobotWatcher):
            robots += sorted(watcher.states.items())
    if not monitor.person:
        return robots
    return [(name, state) for name, state in robots if state.user in ("", monitor.person)]


def _summary(summary: Mapping[str, Any]) -> list[str]:
    scores = score_lines(summary.get("robots", {}))
    goals = goal_lines(summary.get("goals_without_robot", {}))
    return scores + goals


ROBOTS_DISPLAY = DisplayPart(rows=robot_lines, lines=reason_lines, summary=_summary)


async def find_robots(bus: Bus) -> dict[str, Found]:
    """Return the robots, by name, each with its last state or why there is none.

    Those whose process has ended are known by their last plan, which the keeper has.
    """
    states: dict[str, RobotState] = {}
    planned: set[str] = set()

    def on_state(state: RobotState, robot: str) -> None:
        states[robot] = state

    def on_plan(_plan: RobotPlan, robot: str) -> None:
        planned.add(robot)

    # States arrive while presence is asked for
    subscriptions = (bus.subscribe(ROBOT_STATE, on_state), bus.subscribe(ROBOT_PLAN, on_plan))
    try:
        present = await list_present(bus, SERVICE_ALIVE, LOOK_S)
    finally:
        for subscription in subscriptions:
            subscription.close()
    names: set[str] = set()
    for service, name in map(split_instance, present):
        if service == STOP_ROBOT.server:
            names.add(name or service)

    # A robot with a state needs no reason for having none
    robots: dict[str, Found] = {}
    for name in planned:
        robots[name] = "lost"
    for name in names:
        robots[name] = "silent"
    robots |= states
    return dict(sorted(robots.items()))


async def stop_robots(bus: Bus, names: Collection[str], reason: str = "") -> dict[str, str]:
    """Ask all robots `names` at the same time to stop. Return the answer of each that has not, by name."""
    problems: dict[str, str] = {}

    async def stop(name: str) -> None:
        try:
            await bus.call(STOP_ROBOT, StopRobot(reason=reason), name)
        except PointItError as error:
            problems[name] = str(error)

    async with asyncio.TaskGroup() as group:
        for name in names:
            group.create_task(stop(name))
    return problems


def rows(robots: Mapping[str, Found]) -> tuple[Row, ...]:
    """Return a row for each robot."""
    return tuple(_row(name, state) for name, state in robots.items())


def _row(name: str, found: Found) -> Row:
    if isinstance(found, str):
        return {
            "robot": name,
            "kind": "",
            "phase": found,
            "user": "",
            "x_m": None,
            "y_m": None,
            "z_m": None,
            "battery": None,
            "reason": WITHOUT_STATE[found],
        }
    x_m, y_m, z_m = found.position_m
    return {
        "robot": name,
        "kind": found.kind,
        "phase": found.phase,
        "user": found.user,
        "x_m": x_m,
        "y_m": y_m,
        "z_m": z_m,
        "battery": found.battery,
        "reason": found.reason,
    }


@site_command("list")
@json_option
async def list_robots(site: SiteAddress, *, as_json: bool) -> int:
    """List the robots of a site with position, user, and the reason if one does not move.

    The exit code is 1 if there is none.

    Example: pointit robot list --json
    """
    async with site.join() as bus:
        robot_rows = rows(await find_robots(bus))
    if not robot_rows and not as_json:
        say("no robot is here; start one: `pointit service run robot --name NAME`", err=True)
    else:
        section = OutputSection(
            name="robots",
            about="stop one with `pointit robot stop NAME`",
            rows=robot_rows,
            roomy=frozenset({"battery"}),
        )
        show([section], as_json=as_json)
    return 0 if robot_rows else EXIT_FAILED


@site_command("stop")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--all", "everything", is_flag=True, help="stop all robots of the site")
@click.option(
    "--reason",
    default="",
    show_default=False,
    metavar="TEXT",
    help="reason in a few words, shown to the user who steers the robot",
)
@json_option
async def stop(
    site: SiteAddress, names: tuple[str, ...], *, everything: bool, reason: str, as_json: bool
) -> int:
    """Stop the robots NAME, or --all: each stays where it is until somebody takes it again.

    Anybody may stop a robot. This is not a safety function: keep each robot's emergency stop at hand. The
    exit code is 1 if a robot has not answered.

    Example: pointit robot stop --all
    """
    if names and everything:
        raise UnknownNameError("give either the robots to stop or --all, not both")
    if not names and not everything:
        raise UnknownNameError("name the robots to stop, or give --all; `pointit robot list` shows them")
    for name in names:
        check_name(name, "robot")
    async with site.join() as bus:
        # A robot that is named is asked in any case: its service may be slow to report
        chosen = list(names)
        if not chosen:
            robots = await find_robots(bus)
            chosen = [name for name, state in robots.items() if state != "lost"]
        problems = await stop_robots(bus, chosen, reason[:200])

    if as_json:
        stopped = [name for name in chosen if name not in problems]
        print_json({"stopped": stopped, "problems": problems})
    else:
        for name in chosen:
            is_failed = name in problems
            outcome = problems.get(name) or "is told to stop; nobody steers it"
            say(f"{name}: {outcome}", err=is_failed)
        if not chosen:
            say("no robot is here", err=True)
    has_failed = bool(problems) or not chosen
    return EXIT_FAILED if has_failed else 0
