"""`pointit map`: check, draw, fetch and list maps."""

import click

from pointit.cli.common.lazy import Entry, LazyGroup, from_module

ACTIONS = (
    ("check", "show errors of a map, and what to do", "pointit.cli.maps.check:command"),
    ("plot", "draw a map from above: svg, png or pdf", "pointit.cli.maps.plot:command"),
    ("fetch", "fetch a map from the parameters of a ROS 2 node", "pointit.cli.maps.fetch:command"),
    ("list", "list the shipped maps", "pointit.cli.maps.list:command"),
)
"""Name, one line, and location of the command."""


@click.command(
    "map",
    cls=LazyGroup,
    kind="action",
    entries=[Entry(name=name, about=about, load=from_module(where)) for name, about, where in ACTIONS],
    invoke_without_command=True,
    subcommand_metavar="ACTION [MAP] [OPTIONS]...",
)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Check, draw, fetch and list maps: positions of lamps, LED strips, belts and objects.

    A map is a YAML file, also that of the ROS toolkit. MAP is the name of a shipped one (conveyor) or the
    path of a file (./site.yaml). The format: docs/reference/maps.md in PointIt's repository.

    Example: pointit map check ./site.yaml && pointit map plot ./site.yaml -o site.svg
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
