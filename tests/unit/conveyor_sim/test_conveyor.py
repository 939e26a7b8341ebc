"""The conveyor in virtual time: by hand, and for any sequence of speeds, feeds and steps."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import FARTHEST
from pointit.services.conveyor_sim.conveyor import Conveyor, NoRoomError, UnknownLaneError
from pointit.services.conveyor_sim.feeder import Feeder
from pointit.services.conveyor_sim.lane import Item, Lane

S = 1_000_000_000


def lanes(*lengths_m: float) -> list[Lane]:
    return [
        Lane("belt", str(index), Polyline([(0.0, index, 0.0), (length_m, index, 0.0)]))
        for index, length_m in enumerate(lengths_m)
    ]


def conveyor(
    *lengths_m: float,
    speed_mps: float = 0.5,
    interval_s: float = 2.0,
    length_m: float = 0.3,
    sequence: tuple[str, ...] = ("red", "green", "blue"),
    count: int = 0,
    initial: int = 0,
) -> Conveyor:
    feeder = Feeder(sequence, interval_s=interval_s, length_m=length_m, count=count)
    return Conveyor(lanes(*lengths_m), feeder, speed_mps=speed_mps, initial=initial, prefix="p")


def places(belts: Conveyor) -> list[dict[str, float]]:
    return [
        {item.id: p for item, p in zip(lane.items, lane.positions_m.tolist(), strict=True)}
        for lane in belts.lanes
    ]


def test_kinds_come_in_sequence_round_the_lanes_an_interval_apart() -> None:
    belts = conveyor(10.0, 10.0)
    belts.step(7 * S)
    assert [(o.kind, o.surface_id, round(o.surface_position_m, 9)) for o in belts.tracked()] == [
        ("blue", "0", 1.5),
        ("red", "0", 3.5),
        ("red", "1", 0.5),
        ("green", "1", 2.5),
    ]
    assert [o.id for o in belts.tracked()] == ["p-3", "p-1", "p-4", "p-2"]


def test_objects_leave_when_their_centre_passes_the_end() -> None:
    belts = conveyor(1.0, count=1)
    assert belts.step(2 * S) == []
    assert (belts.size, belts.left) == (1, 0)
    assert [item.kind for item in belts.step(2 * S + S // 100)] == ["red"]
    assert (belts.size, belts.fed, belts.left) == (0, 1, 1)
    assert belts.step(100 * S) == []


def test_a_negative_speed_feeds_at_the_end_and_empties_at_the_start() -> None:
    belts = conveyor(1.0, speed_mps=-0.5, count=1)
    belts.step(S)
    tracked = belts.tracked()[0]
    assert tracked.surface_position_m == pytest.approx(0.5)
    assert tracked.surface_speed_mps == -0.5
    assert tracked.velocity_mps == pytest.approx((-0.5, 0.0, 0.0))
    assert len(belts.step(3 * S)) == 1


def test_feeding_waits_for_room_and_not_an_interval_more() -> None:
    belts = conveyor(10.0, speed_mps=0.1, interval_s=1.0, length_m=0.3)
    belts.step(9 * S)
    assert list(places(belts)[0].values()) == pytest.approx([0.0, 0.3, 0.6, 0.9])


def test_nothing_is_fed_onto_a_standing_object() -> None:
    belts = conveyor(10.0, speed_mps=0.0, interval_s=1.0)
    belts.step(50 * S)
    assert belts.fed == 1
    belts.set_speed(0.3)
    belts.step(51 * S)
    assert belts.fed == 2


@example([1.4, 1.4])  # four intervals to the nanosecond, but for the rounding of sums
@given(st.lists(st.floats(0.001, 3.0), min_size=1, max_size=30))
def test_places_depend_on_the_time_not_on_the_steps(steps_s: list[float]) -> None:
    often, once = conveyor(4.0, 7.0, interval_s=0.7), conveyor(4.0, 7.0, interval_s=0.7)
    now_ns = 0
    for step_s in steps_s:
        now_ns += round(step_s * S)
        often.step(now_ns)
    once.step(now_ns)
    assert [list(lane) for lane in places(often)] == [list(lane) for lane in places(once)]
    for a, b in zip(places(often), places(once), strict=True):
        assert list(a.values()) == pytest.approx(list(b.values()), abs=1e-6)


action = st.one_of(
    st.tuples(st.just("step"), st.floats(0.0, 20.0)),
    st.tuples(st.just("speed"), st.floats(-5.0, 5.0) | st.just(0.0)),
    st.tuples(st.just("add"), st.floats(0.01, 5.0)),
    st.tuples(st.just("back"), st.floats(0.0, 5.0)),
)


@given(
    st.lists(action, max_size=40),
    st.lists(st.floats(0.2, 12.0), min_size=1, max_size=3),
    st.floats(0.05, 4.0),
    st.floats(0.05, 2.0),
    st.tuples(st.integers(0, 20), st.integers(0, 30)),
)
def test_nothing_overlaps_or_is_lost_whatever_happens(
    actions: list[tuple[str, float]],
    lengths_m: list[float],
    interval_s: float,
    length_m: float,
    initial_and_count: tuple[int, int],
) -> None:
    initial, count = initial_and_count
    belts = conveyor(*lengths_m, interval_s=interval_s, length_m=length_m, initial=initial, count=count)
    now_ns, left, added = 0, 0, 0
    seen: set[str] = set()
    for index, (what, value) in enumerate(actions):
        if what == "step":
            now_ns += round(value * S)
            left += len(belts.step(now_ns))
        elif what == "back":
            now_ns = max(0, now_ns - round(value * S))
            belts.step(now_ns)
        elif what == "speed":
            belts.set_speed(value)
        else:
            try:
                belts.add("extra", str(index % len(lengths_m)), value)
                added += 1
            except NoRoomError:
                pass
        assert belts.fed == belts.size + belts.left
        assert belts.left == left
        assert count == 0 or belts.fed - added <= count
        ids = [item.id for lane in belts.lanes for item in lane.items]
        assert len(ids) == len(set(ids)) == belts.size
        seen.update(ids)
        for lane in belts.lanes:
            assert len(lane.items) == len(lane.positions_m)
            assert np.all((lane.positions_m >= 0) & (lane.positions_m <= lane.line.length_m))
            for (a, at_a), (b, at_b) in pairwise(zip(lane.items, lane.positions_m, strict=True)):
                assert at_b - at_a >= (a.length_m + b.length_m) / 2 - 1e-6
    assert len(seen) <= belts.fed


@pytest.mark.parametrize("speed_mps", [0.5, -0.5])
def test_initial_objects_are_evenly_spaced_the_first_furthest_along(speed_mps: float) -> None:
    belts = conveyor(4.0, 4.0, initial=5, speed_mps=speed_mps)
    kinds = [[item.kind for item in lane.items] for lane in belts.lanes]
    along = slice(None, None, -1) if speed_mps > 0 else slice(None)
    assert kinds[0][along] == ["red", "blue", "green"]
    assert kinds[1][along] == ["green", "red"]
    assert belts.lanes[0].positions_m.tolist() == pytest.approx([4 / 6, 2.0, 20 / 6])
    assert belts.lanes[1].positions_m.tolist() == pytest.approx([1.0, 3.0])
    assert belts.fed == 5


def test_no_more_initial_objects_than_there_is_room_for() -> None:
    assert conveyor(1.0, initial=10, length_m=0.3).fed == 3
    assert conveyor(1.0, initial=10, count=2, length_m=0.3).fed == 2


def test_the_count_ends_the_feeding_and_reset_begins_it_again() -> None:
    belts = conveyor(2.0, count=3)
    belts.step(100 * S)
    assert (belts.fed, belts.left) == (3, 3)
    before = {f"p-{n}" for n in (1, 2, 3)}
    belts.reset()
    assert (belts.fed, belts.left, belts.size) == (0, 0, 0)
    belts.step(101 * S)
    assert [o.kind for o in belts.tracked()] == ["red"]
    assert before.isdisjoint(o.id for o in belts.tracked())


def test_an_empty_sequence_feeds_nothing() -> None:
    belts = conveyor(2.0, sequence=(), initial=3)
    belts.step(10 * S)
    assert belts.fed == 0


def test_adding_says_what_is_in_the_way() -> None:
    belts = conveyor(2.0, 2.0, sequence=(), speed_mps=0.1)
    assert belts.add("box", "", 0.4).id == "p-1"
    with pytest.raises(UnknownLaneError, match=r"'x'.*the lanes are 0, 1"):
        belts.add("box", "x", 0.4)
    with pytest.raises(NoRoomError, match=r"lane '0'.*0\.40 m are missing; ask again in 4\.0 s"):
        belts.add("box", "0", 0.4)
    belts.set_speed(0.0)
    with pytest.raises(NoRoomError, match="stands still"):
        belts.add("box", "0", 0.4)
    assert [belts.add("box", "1", 0.4).id, belts.fed] == ["p-2", 2]


def test_objects_follow_the_bends_of_their_lane() -> None:
    bent = Polyline([(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 2.0, 1.0)])
    belts = Conveyor(
        [Lane("strip", "s", bent)], Feeder(("red",), interval_s=1.0, count=1), speed_mps=0.5, prefix="p"
    )
    belts.step(S)
    assert belts.tracked()[0].velocity_mps == pytest.approx((0.5, 0.0, 0.0))
    belts.step(4 * S)
    tracked = belts.tracked()[0]
    assert tracked.position_m == pytest.approx((1.0, 1.0, 1.0))
    assert tracked.velocity_mps == pytest.approx((0.0, 0.5, 0.0))
    assert (tracked.surface, tracked.surface_id, tracked.surface_position_m) == ("strip", "s", 2.0)


def test_time_that_passes_standing_still_moves_nothing() -> None:
    belts = conveyor(10.0)
    belts.step(S)
    before = places(belts)
    belts.stand_still(100 * S)
    belts.step(100 * S)
    assert places(belts) == before


corners = st.sampled_from([-FARTHEST, FARTHEST])
inside = st.floats(-FARTHEST, FARTHEST)


@given(st.tuples(inside, inside, inside), st.tuples(corners, corners, corners), st.floats(0.999, 1.0))
def test_what_moves_at_the_end_of_the_world_can_still_be_reported(
    start: Vec3, end: Vec3, share: float
) -> None:
    assume(max(abs(a - b) for a, b in zip(start, end, strict=True)) > 1.0)  # a belt has a length
    lane = Lane("belt", "a", Polyline((start, end)))
    lane.fill([Item("p-1", "red", 0.3)])
    lane.move(lane.line.length_m * (share - 0.5))
    assert len(lane.tracked(5.0)) == len(lane.items)
