"""`pointit plugin new` and `pointit plugin check`: templates of plug-ins, and checks of installed ones."""

import importlib.resources
import keyword
import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory
from typing import Any

import click

from pointit.cli.common import lazy
from pointit.commands import UnknownNameError, json_option, nearest, print_json, remedy, replaced_file
from pointit.plugins import GROUPS, ConfigError, Plugin, SelectionMethod, ServicePlugin
from pointit.runtime.config.installed import OURS
from pointit.schemas.text import system_reason
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.selector.config import SelectorConfig
from pointit.testing import CheckFailedError, Contract, SelectionMethodContract, ServiceContract
from pointit.testing.contract import require_plugin

FAKE_DEVICES = "pointit.fake_devices"
COMMAND = "command"
OPTIONS = (
    *("-c", os.devnull, "-o", "faulthandler_timeout=120"),
    *("-p", "no:terminal", "-p", "no:cacheprovider", "-p", "no:asyncio", "-p", "no:xdist"),
)
"""Options of pytest: no configuration, a traceback after 120 s, and results that this command shows."""

CONTRACTS: dict[str, type[Contract]] = {}
"""Contracts that are tested now, by the name of the file that pytest collects."""
TEST_FILE = f"from {__name__} import CONTRACTS\n\nTestContract = CONTRACTS[__name__]\n"

KINDS = {
    COMMAND: ("print_selections", "pointit.commands", "command", "$name"),
    "imu-source": ("imu_source", "pointit.imu_sources", "SOURCE", "run --imu $name:HOST"),
    "led-output": ("led_output", "pointit.led_outputs", "OUTPUT", "run --output $name:HOST"),
    "recogniser": ("recogniser", "pointit.recognisers", "RECOGNISER", "listen anna --recogniser $name"),
    "selection-method": ("selection_method", "pointit.selection_methods", "METHOD", "run --method $name"),
    "service": ("service", "pointit.services", "SERVICE", "run --with $name"),
}
"""Kinds of plug-ins: template, group of the entry point, name of the object, and command that uses it."""

PARAMETERS = {"imu-source": ImuBridgeConfig.model_fields, "selection-method": SelectorConfig.model_fields}
"""Parameters beside which those of a plug-in have a section, by kind."""

TEMPLATES = "pointit.testing.templates"
COMMON = ("pyproject.toml", "README.md", ".github/workflows/test.yml")
"""Files of every package."""
FAKE_DEVICE = """[project.entry-points."pointit.fake_devices"]
$name = "$module.promises:$contract"

"""
NAME = re.compile(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*\Z")


@dataclass(frozen=True)
class CheckResult:
    """Result of one check."""

    plugin: str
    check: str
    promise: str
    problem: str
    """Empty if the promise is kept."""


Report = Callable[[CheckResult], None]


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

    def report(result: CheckResult) -> None:
        results.append(result)
        if not as_json:
            _print(result)

    # Each result is shown at once: a plug-in takes seconds
    for kind, plugin_name in chosen(name):
        check_plugin(kind, plugin_name, report)
    broken = sum(bool(result.problem) for result in results)
    if as_json:
        print_json([vars(result) for result in results])
    else:
        kept = len(results) - broken
        click.echo(f"{kept} of {len(results)} promises are kept")
    if broken:
        raise SystemExit(1)


def chosen(name: str | None) -> list[tuple[str, str]]:
    """Return kind and name of the plug-ins called `name`, or of all that are not ours.

    Raises:
        UnknownNameError: If there are none.
    """
    packages: dict[tuple[str, str], str] = {}
    for kind, group in GROUPS.items():
        for plugin_name in group.names:
            packages[kind, plugin_name] = group.package(plugin_name)
    for declaration in lazy.declared():
        packages[COMMAND, declaration.name] = declaration.package

    # One name may be that of several kinds
    selection: list[tuple[str, str]] = []
    for (kind, plugin_name), package in packages.items():
        is_foreign = package not in OURS
        if plugin_name == name or (name is None and is_foreign):
            selection.append((kind, plugin_name))
    if selection:
        return selection
    if name is None:
        raise UnknownNameError(
            "no other package has plug-ins; name one of PointIt, as in `pointit plugin check hold`"
        )
    plugin_names = [plugin_name for _, plugin_name in packages]
    raise UnknownNameError(f"no plug-in {name!r} is installed; {nearest(name, plugin_names)}")


def check_plugin(kind: str, name: str, report: Report) -> None:
    """Check a plug-in, and report each result at once.

    Raises:
        ConfigError: If it is one of ours, and the laboratory, which has their devices, is not installed.
    """
    title = f"{kind} {name}"
    if kind == COMMAND:
        report(check_command(title, name))
        return
    try:
        plugin: Plugin = GROUPS[kind].get(name)
        contract = installed_contract(name, plugin)
    except ConfigError as error:
        report(CheckResult(title, "import", "can be imported", str(error)))
        return
    if contract is not None:
        run_contract(title, contract, report)
        return

    # Without a device, most promises cannot be checked. Ours are declared by the laboratory
    is_ours = GROUPS[kind].package(name) in OURS
    if is_ours and find_spec(lazy.LAB.replace("-", "_")) is None:
        raise ConfigError(
            f"{title}: ours are checked with devices of {lazy.LAB}, which is not installed; "
            f"run {remedy('lab')}"
        )
    problem = f"none is declared: add an entry point {name!r} of the group {FAKE_DEVICES}, see docs/how-to/"
    promise = "has a fake device, with which the other promises can be checked"
    report(CheckResult(title, "fake_device", promise, f"{problem}write-a-plug-in.md"))


def check_command(title: str, name: str) -> CheckResult:
    """Check the command `name`, and return the result."""
    root = click.get_current_context().find_root().command
    refused: dict[Any, str] = getattr(root, "refused", {})
    for declaration, reason in refused.items():
        if declaration.name == name and reason:
            return CheckResult(title, "name", "has a name of its own", reason)
    own = [declaration for declaration in lazy.declared() if declaration.name == name]
    try:
        command = lazy.load(own[0].package, name)
    except ConfigError as error:
        return CheckResult(title, "import", "can be imported", str(error))
    return CheckResult(title, "help", "describes itself and its options", _help_problem(command, name))


def _help_problem(command: click.Command, name: str) -> str:
    """Return a sentence on a missing help text of a command or an option, or `""`."""
    if not (command.help or "").strip():
        return "it has no help: give its function a docstring"
    context = click.Context(command, info_name=f"pointit {name}")
    lacking: list[str] = []
    for parameter in command.get_params(context):
        if not isinstance(parameter, click.Option) or parameter.help or parameter.hidden:
            continue
        if parameter.name:
            lacking.append(parameter.name)
    if not lacking:
        return ""
    return f"options without a help text: {', '.join(lacking)}"


def installed_contract(name: str, plugin: Plugin) -> type[Contract] | None:
    """Return the contract that a package declares for its `plugin`, or None if it needs one and has none.

    Raises:
        ConfigError: If it is declared and cannot be imported.
    """
    for entry in entry_points(group=FAKE_DEVICES, name=name):
        try:
            contract: Any = entry.load()
        except Exception as error:  # code of others, which may raise anything when it is imported
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(
                f"fake device {name!r}: {entry.value} cannot be imported ({reason}); correct the entry point"
            ) from error
        if not (isinstance(contract, type) and issubclass(contract, Contract)):
            raise ConfigError(
                f"fake device {name!r}: {entry.value} inherits no contract of pointit.testing; "
                "see docs/how-to/write-a-plug-in.md"
            )
        require_plugin(contract)
        if contract.plugin is plugin:
            return contract

    # These kinds have no device, so their contract needs nothing but the plug-in
    without_device: dict[type[Plugin], type[Contract]] = {
        SelectionMethod: SelectionMethodContract,
        ServicePlugin: ServiceContract,
    }
    contract = without_device.get(type(plugin))
    if contract is None:
        return None
    return type("TestPlugin", (contract,), {"plugin": plugin})


class _Reporter:
    """A plug-in of pytest that reports the results of the tests of one contract."""

    def __init__(self, contract: type[Contract], title: str, report: Report) -> None:
        self._contract = contract
        self._title = title
        self._report = report

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Report the result of a test, unless it was skipped."""
        # A test that passes is reported once, not also for its setup and teardown
        is_step = report.when != "call" and report.passed
        if report.skipped or is_step:
            return
        test = report.nodeid.rpartition("::")[2]
        sentence = (getattr(self._contract, test).__doc__ or test).removesuffix(".")
        promise = f"{sentence[:1].lower()}{sentence[1:]}"

        # The message of a failed check, without the name of its exception
        problem = ""
        if not report.passed:
            crash = getattr(report.longrepr, "reprcrash", None)
            problem = str(crash.message if crash else report.longrepr)
        prefix = f"{CheckFailedError.__module__}.{CheckFailedError.__name__}: "
        problem = problem.removeprefix(prefix)
        self._report(CheckResult(self._title, test.removeprefix("test_"), promise, problem))


def run_contract(title: str, contract: type[Contract], report: Report) -> None:
    """Run pytest on a contract, without configuration. Report each result when its test ends.

    Raises:
        ConfigError: If pytest is not installed, or could not run.
    """
    try:
        import pytest  # noqa: PLC0415 - no command but this one needs it
    except ImportError as error:
        raise ConfigError("pytest is not installed; run `pip install pytest`") from error
    reporter = _Reporter(contract, title, report)
    with TemporaryDirectory(prefix="pointit_") as folder:
        module = f"test_{Path(folder).name}"
        file = Path(folder) / f"{module}.py"
        file.write_text(TEST_FILE, encoding="utf-8")
        CONTRACTS[module] = contract
        try:
            ended = pytest.main([str(file), f"--rootdir={folder}", *OPTIONS], plugins=[reporter])
        finally:
            del CONTRACTS[module]
            sys.modules.pop(module, None)
    if ended not in {pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED}:
        raise ConfigError(f"{title}: pytest could not run its contract {contract.__qualname__} ({ended!r})")


def _print(result: CheckResult) -> None:
    verdict = click.style("kept  ", fg="green")
    if result.problem:
        verdict = click.style("broken", fg="red", bold=True)
    click.echo(f"{verdict} {result.plugin}: {result.promise}")
    if result.problem:
        click.echo(f"       {result.problem}")


@click.command("new")
@click.argument("kind", type=click.Choice(list(KINDS)))
@click.argument("name")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="folder of the package [default: ./NAME]",
)
def new(*, kind: str, name: str, folder: Path | None) -> None:
    """Write a package with a working plug-in NAME of a KIND, and tests that pass.

    The device of the example is connected by TCP, and simulated in tests. Change its connection and its
    messages; the tests show broken promises.

    Example: pointit plugin new imu-source my-wrist
    """
    # A module of this name must not hide another one
    module = name.replace("-", "_")
    is_taken = keyword.iskeyword(module) or module in sys.stdlib_module_names | {"pointit"}
    if is_taken or not NAME.match(name):
        raise ConfigError(f"{name!r} cannot be a package's name: use a-z, 0-9 and -, such as my-wrist")
    check_free(kind, name)
    target = folder or Path(name)
    if target.exists():
        is_empty_folder = target.is_dir() and not any(target.iterdir())
        if not is_empty_folder:
            raise ConfigError(f"{target} exists already: give another --folder, or move it away")

    for path, text in package(kind, name, module).items():
        file = target / path
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with replaced_file(file) as part:
                part.write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"{file} cannot be written ({system_reason(error)}): give another --folder"
            ) from error
    use = Template(KINDS[kind][3]).substitute(name=name)
    click.echo(
        f"{target} is written. Then:\n"
        f"  pip install --editable {target} pytest\n"
        f"  pytest {target}\n"
        f"  pointit plugin check {name}\n"
        f"  pointit {use}"
    )


def check_free(kind: str, name: str) -> None:
    """Check that a plug-in of a `kind` can be found by `name` beside those that are installed.

    Raises:
        ConfigError: If it cannot.
    """
    if kind == COMMAND:
        root: object = click.get_current_context().find_root().command
        names = {entry.name for entry in getattr(root, "entries", ())}
        names.update(declaration.name for declaration in lazy.declared())
        if name in names:
            raise ConfigError(f"`pointit {name}` is a command: choose another name")
        return
    group = GROUPS[kind]
    if name in group.names:
        raise ConfigError(f"{group.label(name)} is installed: choose another name")
    if name.replace("-", "_") in PARAMETERS.get(kind, {}):
        raise ConfigError(f"{name!r} is a parameter of the service that would use it: choose another name")


def package(kind: str, name: str, module: str) -> dict[str, str]:
    """Return the text of each file of a package, by its path in the package's folder."""
    template, group, thing, use = KINDS[kind]
    article = "an" if kind[0] in "aeio" else "a"
    words = {
        "name": name,
        "module": module,
        "kind": kind,
        "article": article,
        "group": group,
        "thing": thing,
        "use": Template(use).substitute(name=name),
        "contract": f"{thing.capitalize()}Promises",
        "tests": "its help and its output",
        "fake": "",
        "fake_device": "",
    }
    sources = importlib.resources.files(TEMPLATES)
    test = "tests/test_command.py"
    files = {"__init__.py": importlib.resources.files("pointit.cli.plugins") / f"{template}.py"}

    # All kinds but a command have promises, and a fake device with which they are checked
    if kind != COMMAND:
        words["tests"] = f"each promise of {article} {kind} is a test"
        words["fake"] = f", `src/{module}/promises.py` its contract, with its device in tests"
        words["fake_device"] = Template(FAKE_DEVICE).substitute(words)
        test = "tests/test_promises.py"
        files = {file: sources / template / file for file in ("__init__.py", "promises.py")}

    # Files that are made of words, then modules that run as they are, with other names
    texts: dict[str, str] = {}
    for path in (*COMMON, test):
        source = sources / "package" / f"{Path(path).name}.txt"
        texts[path] = Template(source.read_text(encoding="utf-8")).substitute(words)
    for file, source in files.items():
        text = source.read_text(encoding="utf-8")
        text = text.replace(f"{TEMPLATES}.{template}", module)
        text = text.replace("template-service", name)
        text = text.replace("pointit NAME", f"pointit {name}")
        text = text.replace("template_service", module)
        texts[f"src/{module}/{file}"] = text
    texts[f"src/{module}/py.typed"] = ""
    return texts
