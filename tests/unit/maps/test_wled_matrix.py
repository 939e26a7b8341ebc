"""WLED's 2-D configuration: panels of a matrix become strips that follow the wire; presets with fillers."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from pointit.cli.maps.exchange import import_
from pointit.maps import exchange
from pointit.maps.model import StripEntry
from pointit.runtime.errors import ConfigError

PITCH_M = 0.05


def config(*panels: dict[str, Any], outputs: tuple[int, ...] = (), **matrix: Any) -> str:
    starts = np.cumsum((0, *outputs)).tolist()
    ins = [
        {"start": start, "len": length, "pin": [16], "order": 0, "rev": False, "type": 22}
        for start, length in zip(starts, outputs, strict=False)
    ]
    led = {"total": sum(outputs), "maxpwr": 850, "matrix": {"mpc": len(panels), "panels": panels, **matrix}}
    return json.dumps(
        {"rev": [1, 0], "vid": 2410270, "id": {"name": "WLED"}, "hw": {"led": led | {"ins": ins}}}
    )


def panel(w: int, h: int, x: int = 0, y: int = 0, **keys: Any) -> dict[str, Any]:
    return {"b": False, "r": False, "v": False, "s": False, "x": x, "y": y, "h": h, "w": w, **keys}


def cells(strips: dict[str, StripEntry]) -> list[tuple[int, int]]:
    """Return column and height, in cells, of all pixels in the order of the wire."""
    points = np.concatenate([exchange.positions(strip) for strip in strips.values()]) / PITCH_M
    assert np.allclose(points, points.round(), atol=0.02)
    return [(round(x), round(z)) for x, _, z in points.tolist()]


WIRES: dict[str, tuple[dict[str, Any], list[tuple[int, int]]]] = {
    "rows": ({}, [(0, 1), (1, 1), (2, 1), (0, 0), (1, 0), (2, 0)]),
    "serpentine": ({"s": True}, [(0, 1), (1, 1), (2, 1), (2, 0), (1, 0), (0, 0)]),
    "serpentine as a number": ({"s": 1}, [(0, 1), (1, 1), (2, 1), (2, 0), (1, 0), (0, 0)]),
    "from the right": ({"r": True, "s": True}, [(2, 1), (1, 1), (0, 1), (0, 0), (1, 0), (2, 0)]),
    "from the bottom": ({"b": True}, [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]),
    "columns": ({"v": True}, [(0, 1), (0, 0), (1, 1), (1, 0), (2, 1), (2, 0)]),
    "columns up and down": (
        {"v": True, "b": True, "s": True},
        [(0, 0), (0, 1), (1, 1), (1, 0), (2, 0), (2, 1)],
    ),
    "columns from the right": ({"v": True, "r": True}, [(2, 1), (2, 0), (1, 1), (1, 0), (0, 1), (0, 0)]),
}


@pytest.mark.parametrize("name", WIRES)
def test_pixels_of_a_panel_are_where_wled_has_them(name: str) -> None:
    keys, expected = WIRES[name]
    assert cells(exchange.from_matrix(config(panel(3, 2, **keys)), PITCH_M)) == expected


def test_panels_are_one_behind_the_other_and_a_strip_is_behind_the_matrix() -> None:
    text = config(
        panel(6, 12, b=True, v=True, s=True), panel(6, 12, 6, b=True, v=True, s=True), outputs=(144, 3)
    )
    strips = exchange.from_matrix(text, PITCH_M)
    assert strips.pop("behind_matrix").pixels == 3
    wire = cells(strips)
    assert (len(wire), wire[0], wire[72], wire[143]) == (144, (0, 0), (6, 0), (11, 0))
    assert len({*wire}) == 144


def test_panels_beyond_their_count_are_not_used_as_in_wled() -> None:
    strips = exchange.from_matrix(config(panel(4, 4, s=True), panel(4, 4, 4), mpc=1), PITCH_M)
    assert len(cells(strips)) == 16


NO_PANEL: list[Any] = []


@pytest.mark.parametrize(
    ("panels", "message"),
    [
        ((panel(4, 4), panel(4, 4)), "panel 1 of hw.led.matrix has column 0, row 0, which is of panel 0"),
        ((panel(0, 4),), "panel 0 of hw.led.matrix has 0 x 4 pixels at 0, 0; give each panel its size"),
        ((panel(10**6, 10**6),), "panel 0 of hw.led.matrix has 1000000 x 1000000 pixels"),
        ((NO_PANEL,), r"panel 0 of hw.led.matrix is \[\]; give WLED's cfg.json"),
        ((panel(4, 4) | {"w": "wide"},), "w of panel 0 of hw.led.matrix is 'wide'; write a whole number"),
    ],
)  # fmt: skip
def test_panels_without_a_place_are_refused(panels: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_matrix(config(*panels), PITCH_M)


@pytest.mark.parametrize("text", ["[]", "{}", '{"seg": []}', '{"hw": {"led": {"ins": [{"len": 3}]}}}'])
def test_other_files_have_no_matrix(text: str) -> None:
    assert exchange.from_matrix(text, PITCH_M) == {}


def imported(folder: Path, content: bytes, *options: str) -> tuple[str, int]:
    source = folder / "source.json"
    source.write_bytes(content)
    result = CliRunner().invoke(import_, [str(source), "--as", "segments", *options])
    return (str(result.exception) if result.exception else result.output), result.exit_code


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_matrix_is_imported_in_any_unicode(tmp_path: Path, encoding: str) -> None:
    text, code = imported(tmp_path, config(panel(8, 8, s=True)).encode(encoding))
    assert code == 0
    assert "pixels: 64" in text
    assert text.count("],") >= 15


def test_a_file_in_another_encoding_is_refused_with_the_line_and_the_remedy(tmp_path: Path) -> None:
    text, _ = imported(tmp_path, '{"seg": [\n{"start": 0, "stop": 9, "n": "Küche"}]}'.encode("latin-1"))
    assert text.endswith("source.json: line 2 is not UTF-8; save the file as UTF-8")


USED: list[dict[str, Any]] = [
    {"id": 0, "start": 0, "stop": 30, "grp": 1, "n": "Desk"},
    {"id": 1, "start": 30, "stop": 60},
]
FILLER = {"stop": 0}


@pytest.mark.parametrize(
    "other",
    [
        [*USED, *[FILLER] * 30],
        [*USED, {"id": 2, "start": 0, "stop": 0, "n": "old"}],
        [{**USED[0], "fx": 9, "stopY": 1}, {"id": 4, "start": 30, "len": 30}],
        [USED[0], FILLER, {**USED[1], "n": ""}],
        USED[::-1],
    ],
)
def test_presets_that_differ_only_in_unused_segments_are_the_same(other: list[dict[str, Any]]) -> None:
    presets: dict[str, Any] = {
        "0": {},
        "1": {"seg": [*USED, *[FILLER] * 14], "n": "A"},
        "2": {"seg": other, "n": "B"},
    }
    presets["3"] = {"playlist": {"ps": [1, 2]}, "on": True, "n": "Loop"}
    segments = exchange.from_segments(json.dumps(presets))
    assert [(each.start, each.pixels) for each in segments.values()] == [(0, 30), (30, 30)]
