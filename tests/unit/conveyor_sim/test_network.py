"""Belts that are linked: examples of who waits for whom at junctions, rings and belts that stand."""

from itertools import pairwise

import pytest

from pointit.schemas import TrackedObject
from pointit.services.conveyor_sim.feeding import NoRoomError
from pointit.services.conveyor_sim.plant import Plant
from tests.unit.conveyor_sim.rooms import CHAIN, CROSS, FORK, MERGE, S, check_apart, plant
from tests.unit.conveyor_sim.test_network_properties import SHIPPED


def every(belt: str, interval_s: float, *, kind: str = "red") -> dict[str, object]:
    """Return a feeder that does not leave anything to chance."""
    return {
        "belt": belt,
        "sequence": [kind],
        "min_interval_s": interval_s,
        "max_interval_s": interval_s,
        "length_m": 0.3,
    }


def run(belts: Plant, until_s: float, *, step_s: float = 0.04) -> list[tuple[TrackedObject, ...]]:
    seen: list[tuple[TrackedObject, ...]] = []
    while belts.now_ns < until_s * S:
        belts.step(belts.now_ns + round(step_s * S))
        seen.append(belts.tracked(belts.now_ns).objects)
    return seen


def test_package_loses_no_time_where_it_passes_from_belt_to_belt() -> None:
    belts = plant(CHAIN, feeder={"sequence": ["red"], "count": 1})
    straight = [
        x for objects in run(belts, 10.0, step_s=0.03) if objects and (x := objects[0].position_m[0]) < 5.2
    ]
    assert straight[-1] > 4.5
    for before, after in pairwise(straight):
        assert after - before == pytest.approx(0.5 * 0.03)


def test_packages_behind_a_belt_that_stands_queue_up_and_go_on_with_it() -> None:
    belts = plant(CHAIN, feeder={"sequence": ["red"], "interval_s": 1.5, "length_m": 0.3})
    run(belts, 12.0, step_s=0.2)
    belts.set_speed(0.0, ("c",))
    run(belts, 60.0, step_s=0.2)
    waiting = [t for t in belts.tracked(0).objects if t.surface_id in {"a", "b"}]
    assert len(waiting) >= 13
    assert {tracked.surface_speed_mps for tracked in waiting} == {0.0}
    fed = belts.fed
    run(belts, 70.0, step_s=0.2)
    assert belts.fed == fed, "a feeder waits for room"
    belts.set_speed(0.5)
    run(belts, 75.0, step_s=0.2)
    assert all(t.surface_speed_mps == 0.5 for t in belts.tracked(0).objects if t.surface_id == "c")
    assert belts.fed > fed


@pytest.mark.parametrize(("after_s", "held"), [(1.6, "left"), (2.4, "main")])
def test_first_package_at_a_junction_passes_first(after_s: float, held: str) -> None:
    belts = plant(MERGE, feeder={"sequence": []})
    names = {belts.add("x", "left", 0.4): "left"}  # 2.6 m before the junction
    run(belts, after_s)
    names[belts.add("x", "main", 0.4)] = "main"  # 1.6 m before it: 2 s less
    assert {names[t.id] for objects in run(belts, 9.0) for t in objects if not t.surface_speed_mps} == {held}
    assert belts.size == 2


def test_a_stream_that_never_ends_lets_one_from_the_side_in_when_it_is_its_turn() -> None:
    belts = plant(MERGE, feeders={"main": every("main", 0.1)})
    run(belts, 15.0)
    name = belts.add("late", "left", 0.3)
    run(belts, 25.0)
    assert next(t.surface_id for t in belts.tracked(0).objects if t.id == name) == "main"


def test_a_ring_is_never_filled_so_it_never_comes_to_a_standstill() -> None:
    """All from one side want to go on where all from the other side stand."""
    feeders = {"e": every("part_e", 0.4, kind="blue"), "h": every("part_h", 0.4, kind="red")}
    belts = plant(SHIPPED, feeders=feeders, bay_selected="1", bay_rest="4", speed_mps=1.0)
    left: list[int] = []
    for tenth in range(1200):
        belts.step(tenth * S // 10)
        belts.select({t.id: "anna" for t in belts.tracked(0).objects if t.kind == "red"}, belts.now_ns)
        left.append(belts.state(0).left)
    assert [left[-1] - left[-300], left[-300] - left[-600]] >= [20, 20], left[::100]


def test_package_without_room_behind_a_junction_does_not_enter_it() -> None:
    belts = plant(CROSS, feeders={"w": every("w", 1.5, kind="red"), "n": every("n", 1.5, kind="blue")})
    belts.set_speed(0.0, ("e",))
    run(belts, 60.0, step_s=0.2)
    counts = {(bay.bay, bay.kind): bay.count for bay in belts.state(0).bays}
    assert counts[("1", "blue")] >= 25
    assert ("3", "red") not in counts


def test_one_that_waits_where_belts_cross_does_not_touch_those_that_pass() -> None:
    crossing = CROSS.model_copy(update={"links": CROSS.links[:1]})
    belts = plant(crossing, feeders={"w": every("w", 1.0, kind="red"), "n": every("n", 1.3, kind="blue")})
    held = 0
    for objects in run(belts, 50.0, step_s=0.1):
        check_apart(CROSS, objects)
        held += any(tracked.surface_speed_mps == 0.0 for tracked in objects)
    assert held, "nobody ever had to wait: this tests nothing"
    counts = {(count.bay, count.kind): count.count for count in belts.state(0).bays}
    assert counts["3", "red"] >= 10
    assert counts["1", "blue"] >= 10


def test_a_linked_belt_that_runs_backwards_holds_at_its_start() -> None:
    belts = plant(CHAIN, feeder={"sequence": ["red"], "interval_s": 2.0, "count": 3})
    run(belts, 5.0)
    belts.set_speed(-0.5)
    run(belts, 30.0)
    assert belts.size == 3
    assert [t.surface_speed_mps for t in belts.tracked(0).objects] == [0.0] * 3
    with pytest.raises(NoRoomError, match="backwards"):
        belts.add("red", "a", 0.3)
    belts.set_speed(0.5)
    run(belts, 60.0)
    assert belts.size == 0


def test_package_too_long_for_the_junctions_is_refused() -> None:
    with pytest.raises(NoRoomError, match=r"2 m do not fit .* at most 0\.4 m do; set longest_m"):
        plant(FORK).add("tree", "main", 2.0)


def test_a_snapshot_of_an_older_version_is_restored_unless_a_package_now_waits_inside_a_junction() -> None:
    belts, again = (plant(FORK, feeder={"sequence": ["red"], "interval_s": 1.0}) for _ in range(2))
    run(belts, 5.5)
    old = belts.snapshot()
    junctions = [package[9] for package in old["packages"]]
    assert {number < 0 for number in junctions} == {True, False}
    old["packages"] = [[*package, ["belt", "main"], False] for package in old["packages"]]
    again.restore(old)
    assert again.tracked(0) == belts.tracked(0)
    assert again.snapshot() == belts.snapshot()
    old["packages"][junctions.index(max(junctions))][9] = -1
    with pytest.raises(ValueError, match="the junctions have changed"):
        again.restore(old)
