"""Belts without links in virtual time: feeding, leaving, speeds, whatever the steps."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pointit.schemas import Belt, TrackedObject
from pointit.services.conveyor_sim.feeding import NoRoomError, UnknownLaneError
from pointit.services.conveyor_sim.plant import Plant
from tests.unit.conveyor_sim.rooms import S, lanes, plant, room

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


def test_a_package_is_added_anywhere_along_a_belt_that_has_room() -> None:
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


def test_a_negative_speed_feeds_at_the_end_and_empties_at_the_start() -> None:
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
    often, once = conveyor(4.0, 7.0, interval_s=0.7), conveyor(4.0, 7.0, interval_s=0.7)
    now_ns = 0
    for step_s in steps_s:
        now_ns += round(step_s * S)
        often.step(now_ns)
    once.step(now_ns)
    a, b = often.tracked(0).objects, once.tracked(0).objects
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


def test_the_count_ends_the_feeding_and_reset_begins_it_again() -> None:
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
