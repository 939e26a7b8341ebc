"""Findings of `pointit map check`: every finding on a map that has just that, and nothing on a good one."""

from pathlib import Path

import pytest
import yaml

from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline
from pointit.maps.checks.check import check_map
from pointit.maps.checks.finding import MapFinding
from pointit.maps.file import map_path, read_clouds, read_map_file, shipped_maps
from pointit.maps.model import ENTRIES, MapFile
from pointit.runtime.config.validation_message import field_names
from tests.support.data import data_file

LAMPS = "lamps: {a: {position: [0, 3, 1]}, b: {position: [3, 3, 2]}}\n"


def found(folder: Path, text: str, person: tuple[float, float] | None = None) -> list[MapFinding]:
    path = folder / "site.yaml"
    path.write_text(text, encoding="utf-8")
    file = read_map_file(path)
    return check_map(file, read_clouds(path, file), person_m=person)


def belt(*points: tuple[float, float], width: float = 0.5) -> str:
    return f"{{centerline: {[[x, y, 1.0] for x, y in points]}, width: {width}}}"


def strip(*points: tuple[float, float], pixels: int = 30, more: str = "") -> str:
    return f"{{line: {[[x, y, 1.0] for x, y in points]}, pixels: {pixels}, direction: 1{more}}}"


A = belt((0, 0), (2, 0))
B = belt((2.1, 0), (4, 0))
C = belt((1, 0.3), (1, 2))
ROUND = belt((0, 0), (2, 0), (2, 2), (0, 2), (0, 0.3))
TWO = f"s: {strip((0, 0), (1, 0))}, t: {strip((0, 1), (2, 1), pixels=60)}"

FINDINGS: dict[str, tuple[str, list[tuple[str, str, str]]]] = {
    "links too far apart": (
        f"belts: {{a: {A}, b: {belt((3, 0), (5, 0))}}}\nlinks: [{{from: a, to: b}}]",
        [("error", "links.0", "a at 2 m and b at 0 m are 1.00 m apart, more than a belt's width of 0.5 m")]),
    "places off the belt": (
        f"belts: {{a: {A}, c: {C}}}\nlinks: [{{from: a, from_position: 9, to: c, to_position: -2}}]",
        [
            ("error", "links.0", "c at 0 m are"),
            ("error", "links.0.from_position", "9 m is off belt a; write 0 to 2"),
            ("error", "links.0.to_position", "-2 m is off belt c; write 0 to 1.7")]),
    "names that lead nowhere": (
        f"belts: {{a: {A}}}\nlinks: [{{from: a, to: z}}]\nbays: {{1: y}}",
        [
            ("error", "links.0.to", "there is no belt 'z'; use one of a"),
            ("error", "bays.1", "there is no belt 'y'; use one of a")]),
    "entered at its end": (
        f"belts: {{a: {A}, b: {belt((4, 0), (2.1, 0))}}}\nlinks: [{{from: a, to: b, to_position: 1.9}}]",
        [("warning", "links.0", "b is entered at its end, at 1.9 m; reverse its line")]),
    "the same link twice": (
        f"belts: {{a: {A}, b: {B}}}\nlinks: [{{from: a, to: b}}, {{from: a, to: b}}]",
        [("warning", "links.1", "is the same as links.0; remove one")]),
    "belts that meet without a link": (
        f"belts: {{a: {A}, b: {B}, c: {C}}}",
        [
            ("warning", "belts.a", "ends beside b and no link joins them|- {from: a, to: b}"),
            ("warning", "belts.c", "begins beside a and no link|- {from: a, from_position: 1.000, to: c}")]),
    "belts side by side are neighbours": (f"belts: {{a: {A}, b: {belt((0, 0.5), (2, 0.5))}}}", []),
    "a belt that nothing leads to or from": (
        f"belts: {{a: {A}, b: {B}, far: {belt((0, 5), (2, 5))}}}\nlinks: [{{from: a, to: b}}]",
        [("warning", "belts.far", "nothing leads to it or from it; add it to links, or give it a bay")]),
    "a dead end": (
        (f"belts: {{a: {A}, b: {B}, c: {C}}}\nbays: {{1: c}}\n"
            "links: [{from: a, to: b}, {from: a, from_position: 1, to: c}]"),
        [("warning", "belts.b", "ends without a bay and without a link")]),
    "a bay on a belt that leads on": (
        f"belts: {{a: {A}, b: {B}}}\nbays: {{1: a, 2: b}}\nlinks: [{{from: a, to: b}}]",
        [("error", "bays.1", "a does not end here, it leads on to b; remove the link")]),
    "a bay on a belt with a diverter before its end is fine": (
        f"belts: {{a: {A}, c: {C}}}\nbays: {{1: a, 2: c}}\nlinks: [{{from: a, from_position: 1, to: c}}]",
        []),
    "a circle without a way out": (
        (f"belts: {{a: {A}, b: {belt((2, 0), (2, 2), (0, 2), (0, 0))}, c: {belt((0, 5), (2, 5))}}}\n"
            "bays: {1: c}\nlinks: [{from: a, to: b}, {from: b, to: a}]"),
        [
            (
                "error", "links",
                "objects on b, a circulate forever; link one of these to a belt that has a bay")]),
    "a circle whose way out lies before where things come in": (
        (
            f"belts:\n  a: {ROUND}\n  c: {belt((0.2, -0.3), (0.2, -2))}\n"
            "bays: {1: c}\nlinks: [{from: a, to: a, to_position: 0.5}, {from: a, from_position: 0.2, to: c}]"
        ),
        [("error", "links.0", "0.58 m apart"), ("error", "links", "objects on a circulate forever")]),
    "a circle that passes a belt with a bay": (
        (f"belts:\n  e: {belt((-2, 0), (-0.1, 0))}\n  a: {ROUND}\n"
            f"  c: {belt((1, -0.3), (1, -2))}\nbays: {{1: c}}\n"
            "links: [{from: e, to: a}, {from: a, to: a}, {from: a, from_position: 1, to: c}]"),
        []),
    "a link across a belt": (
        (f"belts: {{a: {A}, x: {belt((2.5, -2), (2.5, 2), width=1.0)}, b: {belt((3, 0), (5, 0))}}}\n"
            "links: [{from: a, to: b}, {from: a, to: x, to_position: 2.0}]"),
        []),
    "a strip off its belt": (
        (f"belts: {{a: {A}}}\n"
            f"strips: {{near: {strip((0, 0.34), (1, 0.34))}, far: {strip((0, 0.36), (1, 0.36))}}}"),
        [("warning", "strips.far", "lies beside no belt, its pixels are up to 0.11 m from the edge of a")]),
    "too many pixels": (
        f"strips: {{{TWO}, u: {strip((0, 2), (1, 2), pixels=37)}}}",
        [
            (
                "warning", "strips.u",
                "37 pixels on 1.00 m are 37.0 a metre|median is 30.0; correct pixels (to about 30)")]),
    "another length": (
        f"strips: {{s: {strip((0, 0), (1, 0), more=', length: 1.5')}}}",
        [
            (
                "warning", "strips.s",
                "length is given as 1.5 m and the line is 1.000 m long; correct one of them")]),
    "vertices out of order": (
        f"strips: {{s: {strip((0, 0), (0, 0), (3, 0), (1, 0.1), (4, 0))}}}",
        [
            ("warning", "strips.s", "vertex 1 is where vertex 0 is"),
            ("warning", "strips.s", "turns by 177° at vertex 2, [3.0, 0.0, 1.0]; put vertices in order"),
            ("warning", "strips.s", "turns by 179° at vertex 3, [1.0, 0.1, 1.0]")]),
    "lamps that hardly anyone can point at": (
        "lamps: {a: {position: [0, 0, -0.2]}, b: {position: [2, 0, 5.5]}, c: {position: [4, 0, 5]}}",
        [
            ("error", "lamps.a", "is 0.2 m below the floor"),
            ("warning", "lamps.b", "is 5.5 m high, where pointing is difficult; mount it below 5 m")]),
    "lamps at one place": (
        "lamps: {a: {position: [0, 0, 1]}, b: {position: [2, 0, 1]}, c: {position: [2, 0, 1.005]}}",
        [("error", "lamps.c", "is where b is, [2.0, 0.0, 1.005]; correct one")]),
    "three lamps at one place": (
        "lamps: {a: {position: [0, 0, 1]}, b: &here {position: [2, 0, 1]}, c: *here, d: *here}",
        [("error", "lamps.c", "is where b is"), ("error", "lamps.d", "is where b is")]),
    "one lamp": (
        "lamps: {a: {position: [2, 0, 1]}}",
        [("warning", "lamps", "there is one lamp and localizing by pointing needs two")]),
    "a home without lamps": (
        "lamps: {}\nthings: {sofa: {home_assistant: light.sofa, center: [2, 0, 1], size: [0.3, 0.3, 0.3]}}",
        []),
    "a home with one lamp": (
        ("lamps: {a: {position: [2, 0, 1]}}\n"
            "things: {sofa: {home_assistant: light.sofa, light: a}}"),
        [("warning", "lamps", "there is one lamp and localizing by pointing needs two")]),
    "solids without an area": (
        ("boxes: {b: {center: [0, 0, 0], size: [1, 0.0005, 1]}}\n"
            "planes: {p: {center: [0, 0, 0], normal: [0, 0, 1], size: [1e-6, 1]},\n"
            "  whole: {center: [0, 0, 0], normal: [1, 0, 0]}}\n"
            "cylinders: {c: {center: [0, 0, 0], radius: 1, height: 1e-4}}\n"
            "spheres: {s: {center: [0, 0, 0], radius: 1e-4}}"),
        [
            ("error", "boxes.b", "is 0.0005 m small, too little to point at"),
            ("error", "planes.p", "is 1e-06 m small"), ("error", "cylinders.c", "is 0.0001 m small"),
            ("error", "spheres.s", "is 0.0001 m small")]),
    "things where others are": (
        (f"strips: {{s: {strip((0, 0), (1, 0))}, t: {strip((0, 0), (1, 0))}}}\n"
            "spheres: {a: {center: [0, 0, 0], radius: 1}, b: {center: [0, 0, 0], radius: 1},\n"
            "  c: {center: [0, 0, 0], radius: 2}}"),
        [
            ("warning", "strips.t", "is exactly where s is"),
            ("warning", "spheres.b", "is exactly where a is")]),
    "millimetres": (
        f"strips: {{s: {strip((0, 0), (5000, 0))}}}",
        [("warning", "map", "is 5000 m wide|; give positions in metres")]),
    "strips in millimetres on the floor": (
        f"strips: {{s: {strip((0, 0), (900, 0), pixels=180)}}}", [("warning", "map", "0.2 pixels a metre|")]),
    "a thing in millimetres": (
        "lamps: {}\nthings: {a: {center: [3900, 500, 1000], size: [90, 90, 90]}}",
        [("warning", "lamps", "there are no lamps"), ("warning", "map", "is 0 m wide and 1000 m high")]),
    "a large hall": (
        "lamps: {a: {position: [0, 0, 4.5]}, b: {position: [180, 0, 4.5]}, c: {position: [90, 60, 4]}}", []),
    "a fence without room": (
        "fences: {a: {kind: keep_in, outline: [[0, 0], [0.4, 0], [0.4, 2]], high: 0}}",
        [
            ("error", "fences.a", "ends at 0 m, not above the floor"),
            ("warning", "fences.a", "is 0.4 m wide, and robots stay inside")]),
    "fences that leave no place together": (
        ("fences: {a: {kind: keep_in, outline: [[0, 0], [2, 0], [2, 2], [0, 2]]},\n"
            "  b: {kind: keep_in, outline: [[1, 0], [3, 0], [3, 2], [1, 2]], low: 0, high: 3},\n"
            "  c: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], high: 1},\n"
            "  d: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], low: 1}}"),
        [("error", "fences.a, b", "leave no place for a robot: it stays inside every keep_in")]),
    "things of which one is half in another, and one is turned beside it": (
        ("things: {pot: {center: [2, 3, 1], size: [1, 1, 1]}, hob: {center: [2, 3.4, 1], size: [1, 1, 1]},\n"
            "  bar: {center: [1.4, 3, 1], size: [3, 0.1, 1], yaw_deg: 90}}"),
        [("warning", "things.hob", "lies in pot"), ("warning", "things.pot", "lies in hob")]),
    "things beside the room and in the floor": (
        ("things: {far: {center: [1, -9, 1], size: [1, 1, 1]}, pot: {center: [2, 1, 0.5], size: [1, 1, 1]},\n"
            "  deep: {center: [1, 2, 0.1], size: [1, 1, 1]}, near: {center: [6, 3, 1], size: [1, 1, 1]}}"),
        [
            ("warning", "things.far", "is 10.0 m outside of all else"),
            ("warning", "things.deep", "reaches 0.4 m below the floor")]),
    "things with parts of a strip in common, and one with its name": (
        (f"strips: {{s: {strip((0, 3), (3, 3))}}}\n"
            "things: {s: {light: {strip: s, from: 0, to: 1}}, t: {light: {strip: s, from: 1, to: 1.5}},\n"
            "  u: {light: {strip: s, from: 1.4, to: 2}}, a: {light: a}}"),
        [("warning", "things.u", "has the light of t; give each a light of its own")]),
    "a station of a belt, and tracked objects, with the light of others": (
        (f"strips: {{s: {strip((0, 3.3), (3, 3.3))}}}\nbelts: {{m: {belt((0, 3), (3, 3))}}}\nbays: {{1: m}}\n"
            "things: {t: {light: {strip: s, from: 0.2, to: 1}}, u: {at: {belt: m, from: 0.8, to: 2}},\n"
            "  agv1: {at: object, light: a}, agv2: {at: object, light: a}}"),
        [
            ("warning", "things.agv2", "has the light of agv1"),
            ("warning", "things.u", "has the light of t")]),
    "things that are too thin, or too many": (
        "things: {" + ", ".join(f"t{i}: {{center: [{i % 20}, {i // 20}, 1], size: [0.4, 0.4, {h}]}}"
            for i, h in enumerate(["0.0001"] + ["0.4"] * 200)) + "}",
        [
            ("error", "things.t0", "is 0.0001 m small"),
            ("warning", "things", "are 201, tested are up to 200")]),
    "fences that leave a gap": (
        ("fences: {a: {kind: keep_in, outline: [[0, 0], [2, 0], [2, 2], [0, 2]], low: 0},\n"
            "  c: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], high: 1},\n"
            "  d: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], low: 1.1}}"),
        []),
}  # fmt: skip


@pytest.mark.parametrize("case", FINDINGS)
def test_just_this_is_found(tmp_path: Path, case: str) -> None:
    text, expected = FINDINGS[case]
    lamps = "" if "lamps" in text else LAMPS
    findings = found(tmp_path, lamps + text)
    told = "\n".join(f"{each.severity} {each.where}: {each.text}" for each in findings)
    assert sorted((each.severity, each.where) for each in findings) == sorted(
        each[:2] for each in expected
    ), told
    for severity, where, parts in expected:
        texts = [each.text for each in findings if (each.severity, each.where) == (severity, where)]
        assert any(all(part in text for part in parts.split("|")) for text in texts), told
    for finding in findings:
        assert ";" in finding.text, "what to do is said"
        assert "\n" not in finding.text


@pytest.mark.parametrize(("person", "told"), [((0.0, 0.0), 1), ((0.0, 3.0), 0), (None, 0)])
def test_lamps_at_one_bearing_depend_on_the_standpoint(
    tmp_path: Path, person: tuple[float, float] | None, told: int
) -> None:
    text = "lamps: {a: {position: [-2, -0.05, 1]}, b: {position: [-4, 0.05, 2]}}"
    findings = found(tmp_path, text, person)
    assert [each.text.partition(",")[0] for each in findings] == ["all lie in one direction from [0.0"] * told


ODD_STRIPS = [("warning", "strips.17"), ("warning", "strips.19")]
"""These two have half as many pixels again, in the toolkit's map too."""


@pytest.mark.parametrize("name", shipped_maps())
def test_shipped_maps_are_in_order(name: str) -> None:
    with map_path(name) as path:
        file = read_map_file(path)
    findings = [(each.severity, each.where) for each in check_map(file, {})]
    assert findings == (ODD_STRIPS if name == "conveyor" else [])


@pytest.mark.parametrize("name", ["lab", "tutorial_scenario_1_2_3"])
def test_the_toolkits_laboratory_is_in_order(name: str) -> None:
    assert check_map(read_map_file(data_file(f"pointit-ros2/{name}.yaml")), {}) == []


@pytest.mark.parametrize("name", ["belt", "tutorial_scenario_4"])
def test_proposed_links_complete_the_conveyor_of_the_toolkit(name: str, tmp_path: Path) -> None:
    path = data_file(f"pointit-ros2/{name}.yaml")
    findings = check_map(read_map_file(path), {})
    assert [(each.severity, each.where) for each in findings][-2:] == ODD_STRIPS
    proposed = [each.text.partition("add to links: ")[2] for each in findings[:-2]]
    pairs = {(link["from"], link["to"]) for (link,) in (yaml.safe_load(text) for text in proposed)}
    with map_path("conveyor") as shipped:
        known = {(link.source, link.target) for link in read_map_file(shipped).links}
    # straight on across part_h is theirs to know; beside part_i lies part_h
    assert pairs == known - {("part_g", "part_i")} | {("part_h", "part_i")}
    completed = tmp_path / "completed.yaml"
    text = path.read_bytes().decode() + "\nlinks:\n" + "\n".join(f"  {text}" for text in proposed) + "\n"
    completed.write_bytes(text.encode())
    assert [(each.severity, each.where) for each in check_map(read_map_file(completed), {})] == ODD_STRIPS


def test_belts_far_apart_are_not_measured_against_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[int] = []
    nearest_to = Polyline.nearest_to

    def counted(line: Polyline, points_m: Array) -> tuple[Array, Array]:
        measured.append(len(points_m))
        return nearest_to(line, points_m)

    monkeypatch.setattr(Polyline, "nearest_to", counted)
    belts = ", ".join(f"b{index}: {belt((0, 3 * index), (2, 3 * index))}" for index in range(40))
    assert not [each for each in found(tmp_path, f"belts: {{{belts}}}") if "beside" in each.text]
    assert not measured
    found(tmp_path, f"belts: {{a: {belt((0, 0), (2, 0))}, b: {belt((2.1, 0), (4, 0))}}}")
    assert measured


GUIDE = (Path(__file__).parents[3] / "docs/reference/maps.md").read_text(encoding="utf-8")


SHELF = """
lamps: {a: {position: [0, 3, 1]}, b: {position: [3, 3, 2]}}
things:
  t1: {center: [2.6, 0.2, 1.4], size: [0.3, 0.3, 0.3], light: a}
  t2: {center: [2.6, -0.2, 1.4], size: [0.3, 0.3, 0.3], light: a, label: t1}
  t3: {center: [2.6, 0.2, 1.4], size: [1, 0.1, 1]}
  t4: {center: [0, -3, -1], size: [1, 1, 1]}
"""


def test_things_that_hide_or_confuse_each_other_are_named(tmp_path: Path) -> None:
    assert [(each.severity, each.where, each.text.partition(";")[0]) for each in found(tmp_path, SHELF)] == [
        ("error", "things.t4", "ends 0.5 m below the floor"),
        ("warning", "things.t2", "is called as t1 is"),
        ("warning", "things.t2", "has the light of t1"),
        ("warning", "things.t1", "lies in t3"),
        ("warning", "things.t3", "lies in t1"),
    ]
    confused = [each for each in found(tmp_path, SHELF, (0.0, 0.0)) if "as seen from 0,0" in each.text]
    assert [(each.where, each.text.partition(" as")[0]) for each in confused] == [
        ("things.t1", "is 0° beside t3"),
        ("things.t1", "is 2° beside t2"),
        ("things.t2", "is 4° beside t3"),
    ]


def test_the_guides_example_is_in_order(tmp_path: Path) -> None:
    (tmp_path / "shelf.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n1 2 1\n1 2 2\n"
    )
    example = GUIDE.partition('```yaml title="site.yaml"\n')[2].partition("```")[0]
    assert found(tmp_path, example) == []
    data = yaml.safe_load(example)
    assert set(data) == set(MapFile.model_fields)


@pytest.mark.parametrize("section", [*ENTRIES, "bays"])
def test_the_guide_has_every_key(section: str) -> None:
    rows: dict[str, str] = {}
    last = ""
    for cells in (line.split("|") for line in GUIDE.splitlines() if line.startswith("| ")):
        last = cells[1].strip() or last
        rows[last] = rows.get(last, "") + cells[2]
    for key in field_names(ENTRIES[section]) if section in ENTRIES else ["name: belt"]:
        assert key in rows[f"`{section}`"]
