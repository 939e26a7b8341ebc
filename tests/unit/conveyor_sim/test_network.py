"""Lanes, and networks of belts."""

import contextlib
import math
from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.maps.file import load_map
from pointit.schemas import Belt, BeltLink, Environment, TrackedObject
from pointit.services.conveyor_sim.feeding import NoRoomError, UnknownLaneError
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.conveyor_sim.traffic import Rings
from tests.unit.conveyor_sim.rooms import (
    CHAIN,
    CROSS,
    FORK,
    MERGE,
    ROOMS,
    S,
    belt,
    check_apart,
    lanes,
    link,
    plant,
    room,
)

SHIPPED = load_map("conveyor", 0)
EVERYWHERE = {**ROOMS, "conveyor": SHIPPED, "lanes": lanes(4.0, 7.0)}
speeds = st.sampled_from([0.0, 0.3, 0.5, 1.0, 2.0, 5.0, -0.5, -2.0])
action = st.one_of(
    st.tuples(st.just("step"), st.sampled_from([0.01, 0.04, 0.2, 1.0, 4.0])),
    st.tuples(st.just("step"), st.floats(0.001, 2.0)),
    st.tuples(st.just("speed"), speeds),
    st.tuples(st.just("one"), speeds),
    st.tuples(st.just("add"), st.floats(0.05, 0.4)),
    st.tuples(st.just("select"), st.floats(0.0, 1.0)),
)


def check_moved(before: tuple[TrackedObject, ...], after: tuple[TrackedObject, ...], most_m: float) -> None:
    places = {tracked.id: tracked for tracked in before}
    for tracked in after:
        assert math.hypot(*tracked.velocity_mps) == pytest.approx(abs(tracked.surface_speed_mps))
        if tracked.id in places:
            moved_m = math.dist(tracked.position_m, places[tracked.id].position_m)
            assert moved_m <= most_m + 1e-6, (places[tracked.id], tracked)


def check_order(before: tuple[TrackedObject, ...], after: tuple[TrackedObject, ...]) -> None:
    """Fail where packages that stayed on a belt have passed each other."""
    places = {tracked.id: tracked for tracked in before}
    stayed = [t for t in after if t.id in places and places[t.id].surface_id == t.surface_id]
    for a in stayed:
        for b in stayed:
            if a.surface_id == b.surface_id and a.surface_position_m < b.surface_position_m:
                assert places[a.id].surface_position_m < places[b.id].surface_position_m, (a, b)


def moves_on(belts: Plant, now_ns: int) -> bool:
    """Return True if a package moves within a minute: at one moment all may wait for each other's bridges."""
    for second in range(60):
        belts.step(now_ns + second * S)
        if any(tracked.surface_speed_mps for tracked in belts.tracked(now_ns + second * S).objects):
            return True
    return False


feeders = st.fixed_dictionaries(
    {
        "interval_s": st.floats(0.3, 3.0),
        "length_m": st.sampled_from([0.15, 0.3, 0.4]),
        "initial": st.integers(0, 5),
        "count": st.just(25),
    }
)
bay_pairs = st.sampled_from([("1", "3"), ("2", "1"), ("3", "1"), ("9", "9")])


@st.composite
def networks(draw: st.DrawFn) -> Environment:
    """Return parallel belts, linked from anywhere to anywhere: bridges cross belts and each other."""
    lengths_m = draw(st.lists(st.floats(0.5, 6.0), min_size=2, max_size=5))
    belts = [belt(str(row), (0.0, 1.5 * row), (long_m, 1.5 * row)) for row, long_m in enumerate(lengths_m)]
    row = st.integers(0, len(belts) - 1)
    links = [
        BeltLink(
            source=str(source),
            target=str(target),
            source_position_m=None if at is None else at * lengths_m[source],
            target_position_m=to * lengths_m[target],
        )
        for source, at, target, to in draw(
            st.lists(
                st.tuples(row, st.none() | st.floats(0.1, 0.95), row, st.just(0.0) | st.floats(0.0, 0.9)),
                min_size=1,
                max_size=8,
            )
        )
        if source != target
    ]
    ends = draw(st.lists(row, unique=True, max_size=3))
    return room(belts, links, **{f"b{number + 1}": str(end) for number, end in enumerate(ends)})


def check_run(
    environment: Environment,
    actions: list[tuple[str, float]],
    bays: tuple[str, str],
    feeder: dict[str, float],
    name: str = "",
) -> None:
    """Fail if something overlaps, jumps, is lost or stays for ever; `name` is that of a known room.

    In a random room narrow junctions are too close at corners, and packages may go round in a ring.
    """
    belts = plant(environment, feeder=feeder, bay_selected=bays[0], bay_rest=bays[1])
    ids = [line.id for line in environment.belts]
    now_ns = 0
    left = 0
    for index, (what, value) in enumerate(actions):
        before = belts.tracked(now_ns).objects
        if what == "step":
            now_ns += round(value * S)
            gone = belts.step(now_ns)
            left += len(gone)
            after = belts.tracked(now_ns).objects
            assert {event.object_id for event in gone}.isdisjoint(tracked.id for tracked in after)
            fastest_mps = max(abs(v) for v in belts.speeds.values())
            check_moved(before, after, fastest_mps * value)
            if name not in {"", "ring"}:  # where one comes back to the belt that it left
                check_order(before, after)
        elif what == "speed":
            belts.set_speed(value)
        elif what == "one":
            belts.set_speed(value, (ids[index % len(ids)],))
        elif what == "select":
            belts.select({o.id: "anna" for i, o in enumerate(before) if i % 7 < 7 * value})
        else:
            with contextlib.suppress(NoRoomError):
                belts.add("extra", ids[index % len(ids)], value)
        check_apart(environment, belts.tracked(now_ns).objects, corners=bool(name))
        assert belts.fed == belts.size + left == len(belts.tracked(now_ns).objects) + left
    belts.set_speed(1.0)
    for _ in range(20):
        now_ns += 20 * S
        left += len(belts.step(now_ns))
        if not belts.size and belts.fed >= feeder["count"]:
            break
    assert belts.state(now_ns).left == left == belts.fed - belts.size
    if belts.size:
        assert not name, belts.tracked(now_ns)
        assert Rings(belts.network, 0.4).pieces, belts.tracked(now_ns)
        assert moves_on(belts, now_ns), "all stand for ever"


@given(st.sampled_from(sorted(EVERYWHERE)), st.lists(action, min_size=10, max_size=60), bay_pairs, feeders)
def test_packages_never_overlap_jump_or_get_lost(
    name: str, actions: list[tuple[str, float]], bays: tuple[str, str], feeder: dict[str, float]
) -> None:
    check_run(EVERYWHERE[name], actions, bays, feeder, name)


BRIDGES_TO_ONE_START = room(
    [belt("0", (0.0, 0.0), (1.5, 0.0)), belt("1", (0.0, 1.5), (1.5, 1.5)), belt("3", (0.0, 4.5), (5.0, 4.5))],
    [link("1", "3", to_m=0.0), link("0", "3", 0.25, to_m=0.0)],
    b1="3",
)
"""Packages on either bridge wait at one arc length before the belt, and do not overlap."""


@settings(max_examples=25)
@example(
    BRIDGES_TO_ONE_START,
    [("step", 0.01)] * 8 + [("step", 0.5)] * 40,
    ("1", "3"),
    {"interval_s": 0.3, "length_m": 0.15, "initial": 0, "count": 25},
)
@given(networks(), st.lists(action, min_size=10, max_size=40), bay_pairs, feeders)
@pytest.mark.slow
def test_packages_neither_overlap_nor_get_lost_on_any_network(
    environment: Environment,
    actions: list[tuple[str, float]],
    bays: tuple[str, str],
    feeder: dict[str, float],
) -> None:
    check_run(environment, actions, bays, feeder)


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


def test_package_loses_no_time_between_belts() -> None:
    belts = plant(CHAIN, feeder={"sequence": ["red"], "count": 1})
    straight = [
        x for objects in run(belts, 10.0, step_s=0.03) if objects and (x := objects[0].position_m[0]) < 5.2
    ]
    assert straight[-1] > 4.5
    for before, after in pairwise(straight):
        assert after - before == pytest.approx(0.5 * 0.03)


def test_packages_queue_behind_a_standing_belt_and_continue_with_it() -> None:
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


def test_endless_stream_admits_a_package_from_the_side_in_turn() -> None:
    belts = plant(MERGE, feeders={"main": every("main", 0.1)})
    run(belts, 15.0)
    name = belts.add("late", "left", 0.3)
    run(belts, 25.0)
    assert next(t.surface_id for t in belts.tracked(0).objects if t.id == name) == "main"


@pytest.mark.slow
def test_ring_is_never_filled_to_a_standstill() -> None:
    """All from one side want to go on where all from the other side stand."""
    feeders = {"e": every("part_e", 0.4, kind="blue"), "h": every("part_h", 0.4, kind="red")}
    belts = plant(SHIPPED, feeders=feeders, bay_selected="1", bay_rest="4", speed_mps=1.0)
    left: list[int] = []
    for tenth in range(1200):
        belts.step(tenth * S // 10)
        belts.select({t.id: "anna" for t in belts.tracked(0).objects if t.kind == "red"})
        left.append(belts.state(0).left)
    assert [left[-1] - left[-300], left[-300] - left[-600]] >= [20, 20], left[::100]


def test_package_without_room_behind_a_junction_does_not_enter_it() -> None:
    belts = plant(CROSS, feeders={"w": every("w", 1.5, kind="red"), "n": every("n", 1.5, kind="blue")})
    belts.set_speed(0.0, ("e",))
    run(belts, 60.0, step_s=0.2)
    counts = {(bay.bay, bay.kind): bay.count for bay in belts.state(0).bays}
    assert counts[("1", "blue")] >= 25
    assert ("3", "red") not in counts


def test_package_waiting_at_a_crossing_touches_none_that_pass() -> None:
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


def test_linked_belt_that_runs_backwards_holds_at_its_start() -> None:
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


FEEDER: dict[str, object] = {"interval_s": 2.0, "length_m": 0.3, "sequence": ["red", "green", "blue"]}


def conveyor(*lengths_m: float, speed_mps: float = 0.5, **feeder: object) -> Plant:
    return plant(lanes(*lengths_m), speed_mps=speed_mps, feeder={**FEEDER, **feeder})


def on(belts: Plant, lane: str = "0") -> list[TrackedObject]:
    return [tracked for tracked in belts.tracked(0).objects if tracked.surface_id == lane]


def places(belts: Plant, lane: str = "0") -> list[float]:
    return [tracked.surface_position_m for tracked in on(belts, lane)]


def number(tracked: TrackedObject) -> int:
    return int(tracked.id.split("-")[1])


def test_kinds_come_in_sequence_round_the_lanes_an_interval_apart() -> None:
    belts = conveyor(10.0, 10.0)
    belts.step(7 * S)
    objects = belts.tracked(7 * S).objects
    assert [(o.kind, o.surface_id, round(o.surface_position_m, 9)) for o in objects] == [
        ("blue", "0", 1.5),
        ("red", "0", 3.5),
        ("red", "1", 0.5),
        ("green", "1", 2.5),
    ]
    assert [number(o) for o in objects] == [3, 1, 4, 2]


def test_package_is_added_anywhere_along_a_belt_with_room() -> None:
    belts = conveyor(10.0, 4.0)
    belts.set_feeding(is_on=False)
    first = belts.add("red", "1", 0.3, 0.5)
    assert [(o.id, o.surface_position_m) for o in on(belts, "1")] == [(first, 2.0)]
    for share, at_m in ((0.52, r"2\.08"), (0.48, r"1\.92")):
        with pytest.raises(NoRoomError, match=rf"lane '1' has no room for 0\.3 m at {at_m} m: ask again"):
            belts.add("red", "1", 0.3, share)
    belts.add("red", "1", 0.3, 0.25)
    belts.add("red", "", 0.3, 1.0)
    assert (places(belts, "1"), places(belts)) == ([1.0, 2.0], [10.0])
    belts.step(S)
    assert (places(belts, "1"), places(belts)) == ([1.5, 2.5], [])


def test_objects_leave_when_their_centre_passes_the_end() -> None:
    belts = conveyor(1.0, count=1)
    assert belts.step(2 * S) == []
    assert (belts.size, belts.state(0).left) == (1, 0)
    (event,) = belts.step(2 * S + S // 100)
    assert (event.event, event.kind, event.user, event.bay) == ("left", "red", "", "")
    assert (belts.size, belts.fed, belts.state(0).left) == (0, 1, 1)
    assert belts.step(100 * S) == []


def test_belt_with_negative_speed_is_fed_at_its_end() -> None:
    belts = conveyor(1.0, speed_mps=-0.5, count=1)
    belts.step(S)
    (tracked,) = on(belts)
    assert tracked.surface_position_m == pytest.approx(0.5)
    assert tracked.surface_speed_mps == -0.5
    assert tracked.velocity_mps == pytest.approx((-0.5, 0.0, 0.0))
    assert [event.event for event in belts.step(3 * S)] == ["left"]


def test_feeding_waits_for_room_and_not_an_interval_more() -> None:
    belts = conveyor(10.0, speed_mps=0.1, interval_s=1.0)
    belts.step(9 * S)
    assert places(belts) == pytest.approx([0.0, 0.3, 0.6, 0.9])


@example([1.4, 1.4])  # four intervals to the nanosecond, but for the rounding of sums
@given(st.lists(st.floats(0.001, 3.0), min_size=1, max_size=30))
def test_places_depend_on_the_time_not_on_the_steps(steps_s: list[float]) -> None:
    often = conveyor(4.0, 7.0, interval_s=0.7)
    once = conveyor(4.0, 7.0, interval_s=0.7)
    now_ns = 0
    for step_s in steps_s:
        now_ns += round(step_s * S)
        often.step(now_ns)
    once.step(now_ns)
    a = often.tracked(0).objects
    b = once.tracked(0).objects
    assert [tracked.id for tracked in a] == [tracked.id for tracked in b]
    assert [o.surface_position_m for o in a] == pytest.approx([o.surface_position_m for o in b], abs=1e-6)


@pytest.mark.parametrize("speed_mps", [0.5, -0.5])
def test_initial_objects_are_evenly_spaced_the_first_furthest_along(speed_mps: float) -> None:
    belts = conveyor(4.0, 4.0, initial=5, speed_mps=speed_mps)
    along = slice(None, None, -1) if speed_mps > 0 else slice(None)
    assert [tracked.kind for tracked in on(belts, "0")][along] == ["red", "blue", "green"]
    assert [tracked.kind for tracked in on(belts, "1")][along] == ["green", "red"]
    assert places(belts, "0") == pytest.approx([4 / 6, 2.0, 20 / 6])
    assert places(belts, "1") == pytest.approx([1.0, 3.0])
    assert belts.fed == 5


def test_count_ends_the_feeding_and_reset_begins_it_again() -> None:
    belts = conveyor(2.0, count=3)
    events = belts.step(100 * S)
    assert (belts.fed, belts.state(0).left) == (3, 3)
    belts.reset()
    assert (belts.fed, belts.state(0).left, belts.size) == (0, 0, 0)
    belts.step(101 * S)
    assert [tracked.kind for tracked in on(belts)] == ["red"]
    assert {event.object_id for event in events}.isdisjoint(tracked.id for tracked in on(belts))


def test_adding_says_what_is_in_the_way() -> None:
    belts = conveyor(2.0, 2.0, sequence=[], speed_mps=0.1)
    assert belts.add("box", "", 0.4) == "0-1"
    with pytest.raises(UnknownLaneError, match=r"'x'.*there are 0, 1"):
        belts.add("box", "x", 0.4)
    with pytest.raises(NoRoomError, match=r"lane '0'.*0\.40 m are missing; ask again in 4\.0 s"):
        belts.add("box", "0", 0.4)
    belts.set_speed(0.0)
    with pytest.raises(NoRoomError, match="stands still"):
        belts.add("box", "0", 0.4)
    assert [belts.add("box", "1", 0.4), belts.fed] == ["0-2", 2]


def test_objects_follow_the_bends_of_their_lane() -> None:
    bent = room([Belt(id="a", line_m=((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 2.0, 1.0)))])
    belts = plant(bent, feeder={"sequence": ["red"], "interval_s": 1.0, "count": 1})
    belts.step(S)
    assert on(belts, "a")[0].velocity_mps == pytest.approx((0.5, 0.0, 0.0))
    belts.step(4 * S)
    (tracked,) = on(belts, "a")
    assert tracked.position_m == pytest.approx((1.0, 1.0, 1.0))
    assert tracked.velocity_mps == pytest.approx((0.0, 0.5, 0.0))
    assert (tracked.surface, tracked.surface_position_m) == ("belt", 2.0)


def test_belts_have_speeds_of_their_own_until_all_get_one() -> None:
    belts = conveyor(10.0, 10.0, interval_s=0.1, count=2)
    belts.step(S)
    belts.set_speed(1.0, ("1",))
    assert [(one.id, one.speed_mps) for one in belts.state(0).belts] == [("1", 1.0)]
    assert [tracked.surface_speed_mps for tracked in belts.tracked(0).objects] == [0.5, 1.0]
    before = [*places(belts, "0"), *places(belts, "1")]
    belts.step(2 * S)
    moved = [b - a for a, b in zip(before, [*places(belts, "0"), *places(belts, "1")], strict=True)]
    assert moved == pytest.approx([0.5, 1.0])
    with pytest.raises(UnknownLaneError, match="'9'"):
        belts.set_speed(3.0, ("0", "9"))
    assert belts.state(0).speed_mps == 0.5
    belts.set_speed(0.0)
    assert belts.state(0).belts == ()
