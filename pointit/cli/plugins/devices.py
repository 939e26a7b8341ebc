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

    # Groups of plug-ins, and two that other packages cannot join
    own_groups = {MOCAP: MOCAP_SYSTEMS, HOME: HOME_ASSISTANTS}
    all_groups = {**GROUPS, **own_groups}
    groups = {kind: all_groups[kind] for kind in SECTIONS}
    count = sum(len(group.names) for group in groups.values())
    with progress(count) as tell:
        results = search(groups, seconds, lambda done: tell("searching", done))
    problems = [result for result in results if result.problem]
    if as_json:
        _print_json(results, problems)
        return

    for kind, (_, name, option) in SECTIONS.items():
        devices = rows(results, kind)
        if not devices:
            click.echo(f"No {name} found.")
            continue
        section = OutputSection(
            name=name,
            about=f"`{COMMANDS.get(kind, 'pointit run')} {option} …` uses one",
            rows=tuple({"use": device["use"], "found": device["label"]} for device in devices),
            whole=frozenset({"use"}),
        )
        print_table(console(), section)

    # One line for each reason: several searches may lack the same extra
    names_by_reason: dict[str, list[str]] = {}
    for result in problems:
        names_by_reason.setdefault(result.problem, []).append(result.name)
    for reason, names in names_by_reason.items():
        say(f"{', '.join(names)}: {reason}", err=True)


def _print_json(results: list[SearchResult], problems: list[SearchResult]) -> None:
    tables: dict[str, list[dict[str, Any]]] = {}
    for kind, (name, _, _option) in SECTIONS.items():
        tables[name] = rows(results, kind)
    not_searched: list[dict[str, Any]] = []
    for result in problems:
        not_searched.append({"kind": result.kind, "name": result.name, "reason": result.problem})
    print_json({**tables, "not_searched": not_searched})


def rows(results: list[SearchResult], kind: str) -> list[dict[str, Any]]:
    """Return the devices that plug-ins of `kind` found, in the order of `results`."""
    option = SECTIONS[kind][2]
    devices: list[dict[str, Any]] = []
    for result in results:
        if result.kind != kind:
            continue
        for device in result.found:
            row = {
                "use": _words(result, device, option),
                "name": result.name,
                "address": device.address,
                "label": device.label,
                "details": dict(device.details),
            }
            devices.append(row)
    return devices


def _words(result: SearchResult, device: FoundDevice, option: str) -> str:
    if result.kind == MOCAP:
        arguments = f"{option} {shlex.quote(device.address)}"
        if result.name != "natnet":
            arguments = f"--system {result.name} {arguments}"
        if "port" in device.details:
            arguments += f" --port {device.details['port']}"
        return arguments
    if result.kind == HOME:
        return import_options(device)
    if result.kind == "robot":
        return _parameters(result, device)
    return f"{option} {words(result, device)}"


def _parameters(result: SearchResult, device: FoundDevice) -> str:
    """Return the options that choose a robot: it has several parameters, and is one of the site's."""
    settings = [f"robot.driver={result.name}"]
    for name, value in device.details.items():
        settings.append(f"robot.{result.name}.{name}={value}")
    return " ".join(f"--set {shlex.quote(setting)}" for setting in settings)
