"""Findings of `pointit map check` about fences."""

from pathlib import Path

import pytest

from pointit.maps.checks.check import check_fences
from pointit.maps.file import read_map_file

FINDINGS: dict[str, tuple[str, list[tuple[str, str, str]]]] = {
    "a fence without room": (
        "fences: {a: {kind: keep_in, outline: [[0, 0], [0.4, 0], [0.4, 2]], high: 0}}",
        [
            ("error", "fences.a", "ends at 0 m, not above the floor"),
            ("warning", "fences.a", "is 0.4 m wide, and robots stay inside"),
        ],
    ),
    "fences that leave no place together": (
        (
            "fences: {a: {kind: keep_in, outline: [[0, 0], [2, 0], [2, 2], [0, 2]]},\n"
            "  b: {kind: keep_in, outline: [[1, 0], [3, 0], [3, 2], [1, 2]], low: 0, high: 3},\n"
            "  c: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], high: 1},\n"
            "  d: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], low: 1}}"
        ),
        [("error", "fences.a, b", "leave no place for a robot: it stays inside every keep_in")],
    ),
    "fences side by side": (
        (
            "fences: {a: {kind: keep_in, outline: [[0, 0], [2, 0], [2, 2], [0, 2]]},\n"
            "  b: {kind: keep_in, outline: [[3, 0], [5, 0], [5, 2], [3, 2]]}}"
        ),
        [("error", "fences.a, b", "leave no place")],
    ),
    "fences that leave a gap": (
        (
            "fences: {a: {kind: keep_in, outline: [[0, 0], [2, 0], [2, 2], [0, 2]], low: 0},\n"
            "  c: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], high: 1},\n"
            "  d: {kind: keep_out, outline: [[0, -1], [4, -1], [4, 4], [0, 4]], low: 1.1}}"
        ),
        [],
    ),
}


@pytest.mark.parametrize("case", FINDINGS)
def test_fences_without_a_place_for_robots_are_found(tmp_path: Path, case: str) -> None:
    text, expected = FINDINGS[case]
    path = tmp_path / "site.yaml"
    path.write_text(text, encoding="utf-8")
    findings = list(check_fences(read_map_file(path).fences))
    assert sorted((each.severity, each.where) for each in findings) == [each[:2] for each in expected]
    for finding, (_, _, part) in zip(sorted(findings, key=lambda each: each.severity), expected, strict=True):
        assert part in finding.text
        assert ";" in finding.text, "what to do is said"
