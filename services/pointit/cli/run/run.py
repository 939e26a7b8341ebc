"""`pointit run`: a whole scenario."""

import dataclasses
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.completed_names import scenarios
from pointit.cli.common.option_types import Finite
from pointit.cli.common.panels import PanelCommand
from pointit.cli.display.summary import check_writable
from pointit.cli.run import run_options
from pointit.cli.run.execution import execute
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import Plan
from pointit.launch.plan.scenario import USUAL, read_scenario, scenario_names
from pointit.launch.plan.scenario_catalog import ScenarioCatalog, scenario_launches
from pointit.launch.plan.settings import check_settings
from pointit.launch.plan.startup_notices import assumed_places
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import DEFAULT_ENDPOINT
from pointit.runtime.link.options import given_credentials, link_options
from pointit.runtime.service.process import log_option

NO_PEOPLE = "there are no people in this run: `pointit person add anna`, from another terminal, adds one"
"""Notice at the start of a run with `--users 0` or `--site-only`."""


def _check_people(choices: Choices, people: int) -> None:
    """Raise ConfigError if an option is given for more people than there are."""
    for option, given in (("--imu", choices.imu), ("--pose", choices.poses)):
        if len(given) > people:
            raise ConfigError(f"{option} is given for {len(given)} people, but there are {people} (--users)")


def _explain(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:  # noqa: FBT001 - click's
    if not wanted or context.resilient_parsing:
        return
    for name in scenario_names():
        scenario = read_scenario(name)
        click.echo(f"{name}: {scenario.about}")
        if scenario.explained:
            click.echo(click.wrap_text(scenario.explained, 100, "    ", "    "))
        click.echo(f"    pointit run {name}\n")
    context.exit()


@click.command(
    "run", cls=PanelCommand, panels=run_options.PANELS, usual=run_options.USUAL, optional=run_options.OPTIONAL
)
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
    "--leds",  # of version 0.1
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

    Opens a page in the browser: watch the scene there, or point with the mouse or a phone. The run ends
    by itself, unless a page is open or it is a map of your own. Ctrl-C ends it at once.

    Example: pointit run scenario_4 --users 2 --method gauge
    """
    if summary is not None:
        check_writable(summary)
    if scenario == "replay":
        raise ConfigError(
            "a recorded arm is no scenario: `pointit import FILE.csv --to FILE.mcap` makes a recording of "
            "it, and `pointit replay FILE.mcap` runs the services on it"
        )
    if options["listen"] and options["connect"]:
        raise ConfigError("--listen and --connect exclude each other: a run is joined, or joins another")
    chosen = read_scenario(scenario)
    choices = run_options.choices_of(options, output)
    people = 0 if site_only else users
    _check_people(choices, people)
    added = [part.add(chosen, choices, options | {"site_only": not people}) for part in run_options.PARTS]
    given = [setting for each in added for setting in each.settings]
    is_moved = any(each.moves_wrists for each in added)
    asked = choices
    choices = dataclasses.replace(choices, page=is_moved, settings=(*given, *choices.settings))
    launches = scenario_launches(chosen, choices, people)
    check_settings(launches, asked, *(name for each in added for name in each.services))
    duration_s = options["duration"]
    if duration_s is None and not site_only:
        duration_s = chosen.duration_s
    name = Path(scenario).stem
    program = None if site_only else ScenarioCatalog.beginning_with(name, scenario, chosen, choices)
    plan = Plan(
        name=name,
        launches=launches,
        link=run_options.joining(options),
        target_kinds=chosen.target_kinds,
        seed=choices.seed,
        duration_s=duration_s,
        is_limited=options["duration"] is not None,
        speed=speed,
        processes=options["processes"],
        notes=(
            *(note for each in added for note in each.notes),
            *([] if people else [NO_PEOPLE]),
            *_ros2_notes(options),
            *assumed_places(launches, choices),
        ),
        closing_note=" ".join(each.closing_note for each in added if each.closing_note),
        may_move=not options["listen"] and not options["connect"],
        scored=not site_only,
        view=not options["no_view"],
        summary=summary,
        as_json=as_json,
        beside=[beside for each in added for beside in each.beside],
        watchers=[watcher for each in added for watcher in each.watchers],
        scenario=name,
        scenarios=() if program is None else program.offered,
        localizes=choices.localize,
        another=None if program is None else program.plan,
    )
    return execute(plan, options["log_level"])


def _ros2_notes(options: dict[str, Any]) -> tuple[str, ...]:
    if not options["ros2"] or options["listen"] or options["connect"] or given_credentials() is not None:
        return ()
    return (f"7447 is the ROS router's port: give other commands --connect {run_options.BESIDE_ROS}",)


for _parameter in link_options():
    if _parameter.name not in {known.name for known in run.params}:
        run.params.append(_parameter)
run.params.append(log_option())
