"""`pointit map import` and `export`: notes, presets, and the same numbers on the wire."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from pointit.cli.main import command
from pointit.cli.maps import map_file
from pointit.cli.maps.exchange import export, import_
from pointit.maps.file import read_map_file
from pointit.runtime.errors import ConfigError


def imported(source: Path, kind: str, *options: str) -> Result:
    room = source.with_suffix(".yaml")
    arguments = [str(source), "--as", kind, "-o", str(room), *options]
    return CliRunner().invoke(import_, arguments, catch_exceptions=False)


def test_skipped_numbers_are_reported_and_exported_again(tmp_path: Path) -> None:
    source = tmp_path / "ledmap1.json"
    source.write_text(json.dumps({"width": 4, "height": 2, "map": [9, 8, 7, 6, 0, 1, 2, 3]}))
    result = imported(source, "ledmap", "--cell", "0.1")
    assert "note: pixels 4 to 5 of the wire are in no strip" in result.stderr
    room = source.with_suffix(".yaml")
    assert [strip.offset for strip in read_map_file(room).strips.values()] == [None, 6]
    arguments = [str(room), "--as", "ledmap", "--cell", "0.1"]
    back = json.loads(CliRunner().invoke(export, arguments, catch_exceptions=False).stdout)
    assert back["map"] == [9, 8, 7, 6, 0, 1, 2, 3]


def test_irregular_pixels_and_a_matrix_are_reported(tmp_path: Path) -> None:
    pixels = tmp_path / "tree.csv"
    pixels.write_text("x,y,z\n" + "".join(f"{n // 2 * 0.1},0,1\n" for n in range(20)))
    assert (
        "note: strip_1: pixels are irregular, so that the line makes detours"
        in imported(pixels, "csv").stderr
    )
    state = tmp_path / "state.json"
    state.write_text(json.dumps({"seg": {"start": 0, "stop": 8, "startY": 0, "stopY": 4, "n": "wall"}}))
    assert (
        "note: wall is a matrix of 8 x 4 pixels, laid out as one line" in imported(state, "segments").stderr
    )


def test_a_preset_is_chosen(tmp_path: Path) -> None:
    presets = tmp_path / "presets.json"
    segments = {str(n): {"seg": [{"id": 0, "start": 0, "stop": 10 * n}, {"stop": 0}]} for n in (1, 2)}
    presets.write_text(json.dumps({"0": {}, **segments}))
    imported(presets, "segments", "--preset", "2")
    assert [strip.pixels for strip in read_map_file(presets.with_suffix(".yaml")).strips.values()] == [20]


def test_more_strips_than_a_map_can_have_make_no_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.maps.file.MAX_KEYS", 30)  # the real limit takes 27000 strips
    pixels = tmp_path / "hall.csv"
    pixels.write_text("strip,x,y,z\n" + "".join(f"s{n},0,0,{n}\ns{n},0.1,0,{n}\n" for n in range(10)))
    with pytest.raises(ConfigError, match=r"hall.csv: gives a map with the errors above"):
        imported(pixels, "csv")
    assert not pixels.with_suffix(".yaml").exists()


def test_a_notice_is_printed_only_if_reading_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[str] = []

    def echo(text: str, *, err: bool) -> None:
        assert err
        printed.append(text)

    monkeypatch.setattr("click.echo", echo)
    with map_file.notify_if_slow("reading a …"):
        pass
    monkeypatch.setattr(map_file, "SLOW_S", 0.0)
    with map_file.notify_if_slow("reading b …"):
        while not printed:
            pass
    assert printed == ["reading b …"]


STATE: dict[str, Any] = {
    "on": True, "bri": 128, "transition": 7, "ps": -1, "pl": -1, "mainseg": 0,
    "nl": {"on": False, "dur": 60, "mode": 1, "tbri": 0, "rem": -1},
    "udpn": {"send": False, "recv": True},
    "seg": [{"id": 0, "start": 0, "stop": 60, "len": 60, "grp": 1, "spc": 0, "of": 0, "on": True,
             "n": "Shelf",
             "col": [[255, 160, 0], [0, 0, 0], [0, 0, 0]], "fx": 0, "sx": 128, "pal": 0, "rev": False}],
}  # fmt: skip
"""Answer of WLED 0.15.1 to `/json/state`."""
INFO = {"ver": "0.15.1", "leds": {"count": 60, "fps": 2, "maxpwr": 850, "seglc": [1]}, "name": "Kitchen"}


@pytest.mark.parametrize("answer", [STATE, {"state": STATE, "info": INFO, "effects": ["Solid"]}])
def test_answer_of_a_wled_becomes_its_strips(tmp_path: Path, answer: dict[str, Any]) -> None:
    file = tmp_path / "state.json"
    file.write_text(json.dumps(answer), encoding="utf-8")
    result = CliRunner().invoke(command, ["map", "import", str(file), "--as", "segments"])
    assert result.exit_code == 0, result.output
    assert '"Shelf":' in result.output
    assert "pixels: 60" in result.output


@pytest.mark.parametrize(
    "words",
    [
        ["import", "http://192.168.1.9/json/state"],
        ["import", "https://wled.local/json", "--as", "segments"],
        ["fetch", "http://192.168.1.9/json/state"],
    ],
)
def test_address_of_a_web_server_leads_to_its_file(words: list[str]) -> None:
    result = CliRunner().invoke(command, ["map", *words])
    assert result.exit_code
    said = f"{result.output}{result.exception}"
    assert "`curl -o state.json http://WLED/json/state`" in said
    assert "`pointit map import state.json --as segments`" in said
