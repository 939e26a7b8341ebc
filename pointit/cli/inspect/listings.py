"""Listings of topics, scenarios, maps, plug-ins and services: `pointit list`, and `list` below each noun."""

from collections.abc import Callable
from typing import Any

import click

from pointit.cli.common.lazy import UnknownNameError, declared
from pointit.cli.common.output import OutputSection, json_option, show
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConfigError
from pointit.schemas import topics as table
from pointit.services.registry import PROCESSES, Process, add_installed, names

OPTIONS = {
    "imu-source": "--imu ",
    "led-output": "--output ",
    "recogniser": "listen --recogniser ",
    "robot": "--set robot.driver=",
    "selection-method": "--method ",
    "service": "--with ",
}
"""Options of `pointit run`, or of another command, that choose a plug-in, by its kind."""


def services() -> OutputSection:
    """Return the process table. Services of other packages are not imported, so their topics are unknown."""
    rows = [_service_row(row) for row in PROCESSES]
    unknown = dict.fromkeys(("scope", "extra", "reads", "writes", "serves"))
    for name in names()[len(PROCESSES) :]:
        from pointit.services.service_plugin import SERVICES  # noqa: PLC0415 - only if there is one

        summary = SERVICES.foreign_summary(name) or ""
        about = f"{summary} ({SERVICES.package(name)})".strip()
        rows.append({"name": name, **unknown, "about": about})
    return OutputSection(
        name="services",
        about="run one with `pointit service run NAME`",
        rows=tuple(rows),
        roomy=frozenset({"extra", "reads", "writes", "serves"}),
    )


def _service_row(row: Process) -> dict[str, Any]:
    reads = [topic.key for topic in row.reads]
    writes = [topic.key for topic in row.writes]
    serves = [request.key for request in row.serves]
    return {
        "name": row.name,
        "scope": row.scope,
        "extra": row.extra,
        "reads": reads,
        "writes": writes,
        "serves": serves,
        "about": row.about,
    }


def topics() -> OutputSection:
    """Return the topics."""
    return OutputSection(
        name="topics",
        about="keys below pointit/<site>, see them with `pointit topic echo KEY`",
        rows=tuple(map(_topic_row, table.TOPICS)),
        roomy=frozenset({"message", "writers"}),
    )


def _topic_row(topic: table.Topic[Any]) -> dict[str, Any]:
    return {
        "key": topic.key,
        "message": topic.message.schema_name(),
        "delivery": topic.delivery.value,
        "rate_hz": topic.rate_hz,
        "writers": topic.writers,
        "about": topic.about,
    }


def requests() -> OutputSection:
    """Return the requests."""
    return OutputSection(
        name="requests",
        about="requests, and the service that replies to each",
        rows=tuple(map(_request_row, table.REQUESTS)),
        roomy=frozenset({"query", "reply"}),
    )


def _request_row(request: table.Request[Any, Any]) -> dict[str, Any]:
    return {
        "key": request.key,
        "query": request.query.schema_name(),
        "reply": request.reply.schema_name(),
        "server": request.server,
        "about": request.about,
    }


def presence() -> OutputSection:
    """Return the tokens that exist as long as their owners."""
    rows = [{"key": token.key, "about": token.about} for token in table.PRESENCES]
    return OutputSection(name="presence", about="tokens that exist as long as their owners", rows=tuple(rows))


def scenarios() -> OutputSection:
    """Return the shipped scenarios."""
    from pointit.launch.plan.plan import read_scenario, scenario_names  # noqa: PLC0415

    rows: list[dict[str, Any]] = []
    for name in scenario_names():
        scenario = read_scenario(name)
        own_services = [*scenario.site, *scenario.user]
        rows.append({"name": name, "services": own_services, "about": scenario.about})
    return OutputSection(
        name="scenarios",
        about="run one with `pointit run NAME`",
        rows=tuple(rows),
        roomy=frozenset({"services"}),
    )


def maps() -> OutputSection:
    """Return the shipped maps."""
    from pointit.maps.checks.check import about_map, contents  # noqa: PLC0415
    from pointit.maps.file import map_path, read_clouds, read_map_file, shipped_maps  # noqa: PLC0415 - as above

    rows: list[dict[str, Any]] = []
    for name in shipped_maps():
        with map_path(name) as path:
            file = read_map_file(path)
            has = contents(file, read_clouds(path, file))
            rows.append({"name": name, "has": has, "about": about_map(path)})
    return OutputSection(
        name="maps",
        about="use one, or your own file, with `pointit run SCENARIO --set pui.map=NAME`",
        rows=tuple(rows),
    )


def plugins() -> OutputSection:
    """Return the plug-ins of all installed packages. Those of other packages are not imported."""
    from pointit.plugins import GROUPS  # noqa: PLC0415 - not for other listings

    rows: list[dict[str, Any]] = []
    for kind, group in GROUPS.items():
        option = OPTIONS[kind]
        for name in group.names:
            package = group.package(name)
            about = group.foreign_summary(name)
            value = ""

            # One of ours has a line of its own, or the reason for which it cannot be imported
            if about is None:
                try:
                    plugin = group.get(name)
                    value = plugin.value
                    about = plugin.summary
                except ConfigError as error:
                    about = str(error)
            else:
                value = group.stated_value(name)
            use = f"{option}{name}{value}"
            rows.append({"name": name, "use": use, "package": package, "about": about})

    # Commands of other packages, with the reason for which one is not added
    context = click.get_current_context(silent=True)
    refused = getattr(context and context.find_root().command, "refused", {})
    for declaration in declared():
        about = refused.get(declaration, declaration.summary)
        use = f"pointit {declaration.name}"
        package = declaration.package
        rows.append({"name": declaration.name, "use": use, "package": package, "about": about})
    return OutputSection(
        name="plugins",
        about="parts for `pointit run`, `person add` and `listen`, and commands",
        rows=tuple(rows),
    )


SECTIONS: dict[str, Callable[[], OutputSection]] = {
    "scenarios": scenarios,
    "maps": maps,
    "plugins": plugins,
    "services": services,
}
"""Sections by name, in the order shown."""


@click.command("list")
@click.argument("section", required=False)
@json_option
def command(section: str | None, *, as_json: bool) -> None:
    """List scenarios, maps, plug-ins and services, or one SECTION of them.

    Example: pointit list scenarios
    """
    if section is not None and section not in SECTIONS:
        raise UnknownNameError(f"no section {section!r}; {nearest(section, SECTIONS)}")
    names = [section] if section else list(SECTIONS)
    show([SECTIONS[name]() for name in names], as_json=as_json)


def _listing(section: str, noun: str, text: str) -> click.Command:
    """Return the command `pointit NOUN list`."""

    def callback(*, as_json: bool) -> None:
        show([SECTIONS[section]()], as_json=as_json)

    command = click.Command("list", callback=callback, help=f"{text}\n\nExample: pointit {noun} list --json")
    return json_option(command)


list_maps = _listing("maps", "map", "List the shipped maps with their contents.")
list_plugins = _listing(
    "plugins", "plugin", "List the plug-ins of all installed packages, with their usage and problems."
)
list_services = _listing(
    "services",
    "service",
    "List the services with what they read, write and serve.\n\n"
    "Those of scope user belong to a person and need --user; those of scope site are shared by all.",
)


@click.command("list")
@json_option
def list_topics(*, as_json: bool) -> None:
    """Show the topic table: every key with its message, delivery, rate and writers.

    latest: the newest replaces older ones; event: in order, none lost silently; state: late joiners get the
    last value. A rate of - means on change.

    Example: pointit topic list --json
    """
    add_installed()
    show([topics(), requests(), presence()], as_json=as_json)
