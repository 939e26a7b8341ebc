"""`pointit plugin new` writes packages that work, and `pointit plugin check` finds and checks them."""

import contextlib
import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

import pointit
from pointit.cli.inspect import listings
from pointit.cli.main import front
from pointit.cli.plugins import check, print_selections
from pointit.cli.plugins import check as new
from pointit.plugins import GROUPS
from pointit.runtime.errors import ConfigError
from pointit.testing.contract import Contract
from tests.support import strangers


def invoke(command: click.Command, *arguments: str) -> Result:
    return CliRunner().invoke(command, arguments, catch_exceptions=False)


def written(kind: str, name: str, folder: Path) -> Path:
    """Return the folder of a new package."""
    target = folder / name
    assert f"pointit plugin check {name}" in invoke(new.new, kind, name, "--folder", str(target)).output
    return target


@pytest.fixture
def stack() -> Iterator[contextlib.ExitStack]:
    with contextlib.ExitStack() as stack:
        yield stack


def install(package: Path, stack: contextlib.ExitStack) -> None:
    """Make the package importable, and its entry points visible, for one test."""
    groups = tomllib.loads((package / "pyproject.toml").read_text())["project"]["entry-points"]
    entries = {
        group.removeprefix("pointit."): "\n".join(f"{name} = {value}" for name, value in found.items())
        for group, found in groups.items()
    }
    stack.enter_context(strangers.installed(package / "src", "no_module", "", **entries))


def test_new_package_is_found_and_keeps_its_promises(tmp_path: Path, stack: contextlib.ExitStack) -> None:
    install(written("selection-method", "my-way", tmp_path), stack)
    result = invoke(check.command)  # all of other packages
    assert result.exit_code == 0, result.output
    assert "kept   selection-method my-way: selects the object" in result.output
    assert "6 of 6 promises are kept" in result.output


@pytest.mark.parametrize(
    ("kind", "use"),
    [
        ("imu-source", "--imu my-part:HOST"),
        ("led-output", "--output my-part:HOST"),
        ("selection-method", "--method my-part"),
    ],
)
def test_list_shows_the_use_that_new_prints_without_importing(
    kind: str, use: str, tmp_path: Path, stack: contextlib.ExitStack
) -> None:
    target = tmp_path / "my-part"
    printed = invoke(new.new, kind, "my-part", "--folder", str(target)).output
    install(target, stack)

    rows = {row["name"]: row for row in listings.plugins().rows}

    assert printed.endswith(f" {use}\n")
    assert rows["my-part"]["use"] == use
    assert "my_part" not in sys.modules


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ('MINE = ImuSource(argument="port")', ":PORT"),
        ('MINE: ImuSource = ImuSource(argument="port", example="COM3", argument_optional=True)', "[:COM3]"),
        ("MINE = ImuSource(argument=NAME)", ""),
        ("MINE, OTHER = pair()", ""),
        ("MINE = (", ""),
        ("", ""),
    ],
)
def test_stated_value_is_read_from_the_source(
    source: str, value: str, tmp_path: Path, stack: contextlib.ExitStack
) -> None:
    entry = "mine = strangers_stated:MINE"
    stack.enter_context(strangers.installed(tmp_path, "strangers_stated", source, imu_sources=entry))
    assert GROUPS["imu-source"].stated_value("mine") == value


def test_stated_value_of_a_module_in_a_package_is_read(tmp_path: Path, stack: contextlib.ExitStack) -> None:
    folder = tmp_path / "strangers_room"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise RuntimeError")
    (folder / "wrist.py").write_text('MINE = ImuSource(argument="port")')
    entries = "mine = strangers_room.wrist:MINE\nlost = strangers_room.none:MINE"
    stack.enter_context(strangers.installed(tmp_path, "strangers_other", "", imu_sources=entries))
    values = [GROUPS["imu-source"].stated_value(name) for name in ("mine", "lost")]
    assert values == [":PORT", ""]


def test_each_result_is_reported_before_the_next_promise_is_tested() -> None:
    results: list[check.CheckResult] = []

    class TwoPromises(Contract):
        def test_first(self) -> None:
            """Is tested first."""

        def test_second(self) -> None:
            """Is tested second."""
            assert [each.check for each in results] == ["first"]

    check.run_contract("mine", TwoPromises, results.append)
    assert [(each.promise, each.problem) for each in results] == [
        ("is tested first", ""),
        ("is tested second", ""),
    ]


@pytest.mark.parametrize(
    ("name", "wrong", "said"),
    [
        (
            "my-wrong-way",
            ("0 <= step_ns <= LONGEST_GAP_NS", "step_ns >= 0"),
            ("selects nothing that is not pointed at", "'object 3', and it fired. Begin again"),
        ),
        (
            "my-lost-way",
            ("pointit.plugins", "pointit.lost"),
            ("can be imported", "No module named 'pointit.l"),
        ),
    ],
)
def test_broken_promise_is_named_with_its_remedy(
    name: str, wrong: tuple[str, str], said: tuple[str, str], tmp_path: Path, stack: contextlib.ExitStack
) -> None:
    package = written("selection-method", name, tmp_path)
    module = package / "src" / name.replace("-", "_") / "__init__.py"
    module.write_text(module.read_text().replace(*wrong))
    install(package, stack)
    result = invoke(check.command, name)
    assert result.exit_code == 1
    assert f"broken selection-method {name}: {said[0]}" in result.output
    assert said[1] in result.output


def test_contract_naming_no_plugin_is_reported_and_hides_no_other(
    tmp_path: Path, stack: contextlib.ExitStack
) -> None:
    package = written("imu-source", "my-nameless-wrist", tmp_path)
    module = package / "src/my_nameless_wrist/promises.py"
    module.write_text(module.read_text().replace("    plugin = SOURCE\n", ""))
    with (package / "pyproject.toml").open("a") as project:
        project.write('[project.entry-points."pointit.selection_methods"]\n')
        project.write('my-other-way = "pointit.testing.templates.selection_method:METHOD"\n')
    install(package, stack)
    result = invoke(check.command)  # all of other packages
    assert result.exit_code == 1
    assert "SourcePromises names no plug-in: add a line such as `plugin = SOURCE`\n" in result.output
    assert "kept   selection-method my-other-way: selects the object" in result.output


def test_plugin_without_a_fake_device_is_advised_of_one(tmp_path: Path, stack: contextlib.ExitStack) -> None:
    package = written("imu-source", "my-bare-wrist", tmp_path)
    project = package / "pyproject.toml"
    project.write_text(project.read_text().replace("pointit.fake_devices", "somebody.elses"))
    install(package, stack)
    result = invoke(check.command, "my-bare-wrist", "--json")
    assert result.exit_code == 1
    (row,) = json.loads(result.stdout)
    assert (row["plugin"], row["check"]) == ("imu-source my-bare-wrist", "fake_device")
    assert "add an entry point 'my-bare-wrist' of the group pointit.fake_devices" in row["problem"]


def test_new_command_is_found_and_checked(tmp_path: Path, stack: contextlib.ExitStack) -> None:
    package = written("command", "my-report", tmp_path)
    assert not (package / "src/my_report/promises.py").exists()
    install(package, stack)
    result = invoke(check.command, "my-report")
    assert result.exit_code == 0, result.output
    assert "kept   command my-report: describes itself and its options" in result.output
    with pytest.raises(ConfigError, match="is a command: choose another name"):
        invoke(new.new, "command", "my-report", "--folder", str(tmp_path / "again"))
    with pytest.raises(ConfigError, match="`pointit doctor` is a command: choose another name"):
        invoke(front(), "plugin", "new", "command", "doctor", "--folder", str(tmp_path / "again"))


@pytest.mark.parametrize(
    ("name", "wrong", "said"),
    [
        (
            "my-mute",
            ('help="time to watch, s  [default: no end]"', 'help=""'),
            "without a help text: seconds",
        ),
        (
            "my-bare",
            ('"""Print each selection of', '"" + """Print each'),
            "it has no help: give its function",
        ),
        ("my-broken", ("import pointit\n", "import pointit.lost\n"), "No module named 'pointit.lost'"),
    ],
)
def test_command_without_help_or_that_cannot_be_imported_is_named(
    name: str, wrong: tuple[str, str], said: str, tmp_path: Path, stack: contextlib.ExitStack
) -> None:
    package = written("command", name, tmp_path)
    module = package / "src" / name.replace("-", "_") / "__init__.py"
    assert wrong[0] in module.read_text()
    module.write_text(module.read_text().replace(*wrong))
    install(package, stack)
    result = invoke(check.command, name)
    assert result.exit_code == 1
    assert said in result.output


@pytest.mark.slow
def test_output_of_a_new_command_has_the_selections(capsys: pytest.CaptureFixture[str]) -> None:
    with pointit.run("scenario_3", virtual=True) as site:
        print_selections.print_selections(site, 40, as_json=False)
    assert "user1 selected " in capsys.readouterr().out


def test_tests_of_a_new_package_pass_as_written(tmp_path: Path) -> None:
    # all promises of each kind are checked in `test_promises.py`
    package = written("imu-source", "my-part", tmp_path)
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", "delivers"],
        cwd=package,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert " passed" in ended.stdout


@pytest.mark.parametrize("name", ["My Wrist", "../x", "json", "pointit"])
def test_name_that_cannot_be_a_package_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="cannot be a package's name"):
        invoke(new.new, "imu-source", name)


@pytest.mark.parametrize(
    ("kind", "name", "problem"),
    [
        ("imu-source", "serial", "IMU source 'serial' of pointit is installed"),
        ("imu-source", "source", "'source' is a parameter"),
        ("recogniser", "pocketsphinx", "recogniser 'pocketsphinx' of pointit is installed"),
    ],
)
def test_name_that_is_taken_is_refused(kind: str, name: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"^{problem}.*: choose another name$"):
        invoke(new.new, kind, name, "--folder", str(tmp_path / "new"))
    assert not (tmp_path / "new").exists()


def test_fake_device_of_a_namesake_plugin_is_not_used() -> None:
    serial = GROUPS["imu-source"].get("serial")
    assert check.installed_contract("serial", replace(serial)) is None
