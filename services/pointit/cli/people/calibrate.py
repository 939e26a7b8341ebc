"""`pointit calibrate`: measure how a sensor is worn, and how a person's pointing is off."""

import click

from pointit.cli.common.lazy import Entry, LazyGroup, from_module

CALIBRATIONS = (
    (
        "mounting",
        "how the sensor sits on the arm: two poses, arm level ahead and straight up",
        "pointit.cli.people.calibrate_mounting:command",
    ),
    (
        "user",
        "how the person's pointing is off: pointing at lamps without a cursor",
        "pointit.cli.people.calibrate_user:command",
    ),
)
"""Name, one line, and where the command is."""


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
    """Measure what differs from person to person, once; it is kept for the next time.

    First the mounting, when the sensor is worn differently from what is configured: `pointit calibrate
    mounting anna`. Then the person, who must have a known place: `pointit calibrate user anna`. What is kept
    is shown by --show and forgotten by --erase.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
