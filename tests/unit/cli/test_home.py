"""`pointit home`: its files, its arguments for a run, and what is missing."""

from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp, StoredSetup
from pointit.cli import home
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy


@pytest.fixture
def arguments(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the arguments that the run gets, which does not start."""
    given: list[str] = []

    def main(passed: list[str], **_options: object) -> int:
        given.extend(passed)
        return 0

    monkeypatch.setattr(home.run, "main", main)
    return given


def test_first_start_writes_an_empty_home_and_runs_it(tmp_path: Path, arguments: list[str]) -> None:
    folder = tmp_path / "my #1 home"
    done = CliRunner().invoke(home.command, ["--folder", str(folder), "--lan"], standalone_mode=False)

    assert done.exception is None
    assert arguments[0] == str(folder / "home.yaml")
    assert "--lan" in arguments
    assert "--site" not in arguments, "credentials may name it"
    settings = [each for option, each in pairwise(arguments) if option == "--set"]
    names = {name: yaml.safe_load(value) for name, _, value in (each.partition("=") for each in settings)}
    assert names == {"home-assistant.setup": str(folder), "web.home_folder": str(folder)}
    assert folder.stat().st_mode & 0o777 == 0o700


def test_edit_starts_at_the_first_card_and_keeps_the_setup(tmp_path: Path, arguments: list[str]) -> None:
    files = HomeFiles(tmp_path)
    files.state.write(StoredSetup(step="done", url="http://ha:8123", lamps=(ChosenLamp(id="light.a"),)))
    CliRunner().invoke(home.command, ["--folder", str(tmp_path), "--edit"], standalone_mode=False)
    stored = files.state.read()
    assert stored is not None
    assert (stored.step, stored.url, len(stored.lamps)) == ("connect", "http://ha:8123", 1)
    assert arguments


def test_missing_extra_is_said_with_its_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def has_extra(_extra: str) -> bool:
        return False

    monkeypatch.setattr(home, "has_extra", has_extra)
    done = CliRunner().invoke(home.command, ["--folder", str(tmp_path / "x")], standalone_mode=False)
    assert isinstance(done.exception, ConfigError)
    assert remedy("home") in str(done.exception)
    assert not (tmp_path / "x").exists()
