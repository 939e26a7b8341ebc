"""`pointit map scan`, `import` and `export` as commands."""

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from pointit.cli.maps.exchange import export, import_
from pointit.cli.maps.scan import command
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.scan.views import Survey, read_survey, to_json
from tests.unit.scan.photographs import LAMPS, photographs, specs


@pytest.fixture
def views(tmp_path: Path) -> Path:
    """Return a file of views."""
    path = tmp_path / "views.json"
    path.write_bytes(to_json(Survey(tuple(specs()), tuple(LAMPS), tuple(photographs(4)))))
    return path


def test_it_writes_a_map_that_can_be_read_and_never_overwrites_one(views: Path) -> None:
    room = views.with_name("room.yaml")
    arguments = ["--from", str(views), "-o", str(room), "--known", "post:0,post:59,0.98"]
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert {strip.id for strip in load_map(str(room), 0).strips} == {spec.name for spec in specs()}
    before = room.read_bytes()
    with pytest.raises(ConfigError, match="exists already"):
        CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert room.read_bytes() == before


def test_what_is_left_out_of_the_map_is_told_by_the_exit_code(views: Path) -> None:
    survey = read_survey(views)
    hidden = [
        replace(
            view, sightings=tuple(each for each in view.sightings if each.name != "post" or each.pixel < 40)
        )
        for view in survey.views
    ]
    views.write_bytes(to_json(replace(survey, views=tuple(hidden))))
    for option, code, count in ((["--all"], 0, 1), ([], 1, 0)):
        room = views.with_name(f"room{code}.yaml")
        arguments = ["--from", str(views), "-o", str(room), *option]
        result = CliRunner().invoke(command, arguments, catch_exceptions=False, standalone_mode=False)
        assert result.return_value == code
        assert "no two views show pixels" in result.stderr
        assert sum(strip.id == "post" for strip in load_map(str(room), 0).strips) == count


@pytest.mark.parametrize("option", [("--known", "a,b"), ("--known", "a:x,b:1,2")])
def test_wrong_options_are_named(views: Path, option: tuple[str, str]) -> None:
    result = CliRunner().invoke(command, ["--from", str(views), *option])
    assert result.exit_code == 2
    assert option[1] in result.output


def test_pixels_go_out_and_come_back(views: Path) -> None:
    room, csv, back = (views.with_name(name) for name in ("room.yaml", "room.csv", "back.yaml"))
    run = CliRunner()
    run.invoke(command, ["--from", str(views), "-o", str(room)], catch_exceptions=False)
    run.invoke(export, [str(room), "--as", "csv", "-o", str(csv)], catch_exceptions=False)
    run.invoke(import_, [str(csv), "--as", "csv", "-o", str(back)], catch_exceptions=False)
    there, here = ({s.id: s.pixels for s in load_map(str(path), 0).strips} for path in (room, back))
    assert there == here


def test_pixels_that_make_no_map_are_not_written(tmp_path: Path) -> None:
    pixels, room = tmp_path / "pixels.csv", tmp_path / "room.yaml"
    pixels.write_text("x,y,z,strip\n0,0,0,a\nnan,0,0,a\n")
    with pytest.raises(ConfigError, match=r"pixels\.csv: line 3: .nan,0,0,a. is no pixel; write numbers"):
        CliRunner().invoke(import_, [str(pixels), "--as", "csv", "-o", str(room)], catch_exceptions=False)
    assert not room.exists()


@pytest.mark.parametrize("kind", ["csv", "segments", "ledmap"])
def test_a_file_of_something_else_is_named(tmp_path: Path, kind: str) -> None:
    other = tmp_path / "other.bin"
    other.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"other\.bin"):
        CliRunner().invoke(import_, [str(other), "--as", kind], catch_exceptions=False)
