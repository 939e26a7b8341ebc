"""`pointit topic list`: the topic table, requests and presence."""

import click

from pointit.cli.common.output import OutputSection, json_option, show
from pointit.schemas import topics as table
from pointit.services.registry import add_installed


def topics() -> OutputSection:
    """Return the topics."""
    return OutputSection(
        name="topics",
        about="keys below pointit/<site>, see them with `pointit topic echo KEY`",
        rows=tuple(
            {
                "key": topic.key,
                "message": topic.message.schema_name(),
                "delivery": topic.delivery.value,
                "rate_hz": topic.rate_hz,
                "writers": topic.writers,
                "about": topic.about,
            }
            for topic in table.TOPICS
        ),
        roomy=frozenset({"message", "writers"}),
    )


def requests() -> OutputSection:
    """Return the requests."""
    return OutputSection(
        name="requests",
        about="requests, and the service that replies to each",
        rows=tuple(
            {
                "key": request.key,
                "query": request.query.schema_name(),
                "reply": request.reply.schema_name(),
                "server": request.server,
                "about": request.about,
            }
            for request in table.REQUESTS
        ),
        roomy=frozenset({"query", "reply"}),
    )


def presence() -> OutputSection:
    """Return the tokens that exist as long as their owners."""
    return OutputSection(
        name="presence",
        about="tokens that exist as long as their owners",
        rows=tuple({"key": token.key, "about": token.about} for token in table.PRESENCES),
    )


@click.command("list")
@json_option
def command(*, as_json: bool) -> None:
    """Show the topic table: every key with its message, delivery, rate and writers.

    latest: the newest replaces older ones; event: in order, none lost silently; state: late joiners get the
    last value. A rate of - means on change.

    Example: pointit topic list --json
    """
    add_installed()
    show([topics(), requests(), presence()], as_json=as_json)
