"""`pointit list`: what there is to run."""

from collections.abc import Callable

import click

from pointit.cli.lazy import Mistake, nearest
from pointit.cli.output import Section, json_option, show
from pointit.services.registry import PROCESSES


def services() -> Section:
    """Return the process table."""
    return Section(
        name="services",
        about="run one with `pointit service NAME`",
        rows=tuple(
            {
                "name": row.name,
                "scope": row.scope,
                "about": row.about,
                "reads": [topic.key for topic in row.reads],
                "writes": [topic.key for topic in row.writes],
                "serves": [request.key for request in row.serves],
            }
            for row in PROCESSES
        ),
    )


SECTIONS: dict[str, Callable[[], Section]] = {"services": services}
"""By name, in the order shown; a further section is a further row."""


@click.command("list")
@click.argument("section", required=False)
@json_option
def command(section: str | None, *, as_json: bool) -> None:
    """List what there is to run, or one SECTION of it."""
    if section is not None and section not in SECTIONS:
        raise Mistake(f"no section {section!r}; {nearest(section, SECTIONS)}")
    show([SECTIONS[name]() for name in ([section] if section else SECTIONS)], as_json=as_json)
