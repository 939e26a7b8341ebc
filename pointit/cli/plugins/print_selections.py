"""Command that prints who points at what, as it happens."""

import click

import pointit
from pointit.commands import json_option, print_json, say


@click.command()
@click.option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), help="time to watch, s  [default: no end]"
)
@json_option
def command(*, seconds: float | None, as_json: bool) -> None:
    """Print each selection of a running site.

    Example: pointit NAME --seconds 60
    """
    with pointit.open() as site:
        print_selections(site, seconds, as_json=as_json)


def print_selections(site: pointit.SyncSite, seconds: float | None, *, as_json: bool) -> None:
    """Print the selections of `site` for some seconds, or until Ctrl-C."""
    events = site.selections()
    for event in events if seconds is None else events.during(seconds):
        if as_json:
            print_json({"user": event.user, "event": event.event, "thing": event.thing}, indent=None)
        else:
            say(f"{event.user} {event.event} {event.thing}")
