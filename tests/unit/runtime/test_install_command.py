"""The command that adds an extra, in each kind of environment."""

import shlex
import sys
from importlib.metadata import metadata
from pathlib import Path

import pytest

from pointit.runtime.host import extras

PACKAGES = "'rosbags>=0.11.9' 'xxhash>=3.4'"
"""What the extra has. None of it is missing where tests run, so that all of it is named."""


@pytest.mark.parametrize(
    ("prefix", "has_pip", "command"),
    [
        (
            ".cache/uv/archive-v0/XLGa1XPA77ReKups",
            False,
            "`uvx --with 'rosbags>=0.11.9' --with 'xxhash>=3.4'` with the other words of your command",
        ),
        (".local/share/uv/tools/pointit", False, "`uv pip install --python {prefix}/bin/python {packages}`"),
        (".local/share/pipx/venvs/pointit", False, "`pipx inject pointit {packages}`"),
        (".local/pipx/venvs/pointit", True, "`pipx inject pointit {packages}`"),
        ("project/.venv", False, "`uv pip install --python {prefix}/bin/python {packages}`"),
        ("project/.venv", True, "`{prefix}/bin/python -m pip install {packages}`"),
        ("miniconda3/envs/lab", True, "`{prefix}/bin/python -m pip install {packages}`"),
        ("my project/.venv", True, "`'{prefix}/bin/python' -m pip install {packages}`"),
    ],
)
def test_extra_is_installed_by_what_the_environment_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, prefix: str, command: str, *, has_pip: bool
) -> None:
    environment = tmp_path / prefix
    environment.mkdir(parents=True)
    (environment / "pyvenv.cfg").touch()
    monkeypatch.setattr(sys, "prefix", str(environment))
    monkeypatch.setattr(extras, "CHECKOUT", tmp_path)
    found = object() if has_pip else None
    monkeypatch.setattr(extras, "find_spec", {"pip": found}.get)
    assert extras.remedy("ros2") == command.format(prefix=environment, packages=PACKAGES)


@pytest.mark.parametrize("extra", sorted(metadata("pointit").get_all("Provides-Extra") or ()))
def test_no_command_installs_a_name_that_no_index_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extra: str
) -> None:
    monkeypatch.setattr(extras, "CHECKOUT", tmp_path)
    monkeypatch.setattr(sys, "prefix", "/srv/env")
    command, *_rest = extras.remedy(extra).removeprefix("`").split("`")
    packages = [word for word in shlex.split(command) if ">=" in word]
    assert packages
    assert not [word for word in shlex.split(command) if word.startswith(("pointit", "."))]
