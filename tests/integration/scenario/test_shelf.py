"""The shelf: a simulated person points at its boxes, and they fire; in virtual time."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pointit
from pointit.launch.plan.plan import read_scenario
from pointit.schemas import SelectionEvent

MAP = """
lamps:
  radio_lamp: {position: [2.2, -1.0, 1.1]}
things:
  radio: {light: radio_lamp, mode: switch}
  kettle: {center: [2.4, 0.8, 1.1], size: [0.6, 0.6, 0.6], press: true}
"""


def test_boxes_fire_one_at_a_time_and_functions_hear_of_each() -> None:
    heard: list[str] = []

    async def hear(event: SelectionEvent) -> None:
        heard.append(event.thing)

    with pointit.run("shelf", seed=2, virtual=True) as site:
        site.on_pointed("screws", "nuts", "bolts", "washers", "radio")(hear)
        fired = list(site.pointed().during(40.0))
        site.sleep(1.0)
    assert len(fired) >= 4
    assert all(event.is_on or event.thing == "radio" for event in fired), "only the switch goes off"
    assert {(event.user, event.cause) for event in fired} == {("user1", "dwell")}
    assert all(event.confidence is not None and event.confidence >= 0.7 for event in fired)
    assert heard[: len(fired)] == [event.thing for event in fired]
    assert all(after.stamp_ns - before.stamp_ns > 1e9 for before, after in pairwise(fired))
    assert all(after.thing != before.thing for before, after in pairwise(fired))


def test_each_box_fires_again_and_again() -> None:
    with pointit.run("shelf", virtual=True) as site:
        fired = Counter(event.thing for event in site.pointed().during(120.0))
    assert set(fired) == {"screws", "nuts", "bolts", "washers"}
    assert min(fired.values()) >= 2


def test_a_map_with_things_runs_without_end_and_what_wants_a_press_is_confirmed(tmp_path: Path) -> None:
    room = tmp_path / "kitchen.yaml"
    room.write_text(MAP, encoding="utf-8")
    assert read_scenario(str(room)).duration_s is None
    with pointit.run(room, virtual=True) as site:
        fired = list(site.pointed().during(60.0))
    assert {(event.thing, event.cause) for event in fired} == {("radio", "dwell"), ("kettle", "button")}
