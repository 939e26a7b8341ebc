"""`pointit person add` and `pointit service run`: one person's services, or a single service."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.completions import scenarios
from pointit.cli.common.lazy import LazyEntry, LazyGroup, print_help_without_action
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import join_site
from pointit.cli.parts import PERSON_CHECKS
from pointit.cli.run.run import execute
from pointit.cli.run.run_options import PERSON_PANELS, choices_of, joining, shared_options
from pointit.launch.plan.launches import (
    added_services,
    assumed_places,
    check_settings,
    shard_launches,
    user_launches,
)
from pointit.launch.plan.plan import USUAL, Plan, Scenario, read_scenario
from pointit.launch.run.run_site import Found, surroundings
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.host.extras import present
from pointit.runtime.link.options import link_options
from pointit.runtime.service.process import (
    log_options,
    run_until_shutdown,
    service_command,
    unavailable_command,
)
from pointit.schemas.system import check_user
from pointit.services.registry import PROCESSES, names, process

ABOUT = {row.name: f"({row.scope}) {row.about}" for row in PROCESSES}

USUAL_OPTIONS = ("imu", "localize", "poses", "hand", "stature_m", "connect", "duration")


def _loader(name: str) -> Callable[[], click.Command]:
    def loaded() -> click.Command:
        row = process(name)
        try:
            return service_command(row.load(), row.label)
        except ConfigError as error:  # its help is available before its dependencies are installed
            about = f"{row.about}\n\n{error}."
            return unavailable_command(row.name, row.scope, about, row.config(), error)

    return loaded


class ServiceCommandGroup(LazyGroup):
    """Group of the services. Its help has their names only: `pointit service list` describes them."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the names of the services."""
        with formatter.section("Services"):
            formatter.write_text(", ".join(self.list_commands(ctx)))


run_one_service = ServiceCommandGroup(
    name="run",
    kind="service",
    entries=[
        LazyEntry(name=name, about=ABOUT.get(name, "of another package"), load=_loader(name))
        for name in names()
    ],
    callback=print_help_without_action,
    invoke_without_command=True,
    subcommand_metavar="NAME [OPTIONS]...",
    help="""Run one service by itself.

`pointit service list` describes each one and its scope: those of a person (user) need --user. `pointit
service run NAME --help` documents every parameter with its unit and default.

Example: pointit service run pointing --user anna
""",
)


@click.command("add", cls=PanelCommand, panels=PERSON_PANELS, usual=USUAL_OPTIONS)
@click.argument("name")
@shared_options
@click.option(
    "--scenario",
    shell_complete=scenarios,
    help=f"scenario with the parameters  [default: the one that runs, or {USUAL}]",
)
@click.option(
    "--place",
    type=click.IntRange(min=1),
    help="index of the scenario's place, colour and pattern  [default: the first free one]",
)
@click.option(
    "--here",
    is_flag=True,
    help="also compute this person's cursor and hovers in this process, so that their rays do not leave this "
    "machine; repeat here the parameters of the site's pui and selector that are not in its scenario",
)
def command(name: str, scenario: str | None, place: int | None, *, here: bool, **options: Any) -> int:
    """Add the person NAME to a running site: their IMU, pointing, localizer and supervisor.

    Works from any machine (--connect) and for any number of people. Ctrl-C ends it. If the process dies
    without Ctrl-C, `pointit doctor` reports it as missing for one day or until it is restarted and ended by
    Ctrl-C.

    Example: pointit person add anna --imu serial:/dev/ttyUSB0 --localize
    """
    check_user(name)
    for check in present(PERSON_CHECKS):
        check(name)

    # Where the site says what runs there, and which places are free
    if scenario is None or place is None:
        link = joining(options)
        stage: Found | None = (USUAL, 1)
        if link.connect:
            stage = inspect_site(link.site, link.connect)
        if stage is None:
            return 0
        site_scenario, free_place = stage
        scenario = scenario or site_scenario
        place = place or free_place

    chosen: Scenario = read_scenario(scenario)
    choices = dataclasses.replace(choices_of(options), page=True)
    for option, given in (("--imu", choices.imu), ("--pose", choices.poses)):
        if len(given) > 1:
            raise ConfigError(f"{option} is given {len(given)} times for one person")
    shared = added_services(choices, "site")
    if shared:
        raise ConfigError(
            f"--with {shared[0]}: it is shared by all people: start it with `pointit service run {shared[0]}`"
        )

    # Places count from 1 for people
    own_choices = choices.of_one(place - 1)
    launches = user_launches(chosen, own_choices, name, place - 1)
    if here:
        launches += shard_launches(chosen, choices, name)
    check_settings(launches, choices)
    about_place = f"{name} takes part in {Path(scenario).stem}, place {place}"
    notes = (
        f"{about_place}; --scenario, --place change that",
        *assumed_places(launches, own_choices, place - 1),
    )
    plan = Plan(
        name=name,
        launches=launches,
        link=joining(options),
        duration_s=options["duration"],
        is_limited=True,
        processes=options["processes"],
        scored=False,
        view=not options["no_view"],
        person=name,
        notes=notes,
    )
    return execute(plan, options["log_level"])


command.params += [*link_options(), *log_options()]


def inspect_site(site: str, connect: Sequence[str]) -> Found | None:
    """Return the scenario on a site and a free place, or None if interrupted.

    Without a reply it is the default scenario's first place: its run may start later.
    """
    results: list[Found] = []

    async def look() -> int:
        try:
            async with join_site(site, connect) as bus:
                results.append(await surroundings(bus))
        except ConnectError:
            results.append((USUAL, 1))
        return 0

    # Ctrl-C ends it without a result
    run_until_shutdown(look())
    return results[0] if results else None
