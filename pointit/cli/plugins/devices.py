"""`pointit devices`: wrists, outputs, robots, motion capture, Home Assistant, and the words for them."""

import shlex
from typing import Any

import click

from pointit.bridges.mocap.mocap_systems import MOCAP_SYSTEMS
from pointit.commands import (
    Finite,
    OutputSection,
    console,
    json_option,
    print_json,
    print_table,
    progress,
    say,
)
from pointit.plugins import GROUPS, FoundDevice
from pointit.plugins.device_search import HOME_ASSISTANTS, IMPORT, SearchResult, import_options, search, words
from pointit.runtime.service.logs import setup_logging

MOCAP = "mocap"
HOME = "home-assistant"
SECTIONS = {
    "imu-source": ("wrists", "wrists", "--imu"),
    "led-output": ("lights", "outputs", "--output"),
    "robot": ("robots", "robots", "--set"),
    MOCAP: ("mocap", "motion capture servers", "--server"),
    HOME: ("home_assistants", "Home Assistants", "--url"),
}
"""Name of the table in JSON, name for people, and option that chooses one, by the kind of device."""
COMMANDS = {MOCAP: "pointit service run mocap", HOME: IMPORT}
"""Commands that use a device, by its kind, if that is not `pointit run`."""


@click.command("devices")
@click.option("--seconds", type=Finite(min=0.1, max=60), default=3.0, help="time for the search, s")
@json_option
def command(*, seconds: float, as_json: bool) -> None:
    """Find wrists, outputs, robots, motion capture and Home Assistants: serial ports, Bluetooth, network.

    All installed plug-ins that can search do so at the same time. Each device is shown with the option of
    `pointit run`, or the command, that uses it. A search that cannot run is listed below with its remedy.

    Example: pointit devices --seconds 10
    """
    setup_logging("warning")
    own = {MOCAP: MOCAP_SYSTEMS, HOME: HOME_ASSISTANTS}
    groups = {kind: own[kind] if kind in own else GROUPS[kind] for kind in SECTIONS}
    with progress(sum(len(group.names) for group in groups.values())) as tell:
        results = search(groups, seconds, lambda done: tell("searching", done))
    problems = [result for result in results if result.problem]
    if as_json:
        tables: dict[str, list[dict[str, Any]]] = {
            name: rows(results, kind) for kind, (name, _, _option) in SECTIONS.items()
        }
        not_searched = [{"kind": each.kind, "name": each.name, "reason": each.problem} for each in problems]
        print_json({**tables, "not_searched": not_searched})
        return
    for kind, (_, name, option) in SECTIONS.items():
        shown = tuple({"use": row["use"], "found": row["label"]} for row in rows(results, kind))
        if shown:
            about = f"`{COMMANDS.get(kind, 'pointit run')} {option} …` uses one"
            print_table(
                console(), OutputSection(name=name, about=about, rows=shown, whole=frozenset({"use"}))
            )
        else:
            click.echo(f"No {name} found.")
    for reason in dict.fromkeys(each.problem for each in problems):
        say(f"{', '.join(each.name for each in problems if each.problem == reason)}: {reason}", err=True)


def rows(results: list[SearchResult], kind: str) -> list[dict[str, Any]]:
    """Return the devices that plug-ins of `kind` found, in the order of `results`."""
    option = SECTIONS[kind][2]
    return [
        {
            "use": _words(result, each, option),
            "name": result.name,
            "address": each.address,
            "label": each.label,
            "details": dict(each.details),
        }
        for result in results
        if result.kind == kind
        for each in result.found
    ]


def _words(result: SearchResult, device: FoundDevice, option: str) -> str:
    if result.kind == MOCAP:
        system = "" if result.name == "natnet" else f"--system {result.name} "
        port = f" --port {device.details['port']}" if "port" in device.details else ""
        return f"{system}{option} {shlex.quote(device.address)}{port}"
    if result.kind == HOME:
        return import_options(device)
    return _parameters(result, device) if result.kind == "robot" else f"{option} {words(result, device)}"


def _parameters(result: SearchResult, device: FoundDevice) -> str:
    """Return the options that choose a robot: it has several parameters, and is one of the site's."""
    values = {f"{result.name}.{name}": value for name, value in device.details.items()}
    return " ".join(
        f"--set {shlex.quote(f'robot.{name}={value}')}"
        for name, value in {"driver": result.name, **values}.items()
    )
