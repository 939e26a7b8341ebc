"""`pointit list`: scenarios, maps, plug-ins and services."""

from collections.abc import Callable
from typing import Any

import click

from pointit.cli.common.lazy import UnknownNameError, nearest
from pointit.cli.common.output import Section, json_option, show
from pointit.runtime.errors import ConfigError
from pointit.services.registry import PROCESSES, add_installed


def services() -> Section:
    """Return the process table."""
    add_installed()
    return Section(
        name="services",
        about="run one with `pointit service NAME`",
        rows=tuple(
            {
                "name": row.name,
                "scope": row.scope,
                "about": row.about,
                "extra": row.extra,
                "reads": [topic.key for topic in row.reads],
                "writes": [topic.key for topic in row.writes],
                "serves": [request.key for request in row.serves],
            }
            for row in PROCESSES
        ),
        roomy=frozenset({"extra", "reads", "writes", "serves"}),
    )


def scenarios() -> Section:
    """Return the shipped scenarios."""
    from pointit.launch.plan.scenario import read_scenario, scenario_names  # noqa: PLC0415 - only when asked for

    rows: list[dict[str, Any]] = []
    for name in scenario_names():
        scenario = read_scenario(name)
        rows.append({"name": name, "about": scenario.about, "services": [*scenario.site, *scenario.user]})
    replay = {
        "name": "replay",
        "about": "a recorded arm and robot, compared with motion capture (--recording FILE.csv)",
        "services": ["imu-bridge", "pointing", "localizer", "robot-replay"],
    }
    return Section(name="scenarios", about="run one with `pointit run NAME`", rows=(*rows, replay))


def maps() -> Section:
    """Return the shipped maps."""
    from pointit.maps.file import load_map, shipped_maps  # noqa: PLC0415 - only when asked for

    rows: list[dict[str, Any]] = []
    for name in shipped_maps():
        room = load_map(name, 0)
        rows.append(
            {
                "name": name,
                "strips": len(room.strips),
                "pixels": sum(strip.pixels for strip in room.strips),
                "belts": len(room.belts),
                "links": len(room.links),
                "bays": len(room.bays),
                "lamps": len(room.lamps),
            }
        )
    return Section(
        name="maps", about="use one, or your own file, with `--set pui.map=NAME`", rows=tuple(rows)
    )


OPTIONS = {"imu-source": "--imu", "led-output": "--leds", "selection-method": "--method", "service": "--with"}
"""Options of `pointit run` that choose a plug-in, by its kind."""


def plugins() -> Section:
    """Return the plug-ins of all installed packages, ours among them."""
    from pointit.plugins import GROUPS  # noqa: PLC0415 - only when asked for

    rows: list[dict[str, Any]] = []
    for kind, group in GROUPS.items():
        option = OPTIONS[kind]
        for name in group.names:
            try:
                plugin = group.get(name)
                use, about = f"{option} {name}{plugin.value}", plugin.summary
            except ConfigError as error:
                use, about = f"{option} {name}", str(error)
            rows.append({"use": use, "about": about, "package": group.package(name)})
    return Section(name="plugins", about="parts for `pointit run` and `pointit user`", rows=tuple(rows))


SECTIONS: dict[str, Callable[[], Section]] = {
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
    """List scenarios, maps, plug-ins and services, or one SECTION of them."""
    if section is not None and section not in SECTIONS:
        raise UnknownNameError(f"no section {section!r}; {nearest(section, SECTIONS)}")
    show([SECTIONS[name]() for name in ([section] if section else SECTIONS)], as_json=as_json)
