"""Layouts of other programs, and their units."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
from pointit.maps import exchange
from pointit.maps.checks.check import check_map
from pointit.maps.checks.things import SAME_PLACE_M, check_lamps
from pointit.maps.file import parse_map_file, read_map_file
from pointit.maps.light_files.strip_fit import first_pixels, unused_pixels
from pointit.maps.model import LampEntry, MapFile, StripEntry
from pointit.runtime.errors import ConfigError
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output.pixel_map import map_pixels
from pointit.services.led_driver.outputs import Segment

Lights = dict[int, NDArray[np.float64]]
"""Positions by the number on the wire."""


def lights(strips: dict[str, StripEntry]) -> Lights:
    firsts = first_pixels(strips)
    return {
        firsts[name] + pixel: point
        for name, strip in strips.items()
        for pixel, point in enumerate(exchange.positions(strip))
    }


def assert_same_lights(given_: Lights, expected: Lights, within_m: float) -> None:
    assert sorted(given_) == sorted(expected)
    away = {number: float(np.linalg.norm(given_[number] - expected[number])) for number in expected}
    assert max(away.values()) <= within_m, away


def ledmap(rows: list[str]) -> str:
    """Return the ledmap of a drawing in which numbers stand apart and `.` is a gap."""
    grid = [[-1 if cell == "." else int(cell) for cell in row.split()] for row in rows]
    cells = [number for row in grid for number in row]
    return json.dumps({"n": "x", "width": len(grid[0]), "height": len(grid), "map": cells})


def test_pixels_that_a_ledmap_skips_are_in_no_strip() -> None:
    strips = exchange.from_ledmap(ledmap(["14 13 12 11", " 6  7  8  9", " 3  2  1  0"]), 0.1)
    assert list(unused_pixels(strips)) == [(4, 5), (10, 10)]
    assert [strip.offset for strip in strips.values()] == [None, 6, 11]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"map": [0, 1, 2]}, "has no width, without which a ledmap has no positions; add width and height"),
        ({"map": [0, 1], "width": 2}, "has no height"),
        ({"map": [0, 1, 2], "width": 2, "height": 2}, "width 2 times height 2 are 4 cells, and map has 3"),
        (
            {"map": [0, 1, 1, 2], "width": 2, "height": 2},
            r"pixel 1 is in two cells \(column 1, row 0; column 0",
        ),
        ({"map": [-1, -1], "width": 2, "height": 1}, "all cells are -1"),
        ({"map": [0, None], "width": 2, "height": 1}, "cell 1 of map is None; write a whole number"),
        ({"map": [0, 1.5], "width": 2, "height": 1}, "cell 1 of map is 1.5; write a whole number"),
        ({"map": {}, "width": 2, "height": 1}, "is no ledmap of WLED"),
        ([0, 1], "is no ledmap of WLED"),
    ],
)
def test_a_ledmap_without_positions_is_refused_with_the_remedy(data: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_ledmap(json.dumps(data), 0.05)


def test_65535_is_a_gap_of_a_ledmap_as_in_wled() -> None:
    text = json.dumps({"width": 3, "height": 1, "map": [0, 65535, 1], "n": "x", "physical": []})
    assert sorted(lights(exchange.from_ledmap(text, 0.05))) == [0, 1]


COORDINATE = st.integers(-30, 30).map(lambda number: number / 10)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


@st.composite
def maps(draw: st.DrawFn) -> MapFile:
    """Draw a map with bent strips of several pitches, in either direction, with numbers that are skipped."""
    strips: dict[str, dict[str, Any]] = {}
    end = 0
    for name in draw(st.lists(st.sampled_from(["desk", "wall", "strip_1", "7"]), max_size=4, unique=True)):
        line = draw(st.lists(POINT, min_size=2, max_size=5, unique=True))
        pixels = draw(st.integers(1, 40))
        skipped = draw(st.sampled_from([0, 0, 1, 7]))
        direction = draw(st.sampled_from([1, -1]))
        strips[name] = {"line": [list(point) for point in line], "pixels": pixels, "direction": direction}
        strips[name]["offset"] = end + skipped if skipped else None
        end += skipped + pixels
    return MapFile.model_validate({"strips": strips})


@settings(max_examples=60)
@given(maps())
def test_csv_gives_back_all_lights_with_their_numbers(file: MapFile) -> None:
    expected = lights(file.strips)
    if len(np.unique(np.round(list(expected.values()), 5), axis=0)) < 2:
        return
    back = exchange.from_csv(exchange.to_csv(file))
    assert_same_lights(lights(back), expected, 0.006)
    again = exchange.from_csv(exchange.to_csv(MapFile.model_validate({"strips": dumped(back)})))
    assert_same_lights(lights(again), lights(back), 0.006)


def dumped(strips: dict[str, StripEntry]) -> dict[str, Any]:
    return {
        name: {**strip.model_dump(), "line": [list(point) for point in strip.line]}
        for name, strip in strips.items()
    }


@st.composite
def grids(draw: st.DrawFn) -> dict[tuple[int, int], int]:
    """Draw numbers by cell: walks in a grid with jumps, bends and skipped numbers."""
    cells: dict[tuple[int, int], int] = {}
    number = draw(st.integers(0, 5))
    at = (draw(st.integers(0, 9)), draw(st.integers(0, 9)))
    for _ in range(draw(st.integers(1, 40))):
        cells.setdefault(at, number)
        number += 1 + draw(st.sampled_from([0, 0, 0, 0, 0, 1, 3]))
        jump = draw(st.sampled_from([(1, 0), (1, 0), (1, 0), (0, 1), (-1, 0), (1, 1), (2, 0), (5, 3)]))
        at = ((at[0] + jump[0]) % 10, (at[1] + jump[1]) % 10)
    return cells


@settings(max_examples=60)
@given(grids())
def test_a_ledmap_is_the_same_after_import_and_export(cells: dict[tuple[int, int], int]) -> None:
    grid = np.full((10, 10), -1)
    for (column, row), number in cells.items():
        grid[row, column] = number
    text = json.dumps({"width": 10, "height": 10, "map": grid.ravel().tolist()})
    strips = exchange.from_ledmap(text, 0.05)
    places = {number: np.array([column, 0.0, 9 - row]) * 0.05 for (column, row), number in cells.items()}
    assert_same_lights(lights(strips), places, 0.006)
    back = json.loads(exchange.to_ledmap(MapFile.model_validate({"strips": dumped(strips)}), "front", 0.05))
    rows, columns = np.nonzero(grid >= 0)
    trimmed = grid[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert np.array(back["map"]).reshape(back["height"], back["width"]).tolist() == trimmed.tolist()


def csv_of(points: NDArray[Any], header: str = "x,y,z\n") -> str:
    return header + "".join(",".join(f"{value:.5f}" for value in point) + "\n" for point in points)


def spiral(turns: float, count: int) -> NDArray[np.float64]:
    share = np.linspace(0.0, 1.0, count) ** 1.5
    angle = 2 * np.pi * turns * share
    radius = 0.9 - 0.7 * share
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 2.0 * share])


RANDOM = np.random.default_rng(7)
TREES: dict[str, NDArray[Any]] = {
    "two pixels at each place": np.repeat(spiral(4, 40), 2, axis=0),
    "bunches": np.repeat(spiral(3, 20), RANDOM.integers(1, 5, 20), axis=0),
    "uneven steps": spiral(5, 120),
    "no order": RANDOM.uniform(-1, 1, (80, 3)),
    "noise": np.column_stack([np.arange(60) * 0.05, *RANDOM.normal(0, 0.004, (2, 60))]),
    "bunch at the start": np.vstack([np.zeros((6, 3)), [[0.1 * n, 0, 0] for n in range(1, 20)]]),
    "two pitches": np.array([[n / 60, 0, 0] for n in range(60)] + [[1 + n / 30, 0, 0] for n in range(30)]),
    "one missing": np.array([[n / 30, 0, 1] for n in range(40) if n != 17]),
}


@pytest.mark.parametrize("name", TREES)
def test_irregular_pixels_stay_where_they_are(name: str) -> None:
    points = TREES[name]
    strips = exchange.from_csv(csv_of(points))
    assert_same_lights(lights(strips), dict(enumerate(points)), 0.006)
    assert len(strips) <= max(10, len(points) / 5), "most pixels share a strip"
    findings = check_map(MapFile.model_validate({"strips": dumped(strips)}), {})
    assert not [each.text for each in findings if "put vertices in order" in each.text]


def test_missing_pixel_ends_a_strip_if_a_gap_is_declared() -> None:
    strips = exchange.from_csv(csv_of(TREES["one missing"]), gap_m=0.05)
    assert [(strip.pixels, len(strip.line)) for strip in strips.values()] == [(17, 2), (22, 2)]


def test_pixels_at_one_place_are_refused_with_the_remedy() -> None:
    with pytest.raises(ConfigError, match=r"all pixels are at \[1.0, 2.0, 3.0\]; .* as a lamp"):
        exchange.from_csv("x,y,z\n1,2,3\n1,2,3\n")


def test_single_pixel_is_a_strip_of_one() -> None:
    strips = exchange.from_csv("x,y,z,strip\n0,0,0,a\n0.1,0,0,a\n0,1,0,b\n")
    assert {name: strip.pixels for name, strip in strips.items()} == {"a": 2, "b": 1}
    np.testing.assert_allclose(exchange.positions(strips["b"]), [[0, 1, 0]], atol=1e-6)


STATE: dict[str, Any] = {
    "on": True,
    "bri": 128,
    "mainseg": 0,
    "seg": [
        {"id": 0, "start": 5, "stop": 35, "len": 30, "grp": 2, "spc": 1, "of": 3, "rev": True, "mi": True,
         "n": "shelf", "col": [[255, 0, 0], [0, 0, 0], [0, 0, 0]]},
        {"id": 1, "start": 40, "stop": 60, "grp": 1, "spc": 0, "of": 0, "n": ""},
        {"stop": 0},
        {"stop": 0},
    ],
}  # fmt: skip
SOURCES: dict[str, Any] = {
    "a state": STATE,
    "presets with the same segments": {
        "0": {}, "1": {**STATE, "n": "Red"}, "4": {**STATE, "n": "Blue"},
        "7": {"playlist": {"ps": [1, 4]}, "on": True},
    },
    "lengths and missing names": {
        "seg": [{"id": 0, "start": 5, "len": 30, "n": "shelf"}, {"id": 1, "start": 40, "stop": 60, "n": None}]
    },
    "outputs": {"hw": {"led": {"total": 60, "ins": [
        {"start": 5, "len": 30, "pin": [2], "type": 22}, {"start": 40, "len": 20, "pin": [4], "skip": 0}]}}},
}  # fmt: skip


@pytest.mark.parametrize("name", SOURCES)
def test_segments_have_their_pixels_on_the_wire(name: str) -> None:
    segments = exchange.from_segments(json.dumps(SOURCES[name]))
    names = ["output_0", "output_1"] if name == "outputs" else ["shelf", "segment_1"]
    assert list(segments) == names
    assert [(each.start, each.pixels) for each in segments.values()] == [(5, 30), (40, 20)]
    strips = exchange.laid_out(segments, 0.02)
    assert [strip.offset for strip in strips.values()] == [5, 40]
    back = json.loads(exchange.to_segments(MapFile.model_validate({"strips": dumped(strips)})))["seg"]
    assert [(each["start"], each["stop"]) for each in back] == [(5, 35), (40, 60)]


def test_segments_of_a_matrix_have_the_pixels_of_all_rows() -> None:
    segments = exchange.from_segments(json.dumps({"seg": [
        {"id": 0, "start": 0, "stop": 12, "startY": 0, "stopY": 5, "n": "screen"},
        {"id": 1, "start": 2, "stop": 6, "startY": 5, "stopY": 8, "rY": True, "tp": True},
        {"id": 2, "start": 0, "stop": 0, "startY": 0, "stopY": 0},
    ]}))  # fmt: skip
    assert {name: each.pixels for name, each in segments.items()} == {"screen": 60, "segment_1": 12}
    assert [strip.offset for strip in exchange.laid_out(segments, 0.02).values()] == [None, None]


def test_names_of_segments_that_no_map_can_have_are_reported() -> None:
    notes: list[str] = []
    text = json.dumps({"seg": [{"id": 0, "start": 0, "stop": 9, "n": "Living room 💡"}]})
    assert list(exchange.from_segments(text, None, notes.append)) == ["Living_room_"]
    assert notes == ["segment 'Living room 💡' is called Living_room_, a name that a map can have"]


SCREEN = {"id": 0, "start": 0, "stop": 16, "startY": 0, "stopY": 8, "n": "screen"}
SHELF = {"id": 1, "start": 128, "stop": 158, "startY": 0, "stopY": 1, "n": "shelf"}
MATRICES: dict[str, Any] = {
    "a strip behind a matrix": ({"seg": [SCREEN, SHELF]}, {"screen": 0, "shelf": 128}),
    "a strip that does not begin there": (
        {"seg": [SCREEN, {**SHELF, "start": 140, "stop": 150}]}, {"screen": 0, "shelf": 140}),
    "a strip before the matrix in the list": ({"seg": [SHELF, SCREEN]}, {"screen": 0, "shelf": 128}),
    "a strip without rows": (
        {"seg": [SCREEN, {"id": 1, "start": 128, "stop": 158, "n": "shelf"}]}, {"screen": 0, "shelf": 128}),
}  # fmt: skip


@pytest.mark.parametrize("name", MATRICES)
def test_a_strip_behind_a_matrix_keeps_its_start(name: str) -> None:
    data, firsts = MATRICES[name]
    strips = exchange.laid_out(exchange.from_segments(json.dumps(data)), 0.02)
    assert first_pixels(strips) == firsts


OTHER = {"n": "Party", "seg": [{"id": 0, "start": 0, "stop": 9}]}


def test_presets_with_other_segments_are_chosen_by_number() -> None:
    text = json.dumps({"0": {}, "1": {**STATE, "n": "Red"}, "2": OTHER})
    with pytest.raises(ConfigError, match=r"presets 1 \(Red\), 2 \(Party\) have other segments; .* --preset"):
        exchange.from_segments(text)
    assert [each.pixels for each in exchange.from_segments(text, 2).values()] == [9]
    with pytest.raises(ConfigError, match="has no preset 3 with segments; use one of 1, 2"):
        exchange.from_segments(text, 3)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"seg": [{"id": 4, "start": 0, "stop": "all"}]}, "stop of segment 4 is 'all'; write a whole number"),
        (
            {"seg": [{"id": 4, "start": -3, "stop": 9}]},
            "start of segment 4 is -3; write a whole number from 0",
        ),
        ({"seg": [{"id": 4, "n": "desk"}]}, "segment 4 has neither stop nor len"),
        ({"seg": [{"start": 0, "stop": 9, "startY": 4, "stopY": 2}]}, "has startY 4 and stopY 2"),
        ({"seg": [{"stop": 0}, {"stop": 0}]}, "has no segments with pixels"),
        ({"seg": [7]}, "segment 0 is 7"),
        ({"0": {}, "1": {"on": True, "n": "Off"}}, "has no preset with segments"),
        ({"info": {}}, "has no segments of WLED"),
    ],
)
def test_segments_that_cannot_be_understood_are_named(data: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_segments(json.dumps(data))


def test_map_with_skipped_numbers_states_the_segments_of_its_output() -> None:
    strips = exchange.from_ledmap(ledmap(["5 6 7 . . 12 11 10"]), 0.1)
    text = exchange.strips_text(strips)
    assert parse_map_file(text.encode(), Path("x.yaml")).strips == strips
    described = yaml.safe_load("\n".join(line[2:] for line in text.splitlines()[-3:]))
    segments = [Segment.model_validate(each) for each in described["segments"]]
    in_message = [Strip(id=name, line_m=each.line, pixels=each.pixels) for name, each in strips.items()]
    pixel_map, problems = map_pixels(segments, in_message)
    assert problems == []
    frames = [StripFrame(id=name, rgb=bytes(range(1, 10))) for name in strips]
    shown = pixel_map.output_bytes(StripsFrame(stamp_ns=0, strips=tuple(frames)))
    lit = bytes(range(1, 10))
    assert shown == bytes(15) + lit + bytes(6) + lit


def test_a_map_without_skipped_numbers_has_no_segments() -> None:
    assert "#" not in exchange.strips_text(exchange.from_ledmap(ledmap(["0 1 2 . . 3 4 5"]), 0.1))


def test_strips_that_share_pixels_of_the_wire_are_found() -> None:
    line = [[0, 0, 0], [1, 0, 0]]
    file = MapFile.model_validate(
        {"strips": {
            "a": {"line": line, "pixels": 30},
            "b": {"line": [[0, 1, 0], [1, 1, 0]], "pixels": 30, "offset": 29},
            "c": {"line": [[0, 2, 0], [1, 2, 0]], "pixels": 30},
        }}
    )  # fmt: skip
    found = [(each.where, each.text) for each in check_map(file, {}) if "wire" in each.text]
    assert [where for where, _ in found] == ["strips.b"]
    assert "has pixels of the wire that a has, too" in found[0][1]


@pytest.mark.parametrize(
    ("corner", "texts"),
    [
        ((5.0, 4.0, 2.6), []),
        ((4.0, 2.6, -2.0), ["reaches 2.0 m below the floor; set up to the axis of the file that points up"]),
        ((150.0, 50.0, 100.0), ["is 100 m high; set unit, if it is not in metres"]),
    ],
)
def test_a_cloud_with_unlikely_axes_or_height_is_a_warning(corner: Vec3, texts: list[str]) -> None:
    points = np.array([[0.0, 0.0, 0.0], corner, [1.0, 1.0, 0.5]])
    file = MapFile.model_validate({"clouds": {"scan": {"file": "scan.ply"}}})
    found = [each.text for each in check_map(file, {"scan": points}) if each.where == "clouds.scan"]
    assert [text.partition(", such")[0] for text in found] == texts


def lamps_text(count: int) -> str:
    return "lamps:\n" + "".join(
        f"  l{n}: {{position: [{n % 316 / 20}, {n // 316 / 20}, 1]}}\n" for n in range(count)
    )


def test_map_of_100_000_lamps_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    path.write_text(lamps_text(100_000))
    began_s = time.process_time()
    message = r"has 200001 keys, limit 80000, and a map holds about 20000 lamps"
    with pytest.raises(ConfigError, match=message):
        read_map_file(path)
    with pytest.raises(ConfigError, match=message):
        parse_map_file(path.read_bytes(), path)
    assert time.process_time() - began_s < 1.0


def test_maximum_number_of_lamps_is_compared_in_a_second() -> None:
    lamps = {f"l{n}": LampEntry(position=(n % 150 / 10, n // 150 / 10, 1.0)) for n in range(20_000)}
    lamps |= {f"twin{n}": LampEntry(position=(1.0, 1.0, 1.0)) for n in range(1000)}
    began_s = time.process_time()
    assert len(list(check_lamps(lamps, None))) == 1000
    assert time.process_time() - began_s < 3.0


COORDINATES = st.integers(0, 3).map(lambda n: n * 0.004)


@given(st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=2, max_size=12))
def test_lamps_at_one_place_match_a_comparison_of_all_pairs(places: list[Vec3]) -> None:
    lamps = {str(n): LampEntry(position=place) for n, place in enumerate(places)}
    found = [each for each in check_lamps(lamps, (5.0, 5.0)) if "is where" in each.text]
    away_m = np.linalg.norm(np.array(places)[:, None] - np.array(places)[None], axis=2)
    near = away_m + np.eye(len(places)) < SAME_PLACE_M
    assert bool(found) == bool(near.any())
    for each in found:
        index = int(each.where.rpartition(".")[2])
        other = int(each.text.split()[2])
        assert other < index
        assert near[index, other]
    exact = [index for index, place in enumerate(places) if place in places[:index]]
    assert {f"lamps.{index}" for index in exact} <= {each.where for each in found}
