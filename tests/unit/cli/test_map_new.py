"""`pointit map new` writes maps that `pointit map check` passes, and asks only in a terminal."""

import os
import pty
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pointit.cli.main import command
from pointit.maps.checks.check import check_map
from pointit.maps.file import read_clouds, read_map_file
from pointit.runtime.errors import ConfigError


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Yield the other end of a terminal on standard input."""
    ours, theirs = pty.openpty()
    with open(theirs, encoding="utf-8") as stdin:  # noqa: PTH123 - a number, not a path
        monkeypatch.setattr("sys.stdin", stdin)
        yield ours
    os.close(ours)


def room(*arguments: str) -> Result:
    return CliRunner().invoke(command, ["map", "new", *arguments])


@pytest.mark.parametrize("width", ["1", "5", "100"])
@pytest.mark.parametrize("depth", ["1", "4", "100"])
@pytest.mark.parametrize(("lamps", "strips"), [(2, 0), (2, 1), (3, 4), (4, 2), (7, 5), (32, 8)])
def test_a_new_room_has_no_findings(width: str, depth: str, lamps: int, strips: int) -> None:
    result = room("--width", width, "--depth", depth, "--lamps", str(lamps), "--strips", str(strips))
    assert result.exit_code == 0, result.output
    path = Path("room.yaml")
    file = read_map_file(path)
    assert check_map(file, read_clouds(path, file), person_m=(0.0, 0.0)) == []
    assert (len(file.lamps), len(file.strips)) == (lamps, strips)
    points = [lamp.position for lamp in file.lamps.values()]
    points += [point for strip in file.strips.values() for point in strip.line]
    assert all(abs(x) <= float(width) / 2 and abs(y) <= float(depth) / 2 for x, y, _ in points)
    assert all(abs(x) == float(width) / 2 or abs(y) == float(depth) / 2 for x, y, _ in points)  # on a wall


def test_defaults_hold_without_a_terminal_and_next_commands_are_printed() -> None:
    result = room("own.yaml")
    assert result.output.splitlines() == [
        "own.yaml: no findings; 2 strips with 258 pixels, 4 lamps",
        "run it: pointit run scenario_2 --set pui.map=./own.yaml --pose 0,0",
        "check it after each change: pointit map check ./own.yaml",
    ]
    assert "pointit run scenario_1" in room("lamps.yaml", "--strips", "0").output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--lamps", "0", "--strips", "0"), "there is nothing to point at"),
        (("room.json",), "room.json: a map ends in .yaml"),
        (("nowhere/room.yaml",), "nowhere/room.yaml: cannot be written"),
        (("kept.yaml",), "kept.yaml: exists already"),
    ],
)
def test_a_mistake_is_one_sentence_and_changes_no_file(arguments: tuple[str, ...], message: str) -> None:
    Path("kept.yaml").write_text("mine")
    error = room(*arguments).exception
    assert isinstance(error, ConfigError)
    assert message in str(error)
    assert [path.read_text() for path in Path().iterdir()] == ["mine"]


def test_in_a_terminal_it_asks_for_what_is_missing(terminal: int, capfd: pytest.CaptureFixture[str]) -> None:
    os.write(terminal, b"6\n\n3\n")
    command.main(["map", "new", "--lamps", "2"], prog_name="pointit", standalone_mode=False)
    asked = capfd.readouterr().out
    questions = ("width of the room, m [5.0]", "depth of the room, m [4.0]", "number of LED strips [2]")
    assert all(question in asked for question in questions)
    assert "number of lamps" not in asked
    file = read_map_file(Path("room.yaml"))
    assert (len(file.lamps), len(file.strips)) == (2, 3)
    assert max(x for strip in file.strips.values() for x, _, _ in strip.line) == 3.0
