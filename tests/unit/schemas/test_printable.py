"""Names of twenty scripts and emoji are text everywhere; what hides or reorders text is not."""
# ruff: noqa: RUF001 - letters of many scripts

import ast
import json
from pathlib import Path

import pytest

from pointit.assistants.results import plain as plain_for_assistants
from pointit.maps.edit import Add, edited
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.schemas.printable import is_printable, plain
from pointit.schemas.text import one_line
from tests.architecture.sources import shipped, shown, tree

NAMES = {
    "Arabic": "مصباح المكتب",
    "Persian": "چراغ\u200cخواب",
    "Urdu": "باورچی خانہ",
    "Hebrew": "מנורה",
    "Hebrew with a mark": "מנורה A\u200f",
    "Hindi": "क्\u200dष",
    "Bengali": "র\u200d্যাক",
    "Malayalam": "വെളിച്ചം ന\u0d4d\u200d വിളക്ക്",
    "Tamil": "சமையலறை விளக்கு",
    "Sinhala": "ක්\u200dෂේත්\u200dරය",
    "Thai": "โคมไฟห้องนอน",
    "Lao": "ໂຄມໄຟ",
    "Khmer": "ចង្កៀង",
    "Burmese": "မီးအိမ်",
    "Tibetan": "སྒྲོན་མེ",
    "Mongolian": "ᠭᠡᠷ\u180eᠡ",
    "Chinese": "书房台灯",
    "Japanese": "居間　ランプ",
    "Korean": "거실 조명",
    "Greek": "Λάμπα κουζίνας",
    "Russian": "Лампа на кухне",
    "Georgian": "სანათი",
    "Armenian": "Լամպ",
    "Amharic": "መብራት",
    "Vietnamese": "Đèn phòng ngủ",
    "Yoruba, decomposed": "Fìtílà ile\u0300",
    "emoji": "👩\u200d🍳 oven 💡",
    "flag": "🏳\ufe0f\u200d🌈 lamp",
    "newest emoji": "\U0001fae9 lamp",
    "Arabic number sign": "\u0600١٢",
}
HIDING = {
    "override": "Desk\u202egnp.exe",
    "isolate": "a\u2066b",
    "joiner in Latin": "la\u200dmp",
    "joiner at the end": "क\u200d",
    "two joiners": "چ\u200c\u200cخ",
    "mark in Latin": "lamp\u200f",
    "zero-width space": "la\u200bmp",
    "soft hyphen": "la\u00admp",
    "control": "lamp\x1b[2J",
    "private use": "lamp \ue000",
    "byte-order mark": "\ufefflamp",
    "line separator": "a\u2028b",
}
SPACED = {"Japanese": "居間 ランプ"}
"""Names in which another kind of space becomes a space where they are shown."""


@pytest.mark.parametrize("script", NAMES)
def test_name_of_each_script_is_text_where_it_is_shown(script: str) -> None:
    name = NAMES[script]
    shown = SPACED.get(script, name)
    assert is_printable(name)
    assert plain(name) == shown
    assert one_line(name) == shown
    assert plain_for_assistants(name) == shown


@pytest.mark.parametrize("kind", HIDING)
def test_character_that_hides_or_reorders_text_is_replaced(kind: str) -> None:
    text = HIDING[kind]
    assert not is_printable(text)
    assert "?" in plain(text)
    assert is_printable(plain(text))


@pytest.mark.parametrize("script", NAMES)
def test_label_of_each_script_is_read_from_a_map_and_written_back(script: str, tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    start = "things:\n  oven: {center: [0, 3, 1], size: [.2, .2, .2]}\n"
    value = {"center": [1, 3, 1], "size": [0.2, 0.2, 0.2], "label": NAMES[script]}
    content = edited(start.encode(), [Add(section="things", name="lamp", value=value)], path)
    path.write_bytes(content)
    labels = {thing.id: thing.label for thing in load_map(str(path), 0).things}
    assert labels["lamp"] == NAMES[script]


@pytest.mark.parametrize("kind", HIDING)
def test_label_that_hides_text_is_refused_by_a_map(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    label = json.dumps(HIDING[kind])
    path.write_text(f"things:\n  lamp: {{center: [0, 3, 1], size: [.2, .2, .2], label: {label}}}\n", "utf-8")
    with pytest.raises(ConfigError, match="label"):
        load_map(str(path), 0)


def test_no_other_code_tests_a_script_by_isprintable() -> None:
    places = {
        shown(path)
        for path in shipped()
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Attribute) and node.attr == "isprintable"
    }
    assert places == {"schemas/printable.py"}, "use `is_printable`: Python's own refuses Persian and emoji"
