"""Names in maps, and remedies for them."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pointit.maps import exchange
from pointit.maps.checks.check import examined
from pointit.maps.file import load_map, parse_map_file, read_map_file
from pointit.replay.replayed_services import write_room
from pointit.runtime.config.yaml_edit import dump_yaml
from pointit.runtime.errors import ConfigError
from tests.unit.maps.test_map_edit import edit

LINE = "[[0, 0, 1], [2, 0, 1]]"
WORDS = (
    "00",
    "02",
    "012",
    "1_2",
    "3e2",
    "1.20",
    "on",
    "OFF",
    "no",
    "y",
    "null",
    "true",
    "False",
    "0x2F",
    "0o7",
)
NAMES = st.sampled_from((*WORDS, "2026-11-26", "2024-99-99", "08", "8", "8.0")) | st.from_regex(
    r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,5}", fullmatch=True
)
ROOM = f"""\
lamps:
  no: {{position: [0, 0, 1]}}  # the first
  1_2: {{position: [1, 0, 1]}}
strips: {{02: {{line: {LINE}, pixels: 60}}, 2: {{line: {LINE}, pixels: 50}}}}
belts: {{1.20: {{centerline: {LINE}, width: 1}}, 3e2: {{centerline: {LINE}, width: 1}}}}
links: [{{from: 1.20, to: 3e2}}]
bays: {{01: 3e2, 1: 1.20}}
things:
  on: {{light: no, mode: switch, label: 1.0}}
  off: {{light: 1_2, press: on}}
  0x2F: {{light: {{strip: 02, from: 0.1, to: 1}}}}
  12e3: {{at: {{belt: 3e2, from: 0.1, to: 1}}}}
"""


def room_of(text: str, folder: Path) -> Any:
    path = folder / "room.yaml"
    path.write_text(text, encoding="utf-8")
    return load_map(str(path), 1)


def test_names_and_references_are_the_text_of_the_file(tmp_path: Path) -> None:
    room = room_of(ROOM, tmp_path)
    assert [lamp.id for lamp in room.lamps] == ["no", "1_2"]
    assert {strip.id: strip.pixels for strip in room.strips} == {"02": 60, "2": 50}
    assert [(link.source, link.target) for link in room.links] == [("1.20", "3e2")]
    assert {bay.id: bay.belt for bay in room.bays} == {"01": "3e2", "1": "1.20"}
    things = {thing.id: thing for thing in room.things}
    assert list(things) == ["on", "off", "0x2F", "12e3"]
    assert (things["on"].lamp, things["on"].label) == ("no", "1.0")
    assert (things["off"].lamp, things["off"].press) == ("1_2", True)
    assert things["0x2F"].strip == "02"


@pytest.mark.parametrize(("word", "value"), [("True", True), ("y", True), ("FALSE", False), ("No", False)])
def test_a_flag_is_any_word_of_yaml_1_1(word: str, value: object) -> None:
    text = f"things: {{a: {{center: [0, 0, 1], size: [1, 1, 1], press: {word}}}}}"
    assert parse_map_file(text.encode(), Path("room.yaml")).things["a"].press is value


@pytest.mark.parametrize(
    ("word", "pixels"), [("060", 60), ("0x3C", 60), ("6_0", 60), ("+60", 60), ("0o74", 60)]
)
def test_numbers_are_those_of_yaml_1_2(word: str, pixels: int) -> None:
    text = f"strips: {{a: {{line: {LINE}, pixels: {word}, offset: {word}}}}}\n"
    text += f"clouds: {{a: {{file: a.xyz, columns: {{x: {word}, y: 5, z: z}}}}}}\n"
    file = parse_map_file(text.encode(), Path("room.yaml"))
    assert (file.strips["a"].pixels, file.strips["a"].offset) == (pixels, pixels)
    assert file.clouds["a"].columns == {"x": pixels, "y": 5, "z": "z"}


@pytest.mark.parametrize(
    ("name", "valid"),
    [
        *(("12:30", "12_30"), ("~", "a1"), ("=", "a1"), ("<<", "a1"), (".inf", "inf"), ("-1", "1")),
        *(("Büro links", "Buro_links"), ("a/b", "a_b")),
    ],
)
def test_invalid_key_name_is_refused_with_a_valid_one(name: str, valid: str) -> None:
    for section, entry, more in (
        ("lamps", "{position: [0, 0, 1]}", ""),
        ("things", "{center: [0, 0, 1], size: [1, 1, 1]}", f", and give it the label {name!r}"),
    ):
        with pytest.raises(ConfigError, match="use 1 to 64 letters") as caught:
            parse_map_file(f"{section}:\n  {name}: {entry}\n".encode(), Path("room.yaml"))
        assert str(caught.value).startswith(f"room.yaml: {section}: name {name!r}: ")
        assert str(caught.value).endswith(f", such as {valid}{more}")
        file = parse_map_file(f"{section}:\n  {valid}: {entry}\n".encode(), Path("room.yaml"))
        assert [*getattr(file, section)] == [valid]


@given(st.lists(NAMES, min_size=2, max_size=6, unique=True), st.data())
def test_an_edited_map_has_the_same_names_for_every_reader(names: list[str], data: st.DataObject) -> None:
    ruamel = pytest.importorskip("ruamel.yaml")
    first, *others = names
    lamps = {name: {"position": [0.0, 0.0, 1.0]} for name in others}
    text = dump_yaml({"lamps": lamps, "things": {name: {"light": name, "label": name} for name in others}})
    old = data.draw(st.sampled_from(others))
    result = edit(text, {"op": "rename", "section": "lamps", "name": old, "to": first})
    wanted = {name: first if name == old else name for name in others}
    for tree in (yaml.safe_load(result), ruamel.YAML(typ="safe", pure=True).load(result)):
        assert [str(name) for name in tree["lamps"]] == list(wanted.values())  # 7 may be plain
        assert {name: each["light"] for name, each in tree["things"].items()} == wanted
    file = parse_map_file(result.encode(), Path("room.yaml"))
    assert {name: each.light for name, each in file.things.items()} == wanted


@given(st.lists(NAMES, min_size=1, max_size=6, unique=True))
def test_an_exported_map_is_imported_with_its_names(names: list[str]) -> None:
    strips = {name: {"line": [[0, 0, row], [1, 0, row]], "pixels": 5} for row, name in enumerate(names)}
    file = parse_map_file(dump_yaml({"strips": strips}).encode(), Path("room.yaml"))
    again = exchange.strips_text(exchange.from_csv(exchange.to_csv(file)))
    assert list(parse_map_file(again.encode(), Path("room.yaml")).strips) == names


def test_a_recorded_map_is_written_with_its_names(tmp_path: Path) -> None:
    room = room_of(ROOM, tmp_path)
    (tmp_path / "again").mkdir()
    path = write_room(room, tmp_path / "again")
    assert path is not None
    again = load_map(str(path), 1)
    assert again.things == room.things
    assert again.bays == room.bays


def test_json_with_a_name_twice_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"^the key 'seg' occurs twice; keep one"):
        exchange.from_segments('{"seg": [{"start": 0, "stop": 9}], "seg": []}')


BELTS = "belts:\n  a: {width: 0.5, centerline: [[0, 0, 1], [6, 0, 1]]}\n"
GRID = "x,y,z\n386120.5,5820345.5,34.5\n386124,5820349,36\n"

REMEDIES: dict[str, tuple[str, str, Callable[[str, str], str]]] = {
    "a link": (
        BELTS + "  b: {width: 0.5, centerline: [[3.7, 0.3, 1], [3.7, 2, 1]]}\nlinks:\n",
        r"add to links: (- \{.*\})", lambda text, remedy: f"{text}  {remedy}\n"),
    "a position on a belt": (
        BELTS + "  b: {width: 0.5, centerline: [[6, 0, 1], [8, 0, 1]]}\n"
        "links: [{from: a, from_position: 7, to: b}]\n",
        r"is off belt a; write 0 to (\S+)", lambda text, remedy: text.replace("7,", f"{remedy},")),
    "a belt": (
        BELTS + "bays: {1: c}\n", "use one of (.*)",
        lambda text, remedy: text.replace("1: c", f"1: {remedy}")),
    "a name": ("spheres: {12:30: {center: [0, 0, 1], radius: 1}}\n", "such as (.*)",
        lambda text, remedy: text.replace("12:30", remedy)),
    "a part of a strip": (
        "strips: {s: {line: [[0, 0, 1], [2, 0, 1]], pixels: 60}}\nthings: {t: {light: s}}\n",
        r"is a strip; write (\{.*\})",
        lambda text, remedy: text.replace(
            "light: s", "light: " + remedy.replace("from: METRES", "from: 0.5").replace("METRES", "1.5"))),
    "a number of pixels": (
        "strips:\n" + "".join(
            f"  {name}: {{line: [[0, {row}, 1], [1, {row}, 1]], pixels: {pixels}}}\n"
            for row, (name, pixels) in enumerate({"s": 30, "t": 30, "u": 37}.items())),
        r"correct pixels \(to about (\d+)\)", lambda text, remedy: text.replace("37", remedy)),
    "a kind": (
        "fences: {f: {kind: keepin, outline: [[0, 0], [2, 0], [2, 2]]}}\n", r"write (\w+)",
        lambda text, remedy: text.replace("keepin", remedy)),
    "an origin": (
        "clouds: {c: {file: scan.csv}}\n", r"such as (origin: \[.*\])",
        lambda text, remedy: text.replace("scan.csv", f"scan.csv, {remedy}")),
    "columns and a unit": (
        "clouds: {c: {file: mm.csv}}\n", r"such as (.*)$",
        lambda text, remedy: text.replace(
            "mm.csv", f"mm.csv, {'' if 'unit' in remedy else 'columns: '}{remedy}")),
    "an axis": (
        "clouds: {c: {file: phone.csv}}\n", r"such as (up: y)",
        lambda text, remedy: text.replace("phone.csv", f"phone.csv, {remedy}")),
}  # fmt: skip
"""A map, a pattern of the remedy, and how it is applied."""
CLOUDS = {
    "scan.csv": GRID,
    "mm.csv": "0,0,0\n4000,3000,2500\n",
    "phone.csv": "x,y,z\n0,0,-5\n4,2.5,-4\n4,2.5,0\n",
}


@pytest.mark.parametrize("name", REMEDIES)
def test_a_remedy_that_is_printed_works(tmp_path: Path, name: str) -> None:
    for file, content in CLOUDS.items():
        (tmp_path / file).write_text(content)
    text, pattern, apply = REMEDIES[name]
    path = tmp_path / "room.yaml"

    def remedies() -> list[str]:
        path.write_text(text)
        found = examined(str(path), path, lambda: read_map_file(path))[1]
        return [match[1] for each in found if (match := re.search(pattern, each.text))]

    applied: list[str] = []
    while left := remedies():
        assert left[0] not in applied
        applied.append(left[0])
        text = apply(text, left[0])
    assert applied
    findings = examined(str(path), path, lambda: read_map_file(path))[1]
    assert [each.text for each in findings if each.severity == "error"] == []
