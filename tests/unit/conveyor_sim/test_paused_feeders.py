"""Feeders that were told to rest: nothing comes, nothing piles up, all else goes on."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.schemas import AddPackage, ResetConveyor, SetSpeed
from pointit.schemas.topics import ADD_PACKAGE, MAP, RESET_CONVEYOR, SET_SPEED
from pointit.services.conveyor_sim.plant import Plant
from tests.support.bench import ManualClock, until
from tests.unit.conveyor_sim.rooms import CHAIN, FORK, ROOMS, S, check_apart, lanes, plant
from tests.unit.conveyor_sim.shift import shift

MS = S // 1000
HALF_MS = MS // 2
"""Packages come at whole milliseconds here, and are looked at between two."""
STEPS = """
steps:
  1: {speed: 0.5, duration: 4., feeders: {a: &a {kind_sequence: [0], min_interval: 1., max_interval: 1.}}}
  2: {speed: 1.0, duration: 4., feeders: {a: *a}}
  3: {speed: 2.0, duration: 4., feed: False, feeders: {a: *a}}
"""


def came(belts: Plant, until_ns: int) -> list[tuple[int, str, str]]:
    """Return time (to 1 ms), belt and kind of each package that came, while no package leaves."""
    found: dict[str, tuple[int, str, str]] = {}
    while belts.now_ns < until_ns:
        belts.step(min(until_ns, belts.now_ns + 100 * MS))
        for tracked in belts.tracked(0).objects:
            since_s = tracked.surface_position_m / belts.speeds[tracked.surface_id]
            at_ms = round((belts.now_ns / S - since_s) * 1000)
            found.setdefault(tracked.id, (at_ms, tracked.surface_id, tracked.kind))
    return sorted(found.values())


@settings(max_examples=25)
@given(
    intervals_ms=st.lists(st.integers(800, 5000), min_size=1, max_size=3),
    rest_ms=st.integers(1, 12_000),
    pause_ms=st.integers(1, 30_000),
)
def test_what_comes_after_a_rest_is_what_would_have_come_later_by_that_rest(
    intervals_ms: list[int], rest_ms: int, pause_ms: int
) -> None:
    feeders = {
        f"f{number}": {
            "belt": str(number),
            "probabilities": {"red": 1.0, "blue": 1.0},
            "min_interval_s": interval_ms / 1000,
            "max_interval_s": interval_ms / 1000,
        }
        for number, interval_ms in enumerate(intervals_ms)
    }
    room = lanes(*[100.0] * len(feeders))
    rests_ns, ends_ns = rest_ms * MS + HALF_MS, 20_000 * MS + HALF_MS
    undisturbed = came(plant(room, feeders=feeders), ends_ns)
    belts = plant(room, feeders=feeders)
    before = came(belts, rests_ns)
    belts.set_feeding(is_on=False)
    fed = belts.fed
    during = came(belts, rests_ns + pause_ms * MS)
    assert (belts.fed, during) == (fed, before), "none came, and those that were there went on"
    belts.set_feeding(is_on=True)
    after = came(belts, ends_ns + pause_ms * MS)
    assert after == sorted(
        (at_ms if at_ms <= rest_ms else at_ms + pause_ms, belt, kind) for at_ms, belt, kind in undisturbed
    )


@settings(max_examples=15)
@given(st.sampled_from(sorted(ROOMS)), st.integers(1, 30_000), st.integers(1, 60_000), st.integers(300, 2000))
def test_belts_of_any_room_run_empty_while_feeders_rest(
    name: str, rest_ms: int, pause_ms: int, interval_ms: int
) -> None:
    feeder = {"interval_s": interval_ms / 1000, "length_m": 0.3, "initial": 2}
    belts = plant(ROOMS[name], feeder=feeder)
    belts.step(rest_ms * MS)
    belts.set_feeding(is_on=False)
    fed, there, left = belts.fed, {tracked.id for tracked in belts.tracked(0).objects}, 0
    for part in range(1, 6):
        left += len(belts.step((rest_ms + pause_ms * part // 5) * MS))
        check_apart(ROOMS[name], belts.tracked(0).objects)
    assert belts.fed == fed
    assert {tracked.id for tracked in belts.tracked(0).objects} <= there
    assert belts.size == len(there) - left
    after = plant(ROOMS[name], feeder=feeder)
    after.skip_time(belts.now_ns)
    after.restore(json.loads(json.dumps(belts.snapshot())))
    assert after.snapshot() == belts.snapshot()
    after.step(after.now_ns + 10 * S)
    assert (after.fed, after.state(0).feeding) == (fed, False)
    after.set_feeding(is_on=True)
    after.step(after.now_ns + 20 * S)
    assert after.fed > fed


def test_a_package_that_waited_for_room_is_one_package_after_the_rest() -> None:
    belts = plant(lanes(9.0), speed_mps=0.0, feeder={"interval_s": 0.1})
    belts.step(5 * S)
    assert belts.fed == 1, "the one on the belt is in the way of all others"
    belts.set_feeding(is_on=False)
    belts.set_speed(0.5)
    belts.step(15 * S)
    assert belts.fed == 1
    belts.set_feeding(is_on=True)
    belts.step(15 * S)
    assert belts.fed == 2


def test_a_schedules_steps_go_on_and_none_feeds_against_the_switch_or_by_it(tmp_path: Path) -> None:
    path = tmp_path / "feeders.yaml"
    path.write_text(STEPS)
    belts = plant(CHAIN, schedule=str(path))
    belts.step(round(1.5 * S))
    assert belts.fed == 2
    belts.set_feeding(is_on=False)
    belts.step(round(6.5 * S))
    assert (belts.state(0).step, belts.state(0).speed_mps, belts.fed) == ("2", 1.0, 2), (
        "a step sets no switch"
    )
    belts.set_feeding(is_on=True)
    belts.step(round(7.7 * S))
    assert belts.fed == 4, "at once, and after a second"
    belts.step(round(8.5 * S))
    fed = belts.fed
    for is_on in (False, True):
        belts.set_feeding(is_on=is_on)
        belts.step(belts.now_ns + S)
        assert (belts.state(0).step, belts.fed) == ("3", fed)


def test_a_conveyor_that_knew_no_rest_was_fed() -> None:
    before, after = plant(FORK), plant(FORK)
    kept = before.snapshot()
    del kept["feeding"]
    after.set_feeding(is_on=False)
    after.restore(kept)
    assert after.is_feeding


def test_feeding_switch_is_saved_immediately() -> None:
    belts = plant(FORK)
    for is_on in (False, True):
        changes = belts.changes
        belts.set_feeding(is_on=is_on)
        assert belts.changes > changes


async def test_the_request_lets_feeders_rest_until_it_lets_them_give_again() -> None:
    async with shift(feeder={"interval_s": 1.0}) as one:
        assert await one.switch(feeding=False) == "the feeders rest"
        await until(lambda: not one.states[-1].feeding)
        fed = one.states[-1].fed
        was_m = one.lists[-1].objects[0].surface_position_m
        await one.go(3)
        assert one.states[-1].fed == fed
        assert one.lists[-1].objects[0].surface_position_m == pytest.approx(was_m + 1.5)
        await one.bus.call(SET_SPEED, SetSpeed(speed_mps=1.0))
        added = await one.bus.call(ADD_PACKAGE, AddPackage(kind="red"))
        await until(lambda: added.object_id in one.ids)
        done = await one.bus.call(RESET_CONVEYOR, ResetConveyor())
        assert done.message == "2 objects taken off, the feeder still rests"
        await one.go(3)
        assert (one.states[-1].fed, one.states[-1].feeding) == (0, False)
        assert await one.switch(feeding=True) == "the feeders give packages"
        await one.go(3)
        assert (one.states[-1].fed, one.states[-1].feeding) == (4, True)


async def test_feeders_rest_on_after_a_restart_and_with_another_map() -> None:
    clock = ManualClock()
    feeder = {"interval_s": 0.5, "initial": 2}
    async with shift(clock, feeder=feeder) as first:
        await first.go(2)
        await first.switch(feeding=False)
        await until(lambda: not first.states[-1].feeding)
    clock.advance(5.0)
    async with shift(clock, feeder=feeder) as second:
        await second.go(3)
        assert (second.states[-1].fed, second.states[-1].feeding) == (first.states[-1].fed, False)
        second.bench.put(MAP, CHAIN)
        await until(lambda: second.states[-1].fed == 0)
        await second.go(3)
        assert (second.states[-1].fed, second.states[-1].feeding) == (0, False)
        assert second.health[-1].warnings == (), "nobody misses the initial ones"
        await second.switch(feeding=True)
        await second.go(3)
        assert second.states[-1].fed > 2
    clock.advance(100.0)
    async with shift(clock, feeder=feeder) as third:
        await third.go(1)
        assert third.states[-1].feeding
