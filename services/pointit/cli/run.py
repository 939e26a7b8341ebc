"""`pointit run` and `pointit user`: whole scenarios, or one person's part of one."""

import os
from pathlib import Path
from typing import Any

import click

from pointit.cli.at_start import assumed_places
from pointit.cli.execution import execute
from pointit.cli.finite import Finite
from pointit.cli.launches import Choices, check_settings, site_launches, user_launches
from pointit.cli.newcomer import USUAL, look_round
from pointit.cli.person_options import PERSON_OPTIONS
from pointit.cli.plan import Plan
from pointit.cli.scenario import Scenario, read_scenario, scenario_names
from pointit.cli.summary import check_writable
from pointit.runtime import ConfigError
from pointit.runtime.environment import check_environment
from pointit.runtime.log import setup_logging
from pointit.runtime.process import link_options, log_option, run_async
from pointit.runtime.zenoh_session import DEFAULT_ENDPOINT, Link
from pointit.services.registry import PROCESSES


def _options(function: Any) -> Any:
    """Add the options that `run` and `user` share."""
    for option in reversed(
        [
            click.option(
                "--localize",
                is_flag=True,
                help="find out where people stand by pointing at lamps  [default: they stand at --pose, "
                "or at the scenario's places]",
            ),
            *PERSON_OPTIONS,
            click.option(
                "--seed",
                default=0,
                show_default=True,
                type=click.IntRange(min=0),
                help="of everything random",
            ),
            click.option(
                "--imu",
                multiple=True,
                metavar="SOURCE",
                help="where orientations come from. sim (default): a simulated person, who wants "
                "something, points at it and presses the button. simulated: only a simulated sensor, on an "
                "arm that sweeps to and fro, to try what a device goes through. serial:PORT or "
                "replay:FILE.csv: a device, or its recording. Once for each person",
            ),
            click.option(
                "--config",
                "files",
                multiple=True,
                type=click.Path(path_type=Path),
                help="YAML file that maps services to parameters",
            ),
            click.option(
                "--set",
                "settings",
                multiple=True,
                metavar="SERVICE.PARAMETER=VALUE",
                help="change one parameter; `pointit service NAME --help` shows them",
            ),
            click.option(
                "--duration",
                type=Finite(min=0.1),
                help="seconds until it ends by itself  [default: as the scenario has it, or never]",
            ),
            click.option(
                "--processes", is_flag=True, help="a process for each service  [default: all in one process]"
            ),
            click.option("--no-view", is_flag=True, help="log instead of drawing in the terminal"),
        ]
    ):
        function = option(function)
    return function


def _check_people(choices: Choices, people: int) -> None:
    """Make sure that nothing is said of people that there are not.

    Raises:
        ConfigError: something is.
    """
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
    click.echo(
        "replay: a recorded arm and robot, compared with motion capture\n"
        "    pointit run replay --recording FILE.csv"
    )
    context.exit()


@click.command("run")
@click.argument("scenario", default="scenario_3")
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_explain, help="explain the scenarios"
)
@_options
@click.option("--users", default=1, show_default=True, type=click.IntRange(0, 64), help="how many people")
@click.option(
    "--method",
    type=click.Choice(["hold", "fraction", "gauge"]),
    help="how staying on an object selects it. hold: at every timestep of a window; fraction: at "
    "most of them; gauge: a gauge fills while one points steadily, and drains when one leaves  "
    "[default: the scenario's]",
)
@click.option("--leds", default="", metavar="OUTPUT", help="expander:PORT drives real strips")
@click.option("--site-only", is_flag=True, help="only what all people share; add people with `pointit user`")
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    type=Finite(0.1, 20),
    help="simulated time runs this many times as fast",
)
@click.option("--summary", type=click.Path(path_type=Path), help="write the summary to this file, as JSON")
@click.option("--json", "as_json", is_flag=True, help="print the summary as JSON")
@click.option("--recording", type=click.Path(path_type=Path), help="for `replay`: a person's recorded IMU")
@click.option("--mounting", default="minus_x", show_default=True, help="for `replay`: the sensor on the arm")
@click.option("--connect", multiple=True, help="join this address instead of listening")
@click.option(
    "--listen", multiple=True, help=f"listen here  [default: {DEFAULT_ENDPOINT} or the next free port]"
)
@click.option("--site", default="lab", show_default=True, help="name of the site")
def run(
    scenario: str,
    users: int,
    leds: str,
    recording: Path | None,
    mounting: str,
    *,
    site_only: bool,
    speed: float,
    summary: Path | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Run SCENARIO, in which simulated people or yours point at things.

    scenario_1: lamps show how near one points. scenario_2: a cursor on the strips. scenario_3 (default):
    select moving segments. scenario_4: packages on a conveyor, sent to bays. `--list` explains them.

    `replay` plays a person's recorded IMU instead (--recording FILE.csv). A .yaml file is a scenario of
    your own. It ends by itself with a summary; Ctrl-C ends it at once.

    Example: pointit run scenario_4 --users 2 --method gauge
    """
    if summary is not None:
        check_writable(summary)
    if scenario == "replay":
        if recording is None:
            raise ConfigError("replay needs --recording FILE.csv, a person's recorded IMU")
        from pointit.cli.replay import replay  # noqa: PLC0415 - only what is needed is loaded

        setup_logging(options["log_level"])
        return run_async(
            replay(
                recording,
                speed=speed,
                duration_s=options["duration"],
                mounting=mounting,
                summary=summary,
                as_json=as_json,
            )
        )
    if recording is not None:
        raise ConfigError(
            f"--recording {recording}: only `pointit run replay` takes it; here --imu replay:FILE"
        )
    if options["listen"] and options["connect"]:
        raise ConfigError("--listen and --connect exclude each other: a run is joined, or joins another")
    chosen = read_scenario(scenario)
    choices = _choices(options, leds)
    people = 0 if site_only else users
    _check_people(choices, people)
    launches = site_launches(chosen, choices)
    for index in range(people):
        launches += user_launches(chosen, choices, f"user{index + 1}", index)
    check_settings(launches, choices)
    duration_s = options["duration"]
    if duration_s is None and not site_only:
        duration_s = chosen.duration_s
    plan = Plan(
        name=Path(scenario).stem,
        launches=launches,
        link=_link(options),
        target_kinds=chosen.target_kinds,
        seed=choices.seed,
        duration_s=duration_s,
        speed=speed,
        processes=options["processes"],
        notes=tuple(assumed_places(launches, choices)),
        may_move=not options["listen"] and not options["connect"],
        scored=not site_only,
        view=not options["no_view"],
        summary=summary,
        as_json=as_json,
    )
    return execute(plan, options["log_level"])


@click.command("user")
@click.argument("name")
@_options
@click.option("--scenario", help=f"whose parameters to use  [default: the one that runs there, or {USUAL}]")
@click.option(
    "--place",
    type=click.IntRange(min=1),
    help="which of its places, colours and patterns is theirs  [default: the first that is free]",
)
def user(name: str, scenario: str | None, place: int | None, **options: Any) -> int:
    """Add the person NAME to a site that runs: their IMU, pointing, localizer and supervisor.

    Works from any machine (--connect) and for any number of people; each has keys of their own.

    Example: pointit user anna --imu serial:/dev/ttyUSB0 --localize
    """
    if scenario is None or place is None:
        link = _link(options)
        found = (USUAL, 1) if not link.connect else look_round(link.site, link.connect)
        if found is None:
            return 0
        scenario, place = scenario or found[0], place or found[1]
    chosen: Scenario = read_scenario(scenario)
    choices = _choices(options, "")
    for option, given in (("--imu", choices.imu), ("--pose", choices.poses)):
        if len(given) > 1:
            raise ConfigError(f"{option} is given {len(given)} times for one person")
    launches = user_launches(chosen, choices.of_one(place - 1), name, place - 1)
    check_settings(launches, choices)
    plan = Plan(
        name=name,
        launches=launches,
        link=_link(options),
        duration_s=options["duration"],
        processes=options["processes"],
        scored=False,
        view=not options["no_view"],
        person=name,
        notes=(
            f"{name} takes part in {Path(scenario).stem}, place {place}; --scenario, --place say otherwise",
            *assumed_places(launches, choices.of_one(place - 1), place - 1),
        ),
    )
    return execute(plan, options["log_level"])


for _parameter in link_options():
    if _parameter.name not in {known.name for known in run.params}:
        run.params.append(_parameter)
    user.params.append(_parameter)
run.params.append(log_option())
user.params.append(log_option())


def _choices(options: dict[str, Any], leds: str) -> Choices:
    check_environment(os.environ, [row.name for row in PROCESSES])
    return Choices(
        seed=options["seed"],
        localize=options["localize"],
        targets=options["targets"],
        poses=options["poses"],
        method=options.get("method"),
        hand=options["hand"] or "",
        stature_m=options["stature_m"],
        imu=options["imu"],
        leds=leds,
        files=options["files"],
        settings=options["settings"],
    )


def _link(options: dict[str, Any]) -> Link:
    listen, connect = tuple(options["listen"]), tuple(options["connect"])
    if listen:
        return Link(site=options["site"], listen=listen)
    if connect:
        return Link(site=options["site"], connect=connect)
    return Link(site=options["site"], listen=(DEFAULT_ENDPOINT,))
