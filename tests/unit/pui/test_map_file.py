"""Maps: the shipped one, the toolkit's, and every way to get one wrong."""

import json
import math
from pathlib import Path

import pytest
import yaml

from pointit.geometry.polyline import Polyline
from pointit.runtime import ConfigError
from pointit.schemas import decode, encode
from pointit.schemas.environment import Environment
from pointit.services.pui.map_file import load_map, read_map, shipped_maps
from tests.support.data import data_file

WHOLE = """
leds:
  lamp-a:
    position: [1, 2.5, 3]
strips:
  7:
    line: [[0, 0, 1], [2, 0, 1]]
    length: 2.0
    direction: -1
    pixels: 60
belts:
  main:
    centerline: [[0, 0, 1], [1, 0, 1], [1, 1, 1]]
    width: 0.4
  side:
    centerline: [[1, 1, 1], [1, 3, 1]]
    width: 0.3
links:
  - {from: main, to: side}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "site.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_part_of_a_map_is_read(tmp_path: Path) -> None:
    read = read_map(write(tmp_path, WHOLE), 17)
    assert (read.stamp_ns, read.name) == (17, "site")
    assert [(lamp.id, lamp.position_m) for lamp in read.lamps] == [("lamp-a", (1.0, 2.5, 3.0))]
    strip = read.strips[0]
    assert (strip.id, strip.pixels, strip.direction) == ("7", 60, -1)
    assert strip.line_m == ((0.0, 0.0, 1.0), (2.0, 0.0, 1.0))
    assert [(belt.id, belt.width_m, len(belt.line_m)) for belt in read.belts] == [
        ("main", 0.4, 3),
        ("side", 0.3, 2),
    ]
    assert [(link.source, link.target) for link in read.links] == [("main", "side")]
    assert decode(Environment, encode(read)) == read


def test_the_shipped_lab_is_the_papers() -> None:
    assert "lab" in shipped_maps()
    lab = load_map("lab", 0)
    assert lab.name == "lab"
    theirs = read_map(data_file("pointit-ros2/tutorial_scenario_1_2_3.yaml"), 0)
    assert (lab.lamps, lab.strips, lab.belts) == (theirs.lamps, theirs.strips, theirs.belts)
    assert [strip.pixels for strip in lab.strips] == [150, 150]


@pytest.mark.parametrize("name", ["belt", "tutorial_scenario_4"])
def test_the_toolkits_conveyor(name: str) -> None:
    conveyor = read_map(data_file(f"pointit-ros2/{name}.yaml"), 0)
    assert (len(conveyor.lamps), len(conveyor.strips), len(conveyor.belts)) == (3, 22, 8)
    assert sum(strip.pixels for strip in conveyor.strips) == 1228
    raw = yaml.safe_load(data_file(f"pointit-ros2/{name}.yaml").read_text(encoding="utf-8"))
    for belt in conveyor.belts:
        length = Polyline(belt.line_m).length_m
        assert math.isclose(length, raw["belts"][belt.id]["length"], abs_tol=0.004)


def test_a_path_is_relative_to_the_current_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, WHOLE)
    monkeypatch.chdir(tmp_path)
    assert load_map("site.yaml", 0).name == "site"
    assert load_map("./site.yaml", 0).name == "site"
    (tmp_path / "lab.yaml").write_text("leds: {a: {position: [0, 0, 0]}}", encoding="utf-8")
    assert len(load_map("lab", 0).strips) == 2, "a bare name is the shipped map"
    assert len(load_map("lab.yaml", 0).strips) == 0


def test_an_unknown_name_lists_the_shipped_maps() -> None:
    with pytest.raises(ConfigError, match=r"map 'laboratory' is not shipped: use one of conveyor, lab") as caught:
        load_map("laboratory", 0)
    assert "./laboratory.yaml" in str(caught.value)


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(ConfigError, match=r"nowhere/site\.yaml: cannot be read"):
        load_map("nowhere/site.yaml", 0)


BROKEN = [
    ("", "the map is empty"),
    ("leds: {}\nstrips:\n", "the map is empty"),
    ("- 1", "a mapping"),
    ("leds: [", "is not YAML"),
    ("lamps: {a: {position: [0, 0, 0]}}", "lamps: is not known|use one of leds, strips, belts, links"),
    ("leds: 3", "leds: write a mapping of names to entries, not 3"),
    ("leds: {a: 3}", "leds.a: write a mapping with position, not 3"),
    ("leds: {a: {}}", "leds.a.position: is missing; add it"),
    ("leds: {a: {position: [1, 2]}}", "leds.a.position: |three numbers|[1, 2]"),
    ("leds: {a: {position: [1, 2, 3, 4]}}", "leds.a.position: |[1, 2, 3, 4]"),
    ("leds: {a: {position: [1, 2, x]}}", "leds.a.position: |'x'"),
    ("leds: {a: {position: [1, 2, true]}}", "leds.a.position: |True"),
    ("leds: {a: {position: [1, 2, .nan]}}", "leds.a.position: |nan"),
    ("leds: {a: {position: [1, 2, .inf]}}", "leds.a.position: |inf"),
    ("leds: {a: {position: 5}}", "leds.a.position: |not 5"),
    ("leds: {a: {position: [1, 2, 3], color: red}}", "leds.a.color: is not known|'red'|remove it"),
    ("leds: {'a/b': {position: [1, 2, 3]}}", "leds: |'a/b'|letters"),
    ("leds: {1: {position: [1, 2, 3]}, '1': {position: [1, 2, 3]}}", "leds: 1 stands there twice"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], direction: 1}}", "strips.s.pixels: is missing"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9}}", "strips.s.direction: is missing"),
    ("strips: {s: {pixels: 9, direction: 1}}", "strips.s.line: is missing"),
    ("strips: {s: {line: [[0, 0, 0]], pixels: 9, direction: 1}}", "strips.s.line: |at least two points"),
    ("strips: {s: {line: 4, pixels: 9, direction: 1}}", "strips.s.line: |list of points|not 4"),
    (
        "strips: {s: {line: [[0, 0, 0], [1, 0]], pixels: 9, direction: 1}}",
        "strips.s.line: vertex 1: |[1, 0]",
    ),
    (
        "strips: {s: {line: [[1, 0, 0], [1, 0, 0]], pixels: 9, direction: 1}}",
        "strips.s.line: |two different points",
    ),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 0, direction: 1}}", "strips.s.pixels: |not 0"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 1.5, direction: 1}}", "strips.s.pixels: |1.5"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 5000, direction: 1}}", "strips.s.pixels: |4096"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9, direction: 2}}", "strips.s.direction: |not 2"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9, direction: yes}}", "strips.s.direction: |True"),
    (
        "strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9, direction: 1, length: -2}}",
        "strips.s.length: |not -2",
    ),
    ("belts: {b: {centerline: [[0, 0, 0], [1, 0, 0]]}}", "belts.b.width: is missing"),
    ("belts: {b: {centerline: [[0, 0, 0], [1, 0, 0]], width: 0}}", "belts.b.width: |above 0|not 0"),
    ("belts: {b: {line: [[0, 0, 0], [1, 0, 0]], width: 1}}", "belts.b.centerline: is missing"),
    (WHOLE.replace("to: side", "to: sidee"), "links.0.to: there is no belt 'sidee'|main, side"),
    (WHOLE.replace("from: main", "from: 3"), "links.0.from: there is no belt '3'"),
    (WHOLE.replace("from: main, ", ""), "links.0.from: is missing"),
    (WHOLE.replace("- {from: main, to: side}", "main: side"), "links: write a list"),
    (WHOLE.replace("{from: main, to: side}", "main"), "links.0: write a mapping with from, to"),
]


@pytest.mark.parametrize(("text", "parts"), BROKEN)
def test_a_broken_map_is_one_sentence(tmp_path: Path, text: str, parts: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        read_map(path, 0)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    for part in parts.split("|"):
        assert part in said, said


def test_a_map_too_large_to_travel_is_refused(tmp_path: Path) -> None:
    line = [[0.5, number / 7, 1.5] for number in range(40_000)]
    path = write(tmp_path, json.dumps({"strips": {"long": {"line": line, "pixels": 60, "direction": 1}}}))
    with pytest.raises(
        ConfigError, match=r"site.yaml: the map has \d+ bytes as it travels and at most 1048576"
    ):
        read_map(path, 0)


def test_numbers_that_yaml_takes_for_text_are_numbers(tmp_path: Path) -> None:
    read = read_map(write(tmp_path, "leds: {a: {position: [1e-3, 2, 3]}}"), 0)
    assert read.lamps[0].position_m == (0.001, 2.0, 3.0)


def test_strips_are_the_lanes_of_a_map_without_belts(tmp_path: Path) -> None:
    text = """
strips:
  0: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9, direction: 1}
  1: {line: [[1, 0, 0], [1, 2, 0]], pixels: 9, direction: 1}
links: [{from: 0, to: 1}]
"""
    links = read_map(write(tmp_path, text), 0).links
    assert [(link.source, link.target) for link in links] == [("0", "1")]
