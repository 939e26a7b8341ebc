"""The shelf: a simulated person points at its boxes, and they fire; in virtual time."""

from itertools import pairwise

import pointit
from pointit.schemas import SelectionEvent


def test_boxes_fire_one_at_a_time_and_functions_hear_of_each() -> None:
    heard: list[str] = []

    async def hear(event: SelectionEvent) -> None:
        heard.append(event.thing)

    with pointit.run("shelf", seed=2, virtual=True) as site:
        site.on_pointed("screws", "nuts", "bolts", "washers")(hear)
        fired = list(site.pointed().during(40.0))
        site.sleep(1.0)
    assert len(fired) >= 4
    assert all(event.is_on and event.user == "user1" and event.cause == "dwell" for event in fired)
    assert all(event.confidence is not None and event.confidence >= 0.7 for event in fired)
    assert heard[: len(fired)] == [event.thing for event in fired]
    assert all(after.stamp_ns - before.stamp_ns > 1e9 for before, after in pairwise(fired))
    assert all(after.thing != before.thing for before, after in pairwise(fired))
