"""Completion in a shell: names, options, what it loads, and its installation."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from pointit.cli.common.lazy import COMPLETE
from pointit.cli.main import command
from pointit.launch.plan.plan import scenario_names
from pointit.maps.file import shipped_maps
from pointit.services.registry import PROCESSES
from tests.support.invoked import python


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for variable in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "ZDOTDIR"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


def completed(words: str) -> list[str]:
    """Return the completions of the last of `words`, which may be empty; "file" stands for files."""
    *before, last = words.split(" ")
    found = ShellComplete(command, {}, "pointit", COMPLETE).get_completions(before, last)
    return [each.value if each.type == "plain" else each.type for each in found]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("do", ["doctor"]),
        ("topic ", ["list", "echo", "hz", "schema"]),
        ("person calibrate m", ["mounting"]),
        ("run sc", ["file", *(name for name in scenario_names() if name.startswith("sc"))]),
        ("person add anna --scenario ", ["file", *scenario_names()]),
        ("map check ", ["file", *shipped_maps()]),
        ("service run ", [row.name for row in PROCESSES]),
        ("run --users 2 --hand r", ["right"]),
        ("service run pui --toler", ["--tolerance-deg"]),
    ],
)
def test_names_and_options_are_completed(words: str, expected: list[str]) -> None:
    assert completed(words) == expected


@pytest.mark.parametrize("words", ["run", "person add", "service run led-driver", "topic hz"])
def test_completed_options_are_those_of_the_command(words: str) -> None:
    asked = "--help-all" if words in ("run", "person add") else "--help"
    text = CliRunner().invoke(command, [*words.split(), asked]).output
    named = re.findall(r"^  (?:-\w, )?(--[\w.-]+)(?:, (--[\w.-]+))?", text, re.MULTILINE)
    options = {option for names in named for option in names if option}
    assert {*completed(f"{words} --"), "--help"} == options


@pytest.mark.parametrize("words", ["pointit topic ", "pointit "])
def test_the_shell_gets_what_it_asks_for_without_heavy_modules(words: str) -> None:
    script = (
        "import atexit, sys; sys.argv = ['pointit']\n"
        "atexit.register(lambda: print(*sys.modules, file=sys.stderr))\n"
        "from pointit.__main__ import begin; begin()"
    )
    variables = {COMPLETE: "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split(" ")) - 1)}
    done = python("-c", script, env={**os.environ, **variables})
    assert done.returncode == 0
    assert any(line.startswith("plain,") for line in done.stdout.splitlines())
    assert not set(done.stderr.split()) & {"zenoh", "pydantic", "numpy", "rich", "yaml"}


@pytest.mark.parametrize(
    ("shell", "script", "start"),
    [
        ("bash", ".local/share/pointit/completion.bash", ".bashrc"),
        ("zsh", ".local/share/pointit/completion.zsh", ".zshrc"),
        ("fish", ".config/fish/completions/pointit.fish", None),
    ],
)
def test_it_is_installed_once(home: Path, shell: str, script: str, start: str | None) -> None:
    if start is not None:
        (home / start).write_text("alias l=ls\n")
    for _ in range(2):
        result = CliRunner().invoke(command, ["completion"], env={"SHELL": f"/usr/bin/{shell}"})
        assert result.exit_code == 0, result.output
        assert str(home / script) in result.output
    assert COMPLETE in (home / script).read_text()
    if start is not None:
        text = (home / start).read_text()
        line = f'[ -f "{home / script}" ] && source "{home / script}"'
        assert text == f"alias l=ls\n\n# completion of pointit\n{line}\n"


def test_start_file_in_another_encoding_keeps_its_bytes(home: Path) -> None:
    before = b"alias gr\xfc\xdfe=ls"  # Latin-1, and no line end
    (home / ".bashrc").write_bytes(before)
    for _ in range(2):
        assert CliRunner().invoke(command, ["completion", "bash"]).exit_code == 0
    content = (home / ".bashrc").read_bytes()
    assert content.startswith(before + b"\n# completion of pointit\n[ -f ")
    assert content.count(b"source ") == 1


@pytest.mark.parametrize(("shell", "start"), [("bash", ".bashrc"), ("zsh", ".zshrc")])
def test_removed_completion_leaves_the_start_file_as_it_was(home: Path, shell: str, start: str) -> None:
    (home / start).write_bytes(b"alias gr\xfc\xdfe=ls\nPS1=x\n")
    CliRunner().invoke(command, ["completion", shell])
    with (home / start).open("ab") as opened:
        opened.write(b"alias later=ls\n")

    for _ in range(2):
        assert CliRunner().invoke(command, ["completion", shell, "--remove"]).exit_code == 0

    assert (home / start).read_bytes() == b"alias gr\xfc\xdfe=ls\nPS1=x\nalias later=ls\n"
    assert not list((home / ".local/share/pointit").iterdir())


def test_unguarded_line_of_an_older_version_is_replaced(home: Path) -> None:
    script = home / ".local/share/pointit/completion.bash"
    (home / ".bashrc").write_text(f'alias l=ls\n\n# completion of pointit\nsource "{script}"\nalias m=ls\n')

    assert CliRunner().invoke(command, ["completion", "bash"]).exit_code == 0

    lines = (home / ".bashrc").read_text().splitlines()
    assert lines == [
        "alias l=ls",
        "alias m=ls",
        "",
        "# completion of pointit",
        f'[ -f "{script}" ] && source "{script}"',
    ]


def test_shell_starts_silently_when_the_script_is_gone(home: Path) -> None:
    CliRunner().invoke(command, ["completion", "bash"])
    (home / ".local/share/pointit/completion.bash").unlink()
    done = subprocess.run(
        ["/bin/bash", "-c", "source ~/.bashrc"], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.stdout, done.stderr) == ("", "")


def test_bash_completes_with_the_installed_line(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    CliRunner().invoke(command, ["completion", "bash"])
    program = home / "bin" / "pointit"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m pointit "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)

    script = "source ~/.bashrc; COMP_WORDS=('pointit' topic e) COMP_CWORD=2; _pointit_completion 'pointit'"
    done = subprocess.run(
        ["/bin/bash", "-c", f"{script}; echo ${{COMPREPLY[@]}}"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert (done.stdout, done.stderr) == ("echo\n", "")


def test_the_script_can_be_printed_and_other_shells_are_refused(home: Path) -> None:
    assert COMPLETE in CliRunner().invoke(command, ["completion", "zsh", "--print"]).output
    error = CliRunner().invoke(command, ["completion"], env={"SHELL": "/bin/tcsh"}).exception
    assert str(error) == "SHELL: tcsh is not supported; name one of bash, zsh, fish"
    assert list(home.iterdir()) == []
