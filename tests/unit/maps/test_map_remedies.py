"""Remedies that the check of a map prints work when they are applied as they are printed."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from pointit.maps.checks.check import examined
from pointit.maps.file import read_map_file

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
