"""Edits of a map's text, in which all else stays, and new maps, of which none is half or replaces another."""

import difflib
import math
import re
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from pointit.maps.edit import Edit, edited, write_new
from pointit.maps.file import load_map, map_path, parse_map_file, shipped_maps, to_message
from pointit.runtime.errors import ConfigError, RefusedError
from tests.support.full_disk import file_size_limit

PATH = Path("room.yaml")
EDITS: TypeAdapter[list[Edit]] = TypeAdapter(list[Edit])
ROOM = """\
# my room
lamps:
  door: {position: [0, 1, 2]}   # by the door
strips:
  # the long one
  "shelf":   {line: [[1.0, 2.9, 1.2],  # left
                     [3.0, 2.9, 1.2]], pixels: 120}   # by the wall
  top:
    line:
      - [0, 0, 1]   # a
      - [1, 0, 1]   # b
    pixels: 60      # counted
    # direction: -1
things:
  nuts: {light: {strip: shelf, from: 0.1, to: 0.5}}
  radio: {light: door, mode: switch}
note: my own key   # kept
"""


def edit(text: str, *edits: dict[str, Any]) -> str:
    return edited(text.encode(), EDITS.validate_python(edits), PATH).decode()


def changed(text: str, result: str) -> list[str]:
    lines = difflib.ndiff(text.splitlines(), result.splitlines())
    return [line.replace("  ", " ", 1) if line[0] == " " else line for line in lines if line[0] in "-+"]


def put(section: str, name: str, key: str, value: Any) -> dict[str, Any]:
    return {"op": "set", "section": section, "name": name, "key": key, "value": value}


@pytest.mark.parametrize(
    ("one", "lines"),
    [
        (
            put("strips", "shelf", "line", [[1, 2.9, 1.25], [3.0, 2.9, 1.2]]),
            [
                '-   "shelf":   {line: [[1.0, 2.9, 1.2],  # left',
                '+   "shelf":   {line: [[1.0, 2.9, 1.25],  # left',
            ],
        ),
        (put("strips", "top", "direction", -1), ["+     direction: -1"]),
        (put("strips", "top", "pixels", None), ["-     pixels: 60      # counted"]),
        (
            put("strips", "top", "line", [[0, 0, 1], [1, 0, 1], [1, 1, 1]]),
            [
                "+     line: [[0, 0, 1], [1, 0, 1], [1, 1, 1]]   # b",
                "-     line:",
                "-       - [0, 0, 1]   # a",
                "-       - [1, 0, 1]   # b",
            ],
        ),
        (
            {"op": "rename", "section": "strips", "name": "shelf", "to": "7"},
            [
                '-   "shelf":   {line: [[1.0, 2.9, 1.2],  # left',
                "+   7:   {line: [[1.0, 2.9, 1.2],  # left",
                "-   nuts: {light: {strip: shelf, from: 0.1, to: 0.5}}",
                '+   nuts: {light: {strip: "7", from: 0.1, to: 0.5}}',
            ],
        ),
        (
            {"op": "rename", "section": "lamps", "name": "door", "to": "on"},
            [
                "-   door: {position: [0, 1, 2]}   # by the door",
                '+   "on": {position: [0, 1, 2]}   # by the door',
                "-   radio: {light: door, mode: switch}",
                '+   radio: {light: "on", mode: switch}',
            ],
        ),
        (
            {"op": "remove", "section": "things", "name": "nuts"},
            ["-   nuts: {light: {strip: shelf, from: 0.1, to: 0.5}}"],
        ),
        (
            {
                "op": "add",
                "section": "lamps",
                "name": "desk",
                "value": {"position": [1, 2.00000000001, 1e-9]},
            },
            ["+   desk: {position: [1, 2, 0]}"],
        ),
        (
            {"op": "add", "section": "boxes", "name": "b", "value": {"center": [0, 0, 1], "size": [1, 1, 1]}},
            ["+ boxes:", "+   b: {center: [0, 0, 1], size: [1, 1, 1]}"],
        ),
    ],
)
def test_only_the_lines_of_what_is_edited_change(one: dict[str, Any], lines: list[str]) -> None:
    for newline in ("\n", "\r\n"):
        text = ROOM.replace("\n", newline)
        result = edit(text, one)
        assert changed(text, result) == lines
        assert result.count("\n") == result.count(newline)


def test_swapped_entries_are_followed_by_references_to_them() -> None:
    swapped = edit(
        ROOM,
        {"op": "rename", "section": "strips", "name": "shelf", "to": "top"},
        {"op": "rename", "section": "strips", "name": "top", "to": "shelf"},
        put("strips", "top", "pixels", 61),
    )
    data = yaml.safe_load(swapped)
    assert {name: strip["pixels"] for name, strip in data["strips"].items()} == {"top": 120, "shelf": 61}
    assert data["things"]["nuts"]["light"]["strip"] == "top"


@pytest.mark.parametrize(
    ("text", "one", "sentence"),
    [
        (ROOM, put("strips", "gone", "pixels", 3), "strips.gone is not in the file; load the map again"),
        (ROOM, {"op": "rename", "section": "strips", "name": "top", "to": "shelf"}, "strips.shelf would be"),
        (
            ROOM,
            {"op": "add", "section": "lamps", "name": "door", "value": {}},
            "lamps.door would be there twice",
        ),
        (ROOM, put("strips", "top", "line", [[math.nan, 0, 1], [1, 0, 1]]), "nan is no number"),
        (
            "lamps: {a: {position: &p [0, 0, 1]}, b: {position: *p}}",
            put("lamps", "a", "position", [0, 0, 2]),
            "anchors",
        ),
    ],
)
def test_impossible_edits_are_refused_in_a_sentence(text: str, one: dict[str, Any], sentence: str) -> None:
    with pytest.raises(RefusedError, match=sentence):
        edit(text, one)


def test_edits_are_of_sections_with_names() -> None:
    with pytest.raises(ValidationError, match="section"):
        EDITS.validate_python([put("links", "0", "from", "a")])


@pytest.mark.parametrize("name", shipped_maps())
def test_strips_and_lamps_moved_in_shipped_maps_load_there(name: str) -> None:
    room = load_map(name, 0)
    with map_path(name) as file:
        text = file.read_text(encoding="utf-8")
    edits = [put("strips", s.id, "line", [[x + 0.5, y, z] for x, y, z in s.line_m]) for s in room.strips]
    edits += [put("lamps", lamp.id, "position", [0.25, *lamp.position_m[1:]]) for lamp in room.lamps]
    result = edit(text, *edits)
    after = to_message(file, parse_map_file(result.encode(), file), {}, 0)
    for old, new in zip(room.strips, after.strips, strict=True):
        assert new.line_m == tuple((round(x + 0.5, 6), y, z) for x, y, z in old.line_m)
    assert [lamp.position_m[0] for lamp in after.lamps] == [0.25] * len(room.lamps)
    same = {"strips": room.strips, "lamps": room.lamps, "things": room.things, "stamp_ns": 0, "seq": 0}
    assert after.model_copy(update=same) == room.model_copy(update=same)
    assert re.sub(r"[-\d. ]+", "", result) == re.sub(r"[-\d. ]+", "", text), "comments, names and order"


NAMES = st.sampled_from(["a", "b", "1", "2", "x.y", "on", "1.50", "left-2"])
NUMBERS = st.one_of(st.integers(-9, 9), st.floats(-9, 9).map(lambda value: round(value, 3)))
POINTS = st.lists(NUMBERS, min_size=3, max_size=3)
LABELS = st.text("aé: #'\"{}[],\\%é", max_size=6)


@st.composite
def written(draw: st.DrawFn) -> tuple[str, dict[str, dict[str, Any]]]:
    """Draw a map's text in any of many forms, with numbered comments, and its data."""
    data: dict[str, dict[str, Any]] = {}
    out: list[str] = []
    count = iter(range(1000))

    def remark() -> str:
        return f"   # c{next(count)}" if draw(st.booleans()) else ""

    for section in draw(st.lists(st.sampled_from(["lamps", "strips", "things"]), unique=True, max_size=3)):
        names = draw(st.lists(NAMES, unique=True, max_size=4))
        data[section] = {}
        out.append(f"{section}:{remark()}")
        indent = " " * draw(st.integers(1, 4))
        for name in names:
            line = draw(st.lists(POINTS, min_size=1, max_size=3))
            label = draw(LABELS)
            data[section][name] = {"line": line, "label": label}
            if draw(st.booleans()):
                out.append(f"{indent}# c{next(count)}")
            points = [str(point) for point in line]
            if draw(st.booleans()):
                gap = draw(st.sampled_from([", ", ",\n" + indent * 3, f",  # c{next(count)}\n" + indent * 3]))
                out.append(
                    f'{indent}"{name}": {{line: [{gap.join(points)}], label: {yaml_text(label)}}}{remark()}'
                )
            else:
                out += [f'{indent}"{name}":{remark()}', f"{indent}  line:{remark()}"]
                out += [f"{indent}  - {point}{remark()}" for point in points]
                out.append(f"{indent}  label: {yaml_text(label)}{remark()}")
    end = draw(st.sampled_from(["\n", "", "\n\n# the end\n"]))
    return "\n".join(out) + end, data


def yaml_text(value: str) -> str:
    text: str = cast("Any", yaml).safe_dump(value, default_style='"', width=1000, allow_unicode=True)
    return text.strip()


@given(written(), st.data())
def test_edits_give_the_values_and_keep_comments_and_order(
    document: tuple[str, dict[str, dict[str, Any]]], data: st.DataObject
) -> None:
    text, sections = document
    there = [(section, name) for section, entries in sections.items() for name in entries]
    touched = data.draw(st.lists(st.sampled_from(there), unique=True)) if there else []
    edits: list[dict[str, Any]] = []
    wanted = {section: dict(entries) for section, entries in sections.items()}
    removed: list[str] = []
    for section, name in touched:
        what = data.draw(st.sampled_from(["line", "label", "new", "unset", "remove"]))
        entry = dict(wanted[section][name])
        if what == "remove":
            edits.append({"op": "remove", "section": section, "name": name})
            del wanted[section][name]
            removed.append(name)
            continue
        key = {"new": "mark", "unset": "label"}.get(what, what)
        value = {
            "line": data.draw(st.lists(POINTS, min_size=len(entry["line"]), max_size=len(entry["line"]))),
            "label": data.draw(LABELS),
            "new": data.draw(LABELS),
            "unset": None,
        }[what]
        edits.append(put(section, name, key, value))
        entry.pop(key, None)
        wanted[section][name] = entry if value is None else {**entry, key: value}
    for section in data.draw(st.sets(st.sampled_from(["lamps", "strips", "boxes"]))):
        name = data.draw(NAMES)
        fresh = {"label": data.draw(LABELS)}
        if name not in sections.get(section, {}):
            edits.append({"op": "add", "section": section, "name": name, "value": fresh})
            wanted.setdefault(section, {})[name] = fresh
    result = edit(text, *edits)
    loaded: dict[str, dict[object, Any]] = yaml.safe_load(result) or {}
    named = {
        section: {str(name): entry for name, entry in entries.items()}
        for section, entries in loaded.items()
        if entries
    }

    assert named == {section: entries for section, entries in wanted.items() if entries}
    for section, entries in named.items():
        assert list(entries) == list(wanted[section])
    if not removed and not any(each.get("value", 1) is None for each in edits):
        assert re.findall(r"# c\d+", result) == re.findall(r"# c\d+", text)
    if not edits:
        assert result == text


def test_no_file_is_left_when_the_disk_is_full(tmp_path: Path) -> None:
    with file_size_limit(1000), pytest.raises(ConfigError, match=r"room\.yaml: cannot be written"):
        write_new(tmp_path / "room.yaml", b"#" * 100_000)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("has_links", [True, False])
def test_an_existing_file_stays_and_a_new_one_is_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, has_links: bool
) -> None:
    if not has_links:

        def refuse(*_: object) -> None:
            raise PermissionError(1, "Operation not permitted")  # as FAT does

        monkeypatch.setattr(Path, "hardlink_to", refuse)
    path = tmp_path / "room.yaml"
    write_new(path, "lamps: {}\n")
    with pytest.raises(ConfigError, match="exists already"):
        write_new(path, "lamps: {a: 1}\n")
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("room.yaml", "lamps: {}\n")]
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


@pytest.mark.parametrize("step", ["open", "hardlink_to", "unlink"])
def test_process_killed_while_writing_hinders_no_later_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """In a container, the next process has the same number."""

    class KilledError(BaseException):
        pass

    def die(*_arguments: object, **_options: object) -> None:
        raise KilledError

    path = tmp_path / "room.yaml"
    with monkeypatch.context() as patch:
        patch.setattr(Path, step, die)
        patch.setattr(Path, "unlink", die)  # the dead clean up nothing
        with pytest.raises(KilledError):
            write_new(path, "lamps: {}\n")
    if not path.exists():
        write_new(path, "lamps: {}\n")
    assert path.read_text() == "lamps: {}\n"
