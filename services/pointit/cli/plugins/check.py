"""`pointit plugin check`: whether installed plug-ins keep the promises of their kind."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import Any

import click

from pointit.cli.common import installed_commands
from pointit.commands import UnknownNameError, json_option, nearest, print_json, remedy
from pointit.plugins import GROUPS, ConfigError, Plugin, SelectionMethod, ServicePlugin
from pointit.runtime.config.installed import OURS
from pointit.testing import SUITES, Harness, checks, run_checks
from pointit.testing.check import CheckFailedError
from pointit.testing.methods import MethodHarness
from pointit.testing.requirements import require_parameters
from pointit.testing.service import ServiceHarness

FAKE_DEVICES = "pointit.fake_devices"
COMMAND = "command"


@dataclass(frozen=True)
class CheckResult:
    """Result of one check."""

    plugin: str
    check: str
    promise: str
    problem: str
    """Empty if the promise is kept."""


@click.command("check")
@click.argument("name", required=False)
@json_option
def command(*, name: str | None, as_json: bool) -> None:
    """Check that plug-ins keep the promises of their kind: NAME, or all of other packages.

    Devices are simulated. A package declares its simulated device by an entry point of the group
    pointit.fake_devices. Those of PointIt's own plug-ins are in the laboratory. Each plug-in takes some
    seconds. The exit code is 1 if a promise is broken.

    Example: pointit plugin check hold
    """
    results: list[CheckResult] = []
    logging.disable()  # devices come and go on purpose
    try:
        for kind, found in chosen(name):
            for result in examined(kind, found):
                results.append(result)
                if not as_json:
                    _print(result)
    finally:
        logging.disable(logging.NOTSET)
    broken = sum(bool(result.problem) for result in results)
    if as_json:
        print_json([vars(result) for result in results])
    else:
        click.echo(f"{len(results) - broken} of {len(results)} promises are kept")
    if broken:
        raise SystemExit(1)


def chosen(name: str | None) -> list[tuple[str, str]]:
    """Return kind and name of the plug-ins called `name`, or of all that are not ours.

    Raises:
        UnknownNameError: If there are none.
    """
    packages = {(kind, each): group.package(each) for kind, group in GROUPS.items() for each in group.names}
    packages |= {(COMMAND, each.name): each.package for each in installed_commands.declared()}
    found = [
        (kind, each)
        for (kind, each), package in packages.items()
        if each == name or (name is None and package not in OURS)
    ]
    if found:
        return found
    if name is None:
        raise UnknownNameError(
            "no other package has plug-ins; name one of PointIt, as in `pointit plugin check hold`"
        )
    raise UnknownNameError(
        f"no plug-in {name!r} is installed; {nearest(name, [each for _, each in packages])}"
    )


def examined(kind: str, name: str) -> Iterator[CheckResult]:
    """Yield the results of the checks of a plug-in.

    Raises:
        ConfigError: If it is one of ours, and the laboratory, which has their devices, is not installed.
    """
    title = f"{kind} {name}"
    if kind == COMMAND:
        yield from examined_command(title, name)
        return
    try:
        plugin: Plugin = GROUPS[kind].get(name)
        harness = installed_harness(name, plugin)
    except ConfigError as error:
        yield CheckResult(title, "import", "can be imported", str(error))
        return
    if harness is not None:
        for check, problem in run_checks(checks(harness)):
            yield CheckResult(title, check.name, check.promise, problem)
        return
    if GROUPS[kind].package(name) in OURS and find_spec(installed_commands.LAB.replace("-", "_")) is None:
        raise ConfigError(
            f"{title}: ours are checked with devices of {installed_commands.LAB}, which is not installed; "
            f"run {remedy('lab')}"
        )
    try:
        require_parameters(plugin)
    except CheckFailedError as error:
        yield CheckResult(title, "parameters", "describes itself and its parameters", str(error))
    yield CheckResult(
        title,
        "fake_device",
        "has a fake device, with which the other promises can be checked",
        f"none is declared: add an entry point {name!r} of the group {FAKE_DEVICES}, see docs/how-to/"
        "write-a-plug-in.md",
    )


def examined_command(title: str, name: str) -> Iterator[CheckResult]:
    """Yield the results of the checks of the command `name`."""
    root = click.get_current_context().find_root().command
    refused: dict[Any, str] = getattr(root, "refused", {})
    if reason := next((text for each, text in refused.items() if each.name == name), ""):
        yield CheckResult(title, "name", "has a name of its own", reason)
        return
    package = next(each.package for each in installed_commands.declared() if each.name == name)
    try:
        command = installed_commands.load(package, name)
    except ConfigError as error:
        yield CheckResult(title, "import", "can be imported", str(error))
        return
    context = click.Context(command, info_name=f"pointit {name}")
    lacking = [
        each.name
        for each in command.get_params(context)
        if isinstance(each, click.Option) and not each.help and not each.hidden
    ]
    problem = "" if (command.help or "").strip() else "it has no help: give its function a docstring"
    if lacking and not problem:
        problem = f"options without a help text: {', '.join(filter(None, lacking))}"
    yield CheckResult(title, "help", "describes itself and its options", problem)


def installed_harness(name: str, plugin: Plugin) -> Harness[Any] | None:
    """Return the harness that a package declares for its `plugin`, or None if it needs one and has none.

    Raises:
        ConfigError: If it is declared and cannot be imported.
    """
    for entry in entry_points(group=FAKE_DEVICES, name=name):
        try:
            harness: Harness[Any] = entry.load()
        except Exception as error:  # code of others, which may raise anything when it is imported
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(
                f"fake device {name!r}: {entry.value} cannot be imported ({reason}); correct the entry point"
            ) from error
        if type(harness) in SUITES and harness.plugin is plugin:
            return harness
    if isinstance(plugin, SelectionMethod):
        return MethodHarness(plugin=plugin)
    return ServiceHarness(plugin=plugin) if isinstance(plugin, ServicePlugin) else None


def _print(result: CheckResult) -> None:
    verdict = (
        click.style("broken", fg="red", bold=True) if result.problem else click.style("kept  ", fg="green")
    )
    click.echo(f"{verdict} {result.plugin}: {result.promise}")
    if result.problem:
        click.echo(f"       {result.problem}")
