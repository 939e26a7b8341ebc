"""Boxes of a shelf, and rooms of one's own."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

import pointit
from pointit.launch.plan.plan import read_scenario
from pointit.schemas import SelectionEvent

KEPT_SHARE = 0.7
"""Minimum activations per minute after the first minute, as a share of those in it: about 1 in most rooms."""
RATES = {"user-sim.rate_hz": 25.0, "led-driver.max_rate_hz": 25.0}
KITCHEN = """
strips:
  board: {line: [[2.2, 1.3, 1.55], [2.2, -1.3, 1.55]], pixels: 120}
lamps:
  floor_lamp: {position: [0.4, 2.4, 1.1]}
things:
  oven: {center: [2.5, -2.0, 0.8], size: [0.6, 0.6, 1.6]}
  jar: {center: [2.2, .6, 1.05], size: [.2, .2, .3], press: true, light: {strip: board, from: 0.3, to: 0.9}}
  scale: {center: [2.2, -0.5, 1.1], size: [0.3, 0.2, 0.2], light: {strip: board, from: 1.5, to: 1.9}}
  lamp: {light: floor_lamp, mode: switch}
"""
"""The strip is 12° above the jar and the scale that it lights, beyond their middles sideways."""


def activations(room: str, folder: Path, minutes: int, seed: int = 1) -> list[int]:
    """Return the number of activations in each minute."""
    path = folder / "room.yaml"
    path.write_text(room, encoding="utf-8")
    counts = [0] * minutes
    with pointit.run(path, seed=seed, virtual=True, settings=RATES) as site:
        began_ns = site.now_ns()
        for event in site.pointed().during(60.0 * minutes):
            counts[min(int((event.stamp_ns - began_ns) / 60e9), minutes - 1)] += 1
    return counts


def assert_kept(counts: list[int]) -> None:
    """Check that things are hit as often later as in the first minute."""
    first, *later = counts
    assert first >= 8, counts
    assert sum(later) / len(later) >= KEPT_SHARE * first, counts


@pytest.mark.slow
def test_things_below_their_strip_are_hit_as_often_later(tmp_path: Path) -> None:
    assert_kept(activations(KITCHEN, tmp_path, minutes=3))


MAP = """
lamps:
  radio_lamp: {position: [2.2, -1.0, 1.1]}
things:
  radio: {light: radio_lamp, mode: switch}
  kettle: {center: [2.4, 0.8, 1.1], size: [0.6, 0.6, 0.6], press: true}
"""


@pytest.mark.slow
def test_boxes_fire_one_by_one_and_functions_get_each_event() -> None:
    heard: list[str] = []

    async def hear(event: SelectionEvent) -> None:
        heard.append(event.thing)

    with pointit.run("shelf", virtual=True) as site:
        site.on_pointed("screws", "nuts", "bolts", "washers", "radio")(hear)
        fired = list(site.pointed().during(120.0))
        site.sleep(1.0)
    counts = Counter(event.thing for event in fired)
    assert set(counts) == {"screws", "nuts", "bolts", "washers"}
    assert min(counts.values()) >= 2
    assert all(event.is_on for event in fired)
    assert {(event.user, event.cause) for event in fired} == {("user1", "dwell")}
    assert all(event.confidence is not None and event.confidence >= 0.7 for event in fired)
    assert heard[: len(fired)] == [event.thing for event in fired]
    assert all(after.stamp_ns - before.stamp_ns > 1e9 for before, after in pairwise(fired))
    assert all(after.thing != before.thing for before, after in pairwise(fired))


@pytest.mark.slow
def test_map_of_things_runs_endlessly_firing_by_dwell_or_press(tmp_path: Path) -> None:
    room = tmp_path / "kitchen.yaml"
    room.write_text(MAP, encoding="utf-8")
    assert read_scenario(str(room)).duration_s is None
    with pointit.run(room, virtual=True) as site:
        fired = list(site.pointed().during(60.0))
    assert {(event.thing, event.cause) for event in fired} == {("radio", "dwell"), ("kettle", "button")}
