"""`pointit map`: look at maps before anybody points."""

import click

from pointit.cli.common.lazy import Entry, LazyGroup, from_module

ACTIONS = (
    ("check", "say what is wrong with a map, and what to do", "pointit.cli.maps.check:command"),
    ("plot", "draw a map from above: svg, png or pdf", "pointit.cli.maps.plot:command"),
    ("fetch", "take the map of a ROS 2 node out of its parameters", "pointit.cli.maps.fetch:command"),
    ("list", "list the maps that come with PointIt", "pointit.cli.maps.list:command"),
)
"""Name, one line, and where the command is."""


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
    """Look at maps: where lamps, LED strips, belts and things are.

    A map is a YAML file; that of the ROS toolkit is one. MAP is the name of a shipped one (conveyor) or the
    path of a file (./site.yaml); docs/maps.md says what stands in it.

    Example: pointit map check ./site.yaml && pointit map plot ./site.yaml -o site.svg
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
