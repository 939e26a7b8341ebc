"""`pointit study check`: what is missing or wrong in a study's folder."""

from pathlib import Path

import click


@click.command("check")
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path))
def command(*, folder: Path) -> int:
    """Find missing trials, wrong clocks and broken balance in FOLDER."""
    click.echo(str(folder))
    return 0
