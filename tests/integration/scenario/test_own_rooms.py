"""Boxes of a shelf, and rooms of one's own."""

import math
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pointit
from pointit.launch.plan.plan import read_scenario
from pointit.schemas import SelectionEvent

KEPT_SHARE = 0.7
"""Minimum activations per minute after the first minute, as a share of those in it: about 1 in most rooms.

The lowest is 0.72, of room 24: one thing of four has a light, by which people see that the yaw has drifted.
"""
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
ROOMS = range(20, 30)


def random_room(seed: int, *, with_lights: bool) -> str:
    """Return a map of three to seven things around the origin, each with a light of its own or none."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 8))
    azimuths = rng.permutation(24)[: 2 * count : 2] * math.radians(15.0)
    lamps, strips, things = [""] * count, [""] * count, [""] * count
    for index, azimuth in enumerate(azimuths):
        reach_m, height_m, size_m = rng.uniform((1.5, 0.7, 0.2), (3.2, 1.8, 0.5))
        x, y = reach_m * math.cos(azimuth), reach_m * math.sin(azimuth)
        kind = rng.choice(["strip", "lamp", "none"]) if with_lights else "none"
        light = ""
        if kind == "strip":
            up_m = height_m + rng.uniform(0.1, 0.6)
            ends = [f"[{x + side_m:.2f}, {y:.2f}, {up_m:.2f}]" for side_m in (-0.3, 0.3)]
            strips[index] = f"  s{index}: {{line: [{', '.join(ends)}], pixels: 36}}"
            light = f", light: {{strip: s{index}, from: 0.1, to: 0.5}}"
        elif kind == "lamp":
            lamps[index] = f"  l{index}: {{position: [{x:.2f}, {y:.2f}, {height_m + 0.3:.2f}]}}"
            light = f", light: l{index}"
        mode = "button" if index < 2 else rng.choice(["button", "switch"])
        press = ", press: true" if rng.random() < 0.2 else ""
        things[index] = (
            f"  t{index}: {{center: [{x:.2f}, {y:.2f}, {height_m:.2f}], mode: {mode}{press}{light}, "
            f"size: [{size_m:.2f}, {size_m:.2f}, {size_m:.2f}]}}"
        )
    sections = {"strips": strips, "lamps": lamps, "things": things}
    filled = {name: "\n".join(filter(None, rows)) for name, rows in sections.items()}
    return "\n".join(f"{name}:\n{rows}" for name, rows in filled.items() if rows)


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
def test_things_below_the_strip_that_lights_them_are_hit_as_often_later(tmp_path: Path) -> None:
    assert_kept(activations(KITCHEN, tmp_path, minutes=3))


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("with_lights", [True, False])
@pytest.mark.parametrize("seed", ROOMS)
def test_random_rooms_are_hit_as_often_after_ten_minutes(
    seed: int, *, with_lights: bool, tmp_path: Path
) -> None:
    assert_kept(activations(random_room(seed, with_lights=with_lights), tmp_path, minutes=10, seed=seed))


MAP = """
lamps:
  radio_lamp: {position: [2.2, -1.0, 1.1]}
things:
  radio: {light: radio_lamp, mode: switch}
  kettle: {center: [2.4, 0.8, 1.1], size: [0.6, 0.6, 0.6], press: true}
"""


@pytest.mark.slow
def test_boxes_fire_one_at_a_time_again_and_again_and_functions_hear_of_each() -> None:
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


def test_a_map_with_things_runs_without_end_and_what_wants_a_press_is_confirmed(tmp_path: Path) -> None:
    room = tmp_path / "kitchen.yaml"
    room.write_text(MAP, encoding="utf-8")
    assert read_scenario(str(room)).duration_s is None
    with pointit.run(room, virtual=True) as site:
        fired = list(site.pointed().during(60.0))
    assert {(event.thing, event.cause) for event in fired} == {("radio", "dwell"), ("kettle", "button")}
