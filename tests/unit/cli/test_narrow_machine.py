"""Commands on a machine without a home directory, and before a terminal or pipe that lacks letters."""

import json
import os
import pwd
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from pointit.cli.common.lazy import COMPLETE
from pointit.cli.main import command
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import VARIABLE, expand_home, state_directory
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.feeding import check_schedule
from pointit.services.recorder.config import RecorderConfig
from pointit.services.recorder.service import Recorder
from tests.support.invoked import python

LAMPS = "lamps:\n  a: {position: [1, 2, 1]}\n  b: {position: [2, 2, 1]}\n"
PAGE = "cp932"


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove the home directory: no HOME, and a user id that no account has."""
    for variable in [name for name in os.environ if name in {"HOME", "ZDOTDIR", VARIABLE} or "XDG_" in name]:
        monkeypatch.delenv(variable)

    def unknown(_id: object) -> NoReturn:
        raise KeyError

    monkeypatch.setattr(pwd, "getpwuid", unknown)


def run(*arguments: str | Path, page: str, **more: str) -> tuple[int, bytes, str]:
    """Return exit code, output and log of a command whose output is encoded as `page`."""
    environment: Mapping[str, str] = {**os.environ, "PYTHONIOENCODING": page, **more}
    done = python("-m", "pointit", *arguments, env=environment, encoding="latin-1")
    return done.returncode, done.stdout.encode("latin-1"), done.stderr


@pytest.mark.slow
def test_letters_that_the_code_page_lacks_are_escaped(
    tmp_path: Path,
) -> None:
    file = tmp_path / "şék-Δ.yaml"
    file.write_text(LAMPS)
    code, output, log = run("map", "check", file, page=PAGE)
    assert (code, log) == (0, "")
    assert b"no findings; 2 lamps" in output
    assert b"\\u015f" in output
    file.write_text("lamps: {a: 3}\n")
    assert run("map", "check", file, page=PAGE)[0] == 1
    code, output, _ = run("map", "check", file, "--json", page=PAGE)
    assert code == 1
    assert json.loads(output.decode(PAGE))["map"] == str(file)


@pytest.mark.parametrize("words", ["list", "run --help-all", "topic list"])
def test_commands_and_help_are_shown_in_a_narrow_code_page(words: str) -> None:
    code, output, log = run(*words.split(), page="cp437")
    assert (code, log) == (0, "")
    assert output.decode("cp437")


def test_a_file_on_standard_output_is_in_utf_8() -> None:
    script = "from pointit.cli.common.output import print_file; print_file('label: şék 💡\\n')"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    assert python("-c", script, env=environment, encoding="utf-8").stdout == "label: şék 💡\n"


@pytest.mark.skipif(sys.platform == "darwin", reason="names of files are text there")
def test_a_map_whose_file_name_is_no_text_is_checked(tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"caf\xe9.yaml")
    file.write_text(LAMPS)
    code, output, log = run("map", "check", file, page="utf-8")
    assert (code, log) == (0, "")
    assert b"\\udce9.yaml: no findings" in output


@pytest.mark.usefixtures("homeless")
def test_no_home_directory_is_one_sentence_with_both_remedies(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sentence = rf"^there is no home directory; set HOME, or {VARIABLE} to a folder$"
    with pytest.raises(ConfigError, match=sentence):
        state_directory()
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert state_directory() == tmp_path


@pytest.mark.usefixtures("homeless")
@pytest.mark.parametrize("text", ["~/x.mcap", "~nobody-here/x.mcap"])
def test_path_in_a_missing_home_directory_is_refused(text: str) -> None:
    refused = rf"^{text}: there is no such home directory; set HOME, or write the path$"
    with pytest.raises(ConfigError, match=refused):
        expand_home(text)
    with pytest.raises(ConfigError, match=refused):
        Recorder.validate_config(RecorderConfig(file=text))
    with pytest.raises(ConfigError, match=refused):
        check_schedule(ConveyorSimConfig(schedule=text))


@pytest.mark.usefixtures("homeless")
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_not_installed_but_printed_without_a_home_directory(shell: str) -> None:
    error = CliRunner().invoke(command, ["completion", shell]).exception
    assert str(error) == "there is no home directory; set HOME, or print the script with --print"
    assert COMPLETE in CliRunner().invoke(command, ["completion", shell, "--print"]).output


@pytest.mark.usefixtures("homeless")
def test_names_are_completed_without_a_home_directory() -> None:
    found = ShellComplete(command, {}, "pointit", COMPLETE).get_completions(["topic", "hz"], "--al")
    assert [each.value for each in found] == ["--all"]
