"""`pointit map plot`: draws a map from above."""

import importlib.util
from pathlib import Path

import click

from pointit.cli.common.completed_names import maps
from pointit.cli.maps.person_option import Point, person_option
from pointit.maps.checks.contents import contents
from pointit.maps.checks.things import separability
from pointit.maps.file import map_path, read_whole_map
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

SUFFIXES = (".svg", ".png", ".pdf")


@click.command("plot")
@click.argument("name_or_path", metavar="MAP", shell_complete=maps)
@click.option(
    "-o",
    "--output",
    "picture",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="file of the picture: .svg, .png or .pdf",
)
@person_option
@click.option(
    "--told-apart",
    "shades",
    is_flag=True,
    help="colour the floor by the share of things that pointing from there distinguishes",
)
def command(*, name_or_path: str, picture: Path, person_m: Point | None, shades: bool) -> None:
    """Draw MAP, a shipped one or the path of a file, from above and to scale.

    Shows belts with their direction, strips with their pixel 0, lamps with their height, links, bays,
    solids and point clouds. Needs the extra `plot`: matplotlib

    Example: pointit map plot shelf -o shelf.png --told-apart --person 0.5,-0.5
    """
    if picture.suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f"-o {picture}: not a picture format; give a file that ends in {', '.join(SUFFIXES)}"
        )
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(f"pictures need matplotlib, which is not installed; run {remedy('plot')}")
    with map_path(name_or_path) as path:
        file, room, clouds = read_whole_map(path, 0)
    shares = separability(room.fixed_things) if shades else None
    from pointit.maps.picture.draw_map import draw_map  # noqa: PLC0415 - takes half a second and an extra

    try:
        title = f"{room.name}: {contents(file, clouds)}"
        missing = draw_map(picture, room, clouds, title, person_m, separability=shares)
    except OSError as error:
        raise ConfigError(f"-o {picture}: cannot be written ({error.strerror or error})") from error
    click.echo(f"{picture}: {contents(file, clouds)}")
    if missing:
        letters = missing if missing.isprintable() else repr(missing)
        click.echo(
            f"note: no font here has {letters[:40]}, drawn as ?; install one, such as Noto Sans CJK", err=True
        )
