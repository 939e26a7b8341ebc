"""`pointit service run NAME`: equivalent to `python -m` with its module."""

from collections.abc import Callable

import click

from pointit.cli.common.lazy import LazyEntry, LazyGroup, print_help_without_action
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.process import service_command, unavailable_command
from pointit.services.registry import PROCESSES, names, process


def _loader(name: str) -> Callable[[], click.Command]:
    def loaded() -> click.Command:
        row = process(name)
        try:
            return service_command(row.load(), row.label)
        except ConfigError as error:  # its help is available before its dependencies are installed
            return unavailable_command(row.name, row.scope, f"{row.about}\n\n{error}.", row.config(), error)

    return loaded


ABOUT = {row.name: f"({row.scope}) {row.about}" for row in PROCESSES}


class ServiceCommandGroup(LazyGroup):
    """Group of the services. Its help has their names only: `pointit service list` describes them."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the names of the services."""
        with formatter.section("Services"):
            formatter.write_text(", ".join(self.list_commands(ctx)))


command = ServiceCommandGroup(
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
