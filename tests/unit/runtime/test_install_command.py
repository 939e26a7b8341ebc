"""The command that adds an extra, in each kind of environment."""

import sys
from pathlib import Path

import pytest

from pointit.runtime.host import extras


@pytest.mark.parametrize(
    ("prefix", "has_pip", "command"),
    [
        (".cache/uv/archive-v0/XLGa1XPA77ReKups", False, "uvx --from 'pointit[ros2]'"),
        (".local/share/uv/tools/pointit", False, "uv tool install 'pointit[ros2]'"),
        ("project/.venv", False, "uv pip install 'pointit[ros2]'"),
        ("project/.venv", True, "pip install 'pointit[ros2]'"),
        ("miniconda3/envs/lab", True, "pip install 'pointit[ros2]'"),
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
    assert extras.remedy("ros2") == f"`{command}`"
