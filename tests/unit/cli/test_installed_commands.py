"""Commands that other packages add: shown without an import, called, and what is wrong with one."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from pointit.cli.common import installed_commands
from pointit.cli.common.installed_commands import HEADING, LAB
from pointit.cli.main import front
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from tests.support import strangers

WAVES = """
import click

@click.command()
@click.option("--times", default=1, help="how often")
def wave(times):
    click.echo("wave " * times)

NOTHING = 3
"""
LACKS = "cannot be imported (ModuleNotFoundError: No module named 'no_such_part')"


def invoke(*arguments: str) -> Result:
    return CliRunner().invoke(front(), list(arguments), prog_name="pointit", standalone_mode=False)


def refusal(*arguments: str) -> str:
    error = invoke(*arguments).exception
    assert isinstance(error, ConfigError | click.ClickException)
    return error.format_message() if isinstance(error, click.ClickException) else str(error)


@contextmanager
def with_command(folder: Path, module: str, line: str, source: str = WAVES) -> Generator[None]:
    with strangers.installed(folder, module, source, commands=line):
        yield


def test_command_of_a_package_is_shown_without_an_import_and_called(tmp_path: Path) -> None:
    with with_command(tmp_path, "stranger_waves", "wave = stranger_waves:wave"):
        info = tmp_path / "strangers_parts-1.0.dist-info"
        with (info / "METADATA").open("a", encoding="utf-8") as file:
            file.write("Summary: tools of ours\n\nSummary: not this\n")
        lines = invoke("--help").output.splitlines()
        shown = lines[lines.index(f"{HEADING}:") + 1]
        assert " ".join(shown.split()) == "wave tools of ours (strangers-parts)"
        assert "stranger_waves" not in sys.modules
        assert refusal("wive") == "no command 'wive'; did you mean wave?"
        assert "stranger_waves" not in sys.modules
        assert invoke("wave", "--times", "2").output == "wave wave \n"
    assert HEADING not in invoke("--help").output


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        (
            "import no_such_part",
            f"command 'wave' of strangers-parts {LACKS}; update or uninstall strangers-parts",
        ),
        ("wave = 3", "command 'wave': stranger_broken:wave is no Command"),
    ],
)
def test_command_that_cannot_be_loaded_costs_the_others_nothing(
    tmp_path: Path, source: str, sentence: str
) -> None:
    with with_command(tmp_path, "stranger_broken", "wave = stranger_broken:wave", source):
        try:
            assert "wave" in invoke("--help").output
            assert refusal("wave") == sentence
            assert invoke("map", "list").exception is None
        finally:
            sys.modules.pop("stranger_broken", None)


@pytest.mark.parametrize("name", ["run", "hz", "evaluate"])
def test_name_of_a_command_of_ours_is_not_given_away(tmp_path: Path, name: str) -> None:
    with with_command(tmp_path, "stranger_thief", f"{name} = stranger_thief:wave"):
        told = " ".join(invoke("--help").output.split())
        assert f"strangers-parts adds no command '{name}', which is a name of PointIt's own" in told
        assert HEADING not in told
        assert "--times" not in invoke(name, "--help").output
    assert "stranger_thief" not in sys.modules


def test_package_without_metadata_hides_no_other_command(tmp_path: Path) -> None:
    damaged = tmp_path / "aaa-1.0.dist-info"
    damaged.mkdir()
    (damaged / "entry_points.txt").write_text("[pointit.commands]\nwaste = aaa:waste\n", encoding="utf-8")
    with with_command(tmp_path, "stranger_beside", "wave = stranger_beside:wave"):
        assert "(strangers-parts)" in invoke("--help").output


def test_commands_of_the_laboratory_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed_commands, "GROUP", "pointit.no_commands")
    help_text = invoke("--help").output
    assert "Measure:" not in help_text
    assert "evaluate" not in help_text
    for name in ("load", "evaluate"):
        assert refusal(name, "--help") == (
            f"`pointit {name}` is a command of {LAB}, which is not installed; run {remedy('lab')}"
        )


def test_the_first_version_on_the_path_counts_and_an_empty_section_has_no_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder, package, text in (
        ("first", "waves-2.0", "[pointit.commands]\nwave = new:wave\n"),
        ("second", "waves-1.0", "[pointit.commands]\nwave = old:wave\nold = old:old\n"),
        ("second", "silent-1.0", "[pointit.commands]\n[console_scripts]\nscript = silent:main\n"),
    ):
        info = tmp_path / folder / f"{package}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Name: {package.partition('-')[0]}\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "first"), str(tmp_path / "second")])
    assert [(each.name, each.package) for each in installed_commands.declared()] == [("wave", "waves")]
