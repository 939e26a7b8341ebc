"""`pointit study run`: an experiment, with people or with simulated ones."""

from pathlib import Path

import click


@click.command("run")
@click.argument("study", metavar="FILE", type=click.Path(path_type=Path))
def command(*, study: Path) -> int:
    """Run the study FILE."""
    click.echo(str(study))
    return 0
