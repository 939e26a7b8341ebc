"""`pointit person add`: one person's services, on a running site."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.completed_names import scenarios
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import join_site
from pointit.cli.parts import PERSON_CHECKS
from pointit.cli.run.execution import execute
from pointit.cli.run.run_options import OPTIONAL, PERSON_PANELS, choices_of, joining, shared_options
from pointit.launch.plan.launches import added_services, shard_launches, user_launches
from pointit.launch.plan.plan import Plan
from pointit.launch.plan.scenario import USUAL, Scenario, read_scenario
from pointit.launch.plan.settings import check_settings
from pointit.launch.plan.startup_notices import assumed_places
from pointit.launch.run.run_site import Found, surroundings
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.host.extras import present
from pointit.runtime.link.options import link_options
from pointit.runtime.service.process import log_option
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas.system import check_user

USUAL_OPTIONS = ("imu", "localize", "poses", "hand", "stature_m", "connect", "duration")


@click.command("add", cls=PanelCommand, panels=PERSON_PANELS, optional=OPTIONAL, usual=USUAL_OPTIONS)
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
    if scenario is None or place is None:
        link = joining(options)
        found = (USUAL, 1) if not link.connect else inspect_site(link.site, link.connect)
        if found is None:
            return 0
        scenario, place = scenario or found[0], place or found[1]
    chosen: Scenario = read_scenario(scenario)
    choices = dataclasses.replace(choices_of(options), page=True)
    for option, given in (("--imu", choices.imu), ("--pose", choices.poses)):
        if len(given) > 1:
            raise ConfigError(f"{option} is given {len(given)} times for one person")
    if shared := added_services(choices, "site"):
        raise ConfigError(
            f"--with {shared[0]}: it is shared by all people: start it with `pointit service run {shared[0]}`"
        )
    launches = user_launches(chosen, choices.of_one(place - 1), name, place - 1)
    if here:
        launches += shard_launches(chosen, choices, name)
    check_settings(launches, choices)
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
        notes=(
            f"{name} takes part in {Path(scenario).stem}, place {place}; --scenario, --place change that",
            *assumed_places(launches, choices.of_one(place - 1), place - 1),
        ),
    )
    return execute(plan, options["log_level"])


command.params += [*link_options(), log_option()]


def inspect_site(site: str, connect: Sequence[str]) -> Found | None:
    """Return the scenario on a site and a free place, or None if interrupted.

    Without a reply it is the default scenario's first place: its run may start later.
    """
    found: list[Found] = []

    async def look() -> int:
        try:
            async with join_site(site, connect) as bus:
                found.append(await surroundings(bus))
        except ConnectError:
            found.append((USUAL, 1))
        return 0

    run_until_shutdown(look())
    return found[0] if found else None
