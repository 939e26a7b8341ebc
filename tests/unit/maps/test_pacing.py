"""Accuracy of paced maps, as the check reports it."""

from pathlib import Path

import pytest

from pointit.bridges.web.model.separability import floor
from pointit.maps.checks.check import check_map, contents
from pointit.maps.checks.pacing import direction_sigma_deg
from pointit.maps.file import parse_map_file, to_message

PATH = Path("home.yaml")
THINGS = """
things:
  desk: {home_assistant: light.desk, center: [3, 0.5, 1], size: [0.3, 0.3, 0.3]}
  hall: {home_assistant: light.hall, center: [2, -1.5, 1.8], size: [0.3, 0.3, 0.3]}
"""
PLACES = """
paced_from:
  A: {position: [0, 0]}
  B: {position: [0.2, 2.1]}
"""


def sentences(text: str, *people_m: tuple[float, float]) -> list[str]:
    file = parse_map_file(text.encode(), PATH)
    return [each.text for each in check_map(file, {}, poses_m=people_m) if each.where == "paced_from"]


def test_map_with_measured_lengths_has_no_such_finding() -> None:
    assert sentences(THINGS, (-2.0, 0.0)) == []


def test_check_names_the_places_and_how_far_the_map_reaches() -> None:
    summary = contents(parse_map_file((THINGS + PLACES).encode(), PATH), {})
    assert (
        "paced from A (0, 0) and B (0.2, 2.1): directions are good from there, from between them" in summary
    )
    assert "up to 0.8 m around" in summary


def test_check_names_things_unknown_from_the_standpoint() -> None:
    assert "directions to desk, hall are not known from 2.5,1" in sentences(THINGS + PLACES, (2.5, 1.0))[-1]
    assert len(sentences(THINGS + PLACES, (0.1, 1.0))) == 0


def test_directions_have_press_accuracy_at_and_between_the_places() -> None:
    places_m = [(0.0, 0.0), (0.2, 2.1)]
    for eyes_m in (*places_m, (0.1, 1.05)):
        assert direction_sigma_deg(places_m, (3.0, 0.5, 1.0), eyes_m) == pytest.approx(2.5, abs=0.01)
    assert direction_sigma_deg(places_m, (3.0, 0.5, 1.0), (3.0, 2.5)) > 8.0


def test_one_place_covers_less_of_the_floor_than_two() -> None:
    one = [(0.0, 0.0)]
    two = [(0.0, 0.0), (0.0, 2.0)]
    assert direction_sigma_deg(one, (3.0, 0.0, 1.0), (0.0, 1.0)) > direction_sigma_deg(
        two, (3.0, 0.0, 1.0), (0.0, 1.0)
    )


def test_told_apart_excludes_what_a_paced_map_does_not_know() -> None:
    file = parse_map_file((THINGS + PLACES).encode(), PATH)
    squares = floor(to_message(PATH, file, {}, 1))

    uncovered = [bool(square) for row in squares["uncovered"] for square in row]
    told_apart = [count for row in squares["told_apart"] for count in row]
    assert any(uncovered)
    assert not all(uncovered)
    for is_uncovered, count in zip(uncovered, told_apart, strict=True):
        assert count < 2 or not is_uncovered


def test_map_of_places_alone_is_a_map() -> None:
    file = parse_map_file(PLACES.encode(), PATH)
    room = to_message(PATH, file, {}, 1)
    assert [place.id for place in room.paced_from] == ["A", "B"]
    assert sentences(PLACES) == []
