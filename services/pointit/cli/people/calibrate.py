"""`pointit calibrate`: measure a sensor's mounting, and a person's pointing offset."""

import click

from pointit.cli.common.lazy import Entry, LazyGroup, from_module

CALIBRATIONS = (
    (
        "mounting",
        "mounting of the sensor on the arm: two poses, arm level ahead and straight up",
        "pointit.cli.people.calibrate_mounting:command",
    ),
    (
        "user",
        "pointing offset of the person: pointing at lamps without a cursor",
        "pointit.cli.people.calibrate_user:command",
    ),
)
"""Name, one line, and location of the command."""


@click.command(
    "calibrate",
    cls=LazyGroup,
    kind="calibration",
    entries=[Entry(name=name, about=about, load=from_module(where)) for name, about, where in CALIBRATIONS],
    invoke_without_command=True,
    subcommand_metavar="WHAT USER [OPTIONS]...",
)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Measure what differs from person to person, once; the result is stored.

    First the mounting, if the sensor is worn differently from the configuration: `pointit calibrate
    mounting anna`. Then the person, who must have a known pose: `pointit calibrate user anna`. --show prints
    the stored result and --erase deletes it.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
