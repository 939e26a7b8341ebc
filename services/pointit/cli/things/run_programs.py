"""The programs of `pointit run`: their option, and their sentences in the summary."""

from collections.abc import Mapping, Sequence
from typing import Any

import click

from pointit.api.reactions import check_things
from pointit.cli.common.run_part import Added, RunPart
from pointit.cli.display.display_part import DisplayPart
from pointit.cli.things.programs import Command, Programs, program_lines
from pointit.launch.plan.launches import Choices, site_launches
from pointit.launch.plan.scenario import Scenario
from pointit.launch.plan.scenario_catalog import room_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch

_option = click.option(
    "--on",
    multiple=True,
    metavar="THING=PROGRAM",
    help="start this program, without a shell, when somebody points at the thing of the map; its arguments "
    "may have {thing}, {user}, {confidence} and {state} (on or off). Repeatable",
)


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> Added:
    """Return the watcher that starts them; ConfigError: there is no such program, or no such thing."""
    commands = [Command.parse(text) for text in options["on"]]
    if not commands:
        return Added()
    room = room_of(site_launches(scenario, choices))
    for command in commands:
        try:
            if room is not None:
                check_things([command.thing], room)
        except ConfigError as error:
            raise ConfigError(f"--on {command.thing}: {error}") from error

    def watcher(_launches: Sequence[Launch]) -> Programs:
        return Programs(commands)

    return Added(watchers=[watcher])


PROGRAMS_PART = RunPart(heading="Things", names=("on",), options=_option, add=_add)

PROGRAMS_DISPLAY = DisplayPart(
    rows=lambda _monitor, _width: None,
    lines=lambda _monitor: (),
    summary=lambda summary: program_lines(summary.get("programs", {})),
)
