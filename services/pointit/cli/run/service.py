"""`pointit service NAME`: equivalent to `python -m` with its module."""

from collections.abc import Callable

import click

from pointit.cli.common.lazy import Entry, LazyGroup
from pointit.cli.common.output import Section, json_option, show
from pointit.cli.run.list import services
from pointit.launch.plan.extras import load
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.process import service_command, unavailable_command
from pointit.services.registry import PROCESSES, names, process


def _loader(name: str) -> Callable[[], click.Command]:
    def loaded() -> click.Command:
        row = process(name)
        try:
            return service_command(load(row), row.label)
        except ConfigError as error:  # its help is available before its dependencies are installed
            return unavailable_command(row.name, row.scope, f"{row.about}\n\n{error}.", row.config(), error)

    return loaded


ABOUT = {row.name: f"({row.scope}) {row.about}" for row in PROCESSES}


@click.command(
    "service",
    cls=LazyGroup,
    kind="service",
    entries=[
        Entry(name=name, about=ABOUT.get(name, "of another package"), load=_loader(name)) for name in names()
    ],
    invoke_without_command=True,
    subcommand_metavar="NAME [OPTIONS]...",
)
@json_option
@click.pass_context
def command(ctx: click.Context, *, as_json: bool) -> None:
    """Run one service by itself; without a NAME, list the services.

    Services of a person (scope user) need --user; those of scope site are shared by all. `pointit service
    NAME --help` documents every parameter with its unit and default.
    """
    if ctx.invoked_subcommand is not None:
        return
    full = services()
    rows = tuple({key: row[key] for key in ("name", "scope", "about")} for row in full.rows)
    show([Section(name=full.name, about=full.about, rows=rows)], as_json=as_json)
