"""Maps: the shipped one, the toolkit's, ways to get one wrong; frames that align trackers with the room."""

import json
import math
from pathlib import Path

import pytest
import yaml

from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import BoxSolid
from pointit.maps.file import load_map, shipped_maps
from pointit.maps.frames import aligned, frame_of, frame_or_problem, point_in_world
from pointit.runtime.errors import ConfigError
from pointit.schemas import TrackedObject, decode, encode
from pointit.schemas.environment import Environment
from tests.support.data import data_file

WHOLE = """
lamps:
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

SOLIDS = """
boxes:
  desk: {center: [1, 2, 0.4], size: [1.6, 0.8, 0.8], yaw_deg: 90}
planes:
  wall: {center: [4, 0, 1], normal: [-2, 0, 0], size: [6, 3]}
  floor: {center: [0, 0, 0], normal: [0, 0, 1]}
cylinders:
  column: {center: [0, 0, 0], radius: 0.3, height: 3}
spheres:
  globe: {center: [0, 1, 1], radius: 0.25}
"""

THINGS = """
lamps: {lamp: {position: [0, 3, 1]}}
strips: {shelf: {line: [[0, 0, 1], [2, 0, 1], [2, 2, 1]], pixels: 60}}
things:
  box: {center: [1, 2, 1], size: [0.4, 0.3, 0.2], yaw_deg: 90, light: {strip: shelf, from: 0.5, to: 1}}
  corner: {light: {strip: shelf, from: 1.5, to: 3}, label: the corner, dwell_s: 2}
  radio: {light: lamp, mode: switch, press: true}
"""

AT = """
lamps: {lamp: {position: [0, 3, 1]}}
strips:
  beside: {line: [[1, 3.4, 1], [1, -0.2, 1]], pixels: 60}
  across: {line: [[0, 2, 1], [2, 2, 1]], pixels: 60}
belts:
  main: {centerline: [[1.2, 0, 1], [1.2, 4, 1]], width: 0.4}
  bent: {centerline: [[5, 0, 1], [6, 1, 1], [6, 2, 1]], width: 0.4}
things:
  exit: {at: {belt: main, from: 3, to: 4.0005}}
  corner: {at: {belt: bent, from: 0.2, to: 2.4}, light: lamp}
  agv1: {at: object, mode: switch, press: true, dwell_s: 2, label: the cart}
"""

FENCE = "fences: {f: {kind: keep_in, outline: [[0, 0], [1, 0], [0, 1]]}}"


def write(folder: Path, text: str) -> Path:
    path = folder / "site.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def loaded(path: Path, stamp_ns: int) -> Environment:
    return load_map(str(path), stamp_ns)


def test_strip_without_a_direction_begins_at_its_first_point(tmp_path: Path) -> None:
    path = write(tmp_path, "strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9}}")
    assert loaded(path, 0).strips[0].direction == 1


def test_every_part_of_a_map_is_read(tmp_path: Path) -> None:
    read = loaded(write(tmp_path, WHOLE), 17)
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


def test_things_are_where_they_or_their_lights_are(tmp_path: Path) -> None:
    box, corner, radio = loaded(write(tmp_path, THINGS), 0).things
    assert (box.center_m, box.size_m, box.yaw_rad) == ((1, 2, 1), (0.4, 0.3, 0.2), math.pi / 2)
    assert (box.strip, box.part_m, box.lamp, box.mode) == ("shelf", (0.5, 1.0), "", "button")
    assert corner.center_m == pytest.approx((1.75, 0.5, 1.0))  # from (1.5, 0) by (2, 0) to (2, 1)
    assert corner.size_m == pytest.approx((0.5, 1.0, 0.1))
    assert (corner.label, corner.dwell_s) == ("the corner", 2.0)
    assert (radio.center_m, radio.size_m, radio.lamp) == ((0, 3, 1), (0.2, 0.2, 0.2), "lamp")
    assert (radio.mode, radio.press, radio.dwell_s) == ("switch", True, None)


def test_belt_part_is_a_box_lit_by_its_strip(tmp_path: Path) -> None:
    read = loaded(write(tmp_path, AT), 0)
    exit_, corner, cart = read.things
    assert exit_.center_m == pytest.approx((1.2, 3.5, 1.0))
    assert exit_.size_m == pytest.approx((1.0, 0.4, 0.1))
    assert exit_.yaw_rad == pytest.approx(math.pi / 2)
    assert (exit_.strip, exit_.lamp) == ("beside", "")
    assert exit_.part_m == pytest.approx((0.0, 0.4), abs=0.06)  # the strip ends at 3.4 m
    assert (corner.strip, corner.lamp) == ("", "lamp")
    solid = BoxSolid(corner.center_m, corner.size_m, corner.yaw_rad)
    assert all(solid.contains(place) for place in ((5.3, 0.3, 1), (5.9, 0.9, 1), (6, 1, 1), (6, 1.9, 1)))
    assert not solid.contains((5, 0, 1))
    assert (cart.is_tracked, cart.mode, cart.press, cart.dwell_s) == (True, "switch", True, 2.0)
    assert read.fixed_things == (exit_, corner)


def test_solids_are_read(tmp_path: Path) -> None:
    read = loaded(write(tmp_path, SOLIDS), 0)
    (box,), (wall, floor) = read.boxes, read.planes
    assert (box.id, box.center_m, box.size_m) == ("desk", (1.0, 2.0, 0.4), (1.6, 0.8, 0.8))
    assert math.isclose(box.yaw_rad, math.pi / 2)
    assert (wall.id, wall.normal, wall.size_m) == ("wall", (-1.0, 0.0, 0.0), (6.0, 3.0))
    assert (floor.id, floor.normal, floor.size_m) == ("floor", (0.0, 0.0, 1.0), None)
    assert [(each.id, each.radius_m, each.height_m) for each in read.cylinders] == [("column", 0.3, 3.0)]
    assert [(each.id, each.center_m, each.radius_m) for each in read.spheres] == [
        ("globe", (0.0, 1.0, 1.0), 0.25)
    ]
    assert decode(Environment, encode(read)) == read


def test_fences_are_read_with_and_without_heights(tmp_path: Path) -> None:
    text = (
        "fences:\n"
        "  hall: {kind: keep_in, outline: [[0, 0], [6, 0], [6, 4], [0, 4]], high: 3}\n"
        "  desk: {kind: keep_out, outline: [[1, 1], [2, 1], [1, 2]], low: -0.5, high: 1e0}\n"
    )
    hall, desk = (read := loaded(write(tmp_path, text), 0)).fences
    assert (hall.id, hall.kind, hall.low_m, hall.high_m) == ("hall", "keep_in", None, 3.0)
    assert hall.outline_m == ((0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0))
    assert (desk.kind, desk.low_m, desk.high_m) == ("keep_out", -0.5, 1.0)
    assert decode(Environment, encode(read)) == read


def test_links_lead_from_anywhere_to_anywhere(tmp_path: Path) -> None:
    text = WHOLE.replace(
        "{from: main, to: side}", "{from: main, from_position: 0.5, to: side, to_position: 1}"
    )
    (link,) = loaded(write(tmp_path, text + "bays: {1: side}"), 0).links
    assert (link.source_position_m, link.target_position_m) == (0.5, 1.0)
    (link,) = loaded(write(tmp_path, WHOLE), 0).links
    assert (link.source_position_m, link.target_position_m) == (None, 0.0)


def test_positions_that_were_rounded_beyond_an_end_are_at_it(tmp_path: Path) -> None:
    text = WHOLE.replace(
        "{from: main, to: side}", "{from: main, from_position: 2.009, to: side, to_position: -0.009}"
    )
    (link,) = loaded(write(tmp_path, text), 0).links
    assert (link.source_position_m, link.target_position_m) == (2.0, 0.0)


def test_the_shipped_conveyor_is_the_papers() -> None:
    """Its lines keep within a millimetre of the published ones, whose vertices are a centimetre apart."""
    ours = load_map("conveyor", 0)
    theirs = loaded(data_file("pointit-ros2/tutorial_scenario_4.yaml"), 0)
    assert ours.lamps == theirs.lamps
    assert [(each.id, each.width_m) for each in ours.belts] == [
        (each.id, each.width_m) for each in theirs.belts
    ]
    assert [(strip.id, strip.pixels, strip.direction) for strip in ours.strips] == [
        (strip.id, strip.pixels, strip.direction) for strip in theirs.strips
    ]

    lines, originals = (
        [*(belt.line_m for belt in room.belts), *(strip.line_m for strip in room.strips)]
        for room in (ours, theirs)
    )
    for mine, original in zip(lines, originals, strict=True):
        line = Polyline(mine)
        their_line = Polyline(original)
        assert (mine[0], mine[-1]) == (original[0], original[-1])
        assert line.nearest_to(their_line.vertices_m)[1].max() < 0.00101
        assert their_line.nearest_to(line.vertices_m)[1].max() < 1e-9, "vertices are theirs"
        assert math.isclose(line.length_m, their_line.length_m, abs_tol=0.003)
    assert sum(len(belt.line_m) for belt in ours.belts) < 100


def test_the_shipped_lab_is_the_papers() -> None:
    assert "lab" in shipped_maps()
    lab = load_map("lab", 0)
    assert lab.name == "lab"
    theirs = loaded(data_file("pointit-ros2/tutorial_scenario_1_2_3.yaml"), 0)
    assert (lab.lamps, lab.strips, lab.belts) == (theirs.lamps, theirs.strips, theirs.belts)
    assert [strip.pixels for strip in lab.strips] == [150, 150]


@pytest.mark.parametrize("name", ["belt", "tutorial_scenario_4"])
def test_the_toolkits_conveyor(name: str) -> None:
    conveyor = loaded(data_file(f"pointit-ros2/{name}.yaml"), 0)
    assert (len(conveyor.lamps), len(conveyor.strips), len(conveyor.belts)) == (3, 22, 8)
    assert sum(strip.pixels for strip in conveyor.strips) == 1228
    raw = yaml.safe_load(data_file(f"pointit-ros2/{name}.yaml").read_text(encoding="utf-8"))
    for belt in conveyor.belts:
        length = Polyline(belt.line_m).length_m
        assert math.isclose(length, raw["belts"][belt.id]["length"], abs_tol=0.004)


@pytest.mark.parametrize("ends", [b"\n", b"\r\n"])
@pytest.mark.parametrize("name", ["belt", "lab", "tutorial_scenario_1_2_3", "tutorial_scenario_4"])
def test_the_toolkits_maps_are_read_with_any_line_ends(tmp_path: Path, name: str, ends: bytes) -> None:
    original = data_file(f"pointit-ros2/{name}.yaml")
    path = tmp_path / original.name
    path.write_bytes(b"\n".join(original.read_bytes().splitlines()).replace(b"\n", ends))
    assert loaded(path, 0) == loaded(original, 0)


def test_a_path_is_relative_to_the_current_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, WHOLE)
    monkeypatch.chdir(tmp_path)
    assert (load_map("site.yaml", 0).name, load_map("./site.yaml", 0).name) == ("site", "site")
    (tmp_path / "lab.yaml").write_text("lamps: {a: {position: [0, 0, 0]}}", encoding="utf-8")
    assert len(load_map("lab", 0).strips) == 2, "a bare name is the shipped map"
    assert len(load_map("lab.yaml", 0).strips) == 0


def test_an_unknown_name_lists_the_shipped_maps() -> None:
    with pytest.raises(
        ConfigError, match=r"map 'laboratory' is not shipped: use one of arena, conveyor, lab"
    ) as caught:
        load_map("laboratory", 0)
    assert "./laboratory.yaml" in str(caught.value)


BROKEN = [
    ("", "the map is empty"),
    ("- 1", "a mapping"),
    ("lamps: [", "is not YAML"),
    ("lights: {a: {position: [0, 0, 0]}}", "is not a map|sections such as lamps, strips, belts"),
    ("leds: {}\nlamps: {}", "leds: is not a section of maps"),
    ("lamps: 3", "lamps: write a mapping of names to entries, not 3"),
    ("lamps: {a: 3}", "lamps.a: write a mapping with position, not 3"),
    ("lamps: {a: {position: [1, 2]}}", "lamps.a.position: |three numbers|[1, 2]"),
    ("lamps: {a: {position: [1, 2, x]}}", "lamps.a.position: |'x'"),
    ("lamps: {a: {position: [1, 2, .nan]}}", "lamps.a.position: |nan"),
    ("lamps: {a: {position: [1, 2, 3], color: red}}", "lamps.a.color: is not known|'red'|remove it"),
    ("lamps: {'a/b': {position: [1, 2, 3]}}", "lamps: |'a/b'|letters"),
    ("lamps: {1: {position: [1, 2, 3]}, '1': {position: [1, 2, 3]}}", "the key '1' occurs twice"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], direction: 1}}", "strips.s.pixels: is missing"),
    ("strips: {s: {line: [[0, 0, 0]], pixels: 9, direction: 1}}", "strips.s.line: |at least two points"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0]], pixels: 9, direction: 1}}", "strips.s.line: vertex 1: |[1, 0]"),
    (
        "strips: {s: {line: [[1, 0, 0], [1, 0, 0]], pixels: 9, direction: 1}}",
        "strips.s.line: |two different points"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 0, direction: 1}}", "strips.s.pixels: |not 0"),
    ("strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 5000, direction: 1}}", "strips.s.pixels: |4096"),
    (
        "strips: {s: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9, direction: 1, length: -2}}",
        "strips.s.length: |not -2"),
    ("belts: {b: {centerline: [[0, 0, 0], [1, 0, 0]], width: 0}}", "belts.b.width: |above 0|not 0"),
    (WHOLE.replace("to: side", "to: sidee"), "links.0.to: there is no belt 'sidee'|main, side"),
    (WHOLE.replace("from: main, ", ""), "links.0.from: is missing"),
    (WHOLE.replace("to: side}", "to: side, via: x}"), "links.0.via: is not known|from, to, from_position"),
    (
        WHOLE.replace("to: side}", "to: side, from_position: far}"),
        "links.0.from_position: write a number of metres along the belt, not 'far'"),
    (
        WHOLE.replace("to: side}", "to: side, from_position: 2.02}"),
        "links.0.from_position: 2.02 m is off belt main; write 0 to 2"),
    (WHOLE + "bays: [side]", "bays: write a mapping of bays to belts such as {1: belt}, not ['side']"),
    ("lamps: {a: {position: [1, 2, 3]}}\nbays: {1: b}", "bays.1: |the map has neither belts nor strips"),
    ("boxes: {b: {center: [0, 0, 0], size: [1, 1]}}", "boxes.b.size: write 3 sizes in metres, all above 0"),
    ("boxes: {b: {center: [0, 0, 0], size: [1, 1, 0]}}", "boxes.b.size: |not [1, 1, 0]"),
    ("planes: {p: {center: [0, 0, 0], normal: [0, 0, 0]}}", "planes.p.normal: |has no direction"),
    ("planes: {p: {center: [0, 0, 0], normal: [0, 0, 1], size: [1, -1]}}", "planes.p.size: write 2 sizes"),
    ("cylinders: {c: {center: [0, 0, 0], radius: -1, height: 1}}", "cylinders.c.radius: |above 0, not -1"),
    (THINGS.replace("shelf, from: 0.5", "shelv, from: 0.5"), "no strip 'shelv'; did you mean shelf?"),
    (THINGS.replace("light: lamp", "light: lamb"), "things.radio.light: there is no lamp 'lamb'|lamp"),
    (THINGS.replace("light: lamp", "light: shelf"), "light: shelf is a strip; write {strip: shelf, from:"),
    (THINGS.replace("from: 1.5", "from: far"), "things.corner.light: write the name of a lamp|'far'"),
    (THINGS.replace("press: true", "press: maybe"), "things.radio.press: write true or false, not 'maybe'"),
    ("things: {t: 3}", "things.t: write a mapping with center, size, yaw_deg, light, mode|, not 3"),
    (THINGS.replace("to: 3", "to: 5"), "things.corner.light: goes from 1.5 to 5 m and strip shelf"),
    (THINGS.replace("from: 1.5", "from: 3"), "things.corner.light: goes from 3 to 3 m"),
    (THINGS.replace("from: 1.5, to: 3", "from: 4.0002, to: 4.0009"), "things.corner.light: goes from 4.0002"),
    (THINGS.replace("from: 1.5, to: 3", "from: -0.0009, to: -0.0002"), "things.corner.light: goes from -0.0"),
    (THINGS.replace("from: 1.5, ", ""), "things.corner.light: |{strip: NAME, from: METRES, to: METRES}"),
    (THINGS.replace("switch", "toggle"), "things.radio.mode: write claim, button or switch, not 'toggle'"),
    (THINGS.replace("[0.4, 0.3, 0.2]", "[0.4, 0, 0.2]"), "things.box.size: |above 0"),
    (THINGS.replace("[1, 2, 1]", "[1, .nan, 1]"), "things.box.center: a point is three numbers"),
    (THINGS.replace("size: [0.4, 0.3, 0.2], ", ""), "things.box: has no size"),
    (THINGS.replace("light: lamp, ", ""), "things.radio: is nowhere; give its center and size, or a light"),
    (THINGS.replace("dwell_s: 2", "dwell_s: 0"), "things.corner.dwell_s: write a number of seconds from"),
    (AT.replace("belt: main", "belt: maim"), "exit.at.belt: there is no belt 'maim'; did you mean main?"),
    ("things: {t: {at: {belt: b, from: 0, to: 1}}}", "things.t.at.belt: |'b'; add one to the map"),
    (AT.replace("to: 4.0005", "to: 5"), "things.exit.at: goes from 3 to 5 m and belt main from 0 to 4 m"),
    (AT.replace("at: object", "at: agv1"), "things.agv1.at: write object, for the tracked object|'agv1'"),
    (AT.replace("belt: main, ", ""), "things.exit.at: |{belt: NAME, from: METRES, to: METRES}"),
    (AT.replace("at: object", "at: object, center: [0, 0, 1]"), "things.agv1: has at|remove its center"),
    (AT.replace("4.0005}", "4.0005}, yaw_deg: 9"), "things.exit: has at|remove its center, size and yaw"),
    (
        AT.replace("at: object", "at: object, light: {strip: across, from: 0, to: 1}"),
        "things.agv1: is a tracked object, which has a lamp as its light or none"),
    (THINGS.replace("  radio:", "  ../x:"), "things: |../x"),
    (THINGS.replace("  radio:", "  <script>:"), "things: |<script>"),
    (THINGS.replace("the corner", '"a\\u0007b"'), "things.corner.label: write a name of at most 64 letters"),
    (
        "things: {" + ", ".join(f"t{i}: {{center: [0, 0, 1], size: [1, 1, 1]}}" for i in range(1001)) + "}",
        "things: there are 1001, limit 1000",
    ),
    (FENCE.replace("keep_in", "inside"), "fences.f.kind: write keep_in (robots stay inside)|not 'inside'"),
    (FENCE.replace("[0, 1]]", "[0, 1, 2]]"), "fences.f.outline: |corners [x, y] in metres|[0, 1, 2]"),
    (FENCE.replace(", [0, 1]]", "]"), "fences.f.outline: an outline needs at least three corners|not 2"),
    (FENCE.replace("[0, 1]]", "[2, 0]]"), "fences.f.outline: the outline has no area inside"),
    (
        FENCE.replace("[[0, 0], [1, 0], [0, 1]]", "[[0, 0], [1, 1], [1, 0], [0, 1]]"),
        "fences.f.outline: the outline crosses itself: the edges from corner 0 and corner 2 meet; list"),
    (FENCE.replace("]]", "]], low: 2, high: 1"), "fences.f: low is 2 m and high 1 m; low must be below high"),
    ("clouds: {c: {file: 3}}", "clouds.c.file: write the path of a .ply or .xyz file"),
    ("clouds: {c: {file: c.ply, scale: 1}}", "clouds.c.scale: is not known|file, columns, unit, up, origin"),
    (WHOLE.replace("- {from: main, to: side}", "main: side"), "links: write a list"),
    ]  # fmt: skip


@pytest.mark.parametrize(("text", "parts"), BROKEN)
def test_a_broken_map_is_one_sentence(tmp_path: Path, text: str, parts: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        loaded(path, 0)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    for part in parts.split("|"):
        assert part in said, said


def test_a_map_too_large_to_travel_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Environment, "max_bytes", 4096)
    line = [[0.5, number / 7, 1.5] for number in range(200)]
    path = write(tmp_path, json.dumps({"strips": {"long": {"line": line, "pixels": 60, "direction": 1}}}))
    with pytest.raises(ConfigError, match=r"site.yaml: the map has \d+ bytes as a message, limit 4096"):
        loaded(path, 0)


def test_strips_are_the_lanes_of_a_map_without_belts(tmp_path: Path) -> None:
    text = """
strips:
  0: {line: [[0, 0, 0], [1, 0, 0]], pixels: 9, direction: 1}
  1: {line: [[1, 0, 0], [1, 2, 0]], pixels: 9, direction: 1}
links: [{from: 0, to: 1}]
"""
    links = loaded(write(tmp_path, text), 0).links
    assert [(link.source, link.target) for link in links] == [("0", "1")]


FRAMES = """
lamps:
  lamp: {position: [1, 2, 3]}
frames:
  optitrack: {position: [1.5, 0.8, 0.2], yaw_deg: 90}
  slam: {orientation: [0, 0, 2, 0]}
"""


def test_objects_of_a_frame_are_transformed_into_the_room(tmp_path: Path) -> None:
    frame = frame_of(loaded(write(tmp_path, FRAMES), 1), "optitrack")
    cup = TrackedObject(
        id="cup",
        kind="red",
        position_m=(1.0, 0.0, 0.5),
        velocity_mps=(0.0, 1.0, 0.0),
        yaw_rad=0.1,
        length_m=0.2,
    )
    (seen,) = aligned([cup, cup], frame)[1:]

    assert seen.position_m == pytest.approx((1.5, 1.8, 0.7))
    assert seen.velocity_mps == pytest.approx((-1.0, 0.0, 0.0))
    assert seen.yaw_rad == pytest.approx(0.1 + math.pi / 2)
    assert (seen.id, seen.kind, seen.length_m) == ("cup", "red", 0.2)

    turned = frame_of(loaded(write(tmp_path, FRAMES), 1), "slam")
    assert point_in_world((1.0, 2.0, 3.0), turned) == pytest.approx((-1.0, -2.0, 3.0))


def test_an_unknown_frame_is_told_with_the_known_ones(tmp_path: Path) -> None:
    site = loaded(write(tmp_path, FRAMES), 1)
    bare = loaded(write(tmp_path, "lamps: {lamp: {position: [1, 2, 3]}}"), 1)
    with pytest.raises(
        ConfigError, match=r"has no frame 'optitrak'; it has optitrack, slam: did you mean optit"
    ):
        frame_of(site, "optitrak")
    assert frame_or_problem(site, "slam") == (frame_of(site, "slam"), "")
    frame, problem = frame_or_problem(bare, "camera")
    assert frame is None
    assert problem.startswith("the map site has no frame 'camera': add it to the map's frames")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{yaw_deg: 90, orientation: [0, 0, 0, 1]}", "has both yaw_deg and orientation; keep one of them"),
        ("{orientation: [0, 0, 0, 0]}", r"a rotation is a quaternion \[x, y, z, w\] that is not zero"),
    ],
)
def test_a_wrong_frame_is_told_with_file_key_and_remedy(tmp_path: Path, entry: str, message: str) -> None:
    text = f"lamps: {{lamp: {{position: [1, 2, 3]}}}}\nframes: {{optitrack: {entry}}}\n"
    with pytest.raises(ConfigError, match=rf"site\.yaml: frames\.optitrack.*{message}"):
        loaded(write(tmp_path, text), 1)
