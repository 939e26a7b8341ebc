"""Feeders by sequence, by probabilities, by the ROS toolkit's timed steps, and told to rest."""

import json
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.schemas import AddPackage, ResetConveyor, SetSpeed
from pointit.schemas.topics import ADD_PACKAGE, MAP, RESET_CONVEYOR, SET_SPEED
from pointit.services.conveyor_sim.feeding import (
    END,
    Feeder,
    FeedingStep,
    FeedSpec,
    Schedule,
    check_schedule,
    read_schedule,
)
from pointit.services.conveyor_sim.plant import Plant
from tests.support.bench import ManualClock, until
from tests.support.data import data_file
from tests.unit.conveyor_sim.rooms import CHAIN, FORK, ROOMS, S, check_apart, config, lanes, plant
from tests.unit.conveyor_sim.shift import shift

VR = load_map("vr_belts", 0)
SCHEDULE = """
steps:
  -1:
    speed: 0.5
    duration: 10.
    feed: False
    feeders:
      a: &a
        random: True
        pack_proba: {0: 0.3, 1: 0.7}
        kind_sequence: [0, 0, 1]
        min_interval: 1.
        max_interval: 2.
  0:
    speed: 1.0
    duration: 20.
    feed: True
    feeders: {a: *a, b: {random: False, kind_sequence: [0, 0, 1], min_interval: 3., max_interval: 3.}}
  7:
    speed: 2
    duration: 5
    feed: False
"""


def written(tmp_path: Path, text: str = SCHEDULE) -> str:
    path = tmp_path / "feeders.yaml"
    path.write_text(text)
    return str(path)


def fed(belts: Plant, seconds: float, step_s: float = 0.1) -> list[tuple[float, str, str, str]]:
    seen: dict[str, tuple[float, str, str, str]] = {}
    while belts.now_ns < seconds * S:
        belts.step(belts.now_ns + round(step_s * S))
        for tracked in belts.tracked(0).objects:
            seen.setdefault(tracked.id, (belts.now_ns / S, tracked.surface_id, tracked.kind, tracked.id))
    return list(seen.values())


def test_kinds_come_as_often_as_their_probabilities_say() -> None:
    feeders = {
        "f": {
            "belt": "0",
            "probabilities": {"red": 3.0, "blue": 1.0, "never": 0.0},
            "min_interval_s": 1.0,
            "max_interval_s": 2.0,
        }
    }
    belts = plant(lanes(5.0), feeders=feeders)
    came = fed(belts, 1500.0, 0.5)
    kinds = Counter(kind for _, _, kind, _ in came)
    assert set(kinds) == {"red", "blue"}
    assert kinds["red"] / len(came) == pytest.approx(0.75, abs=0.05)
    assert len(came) == pytest.approx(1000, rel=0.05)


def test_fed_packages_depend_on_the_seed_not_on_the_steps() -> None:
    feeders = {
        "f": {"belt": "0", "probabilities": {"red": 1.0, "blue": 1.0}},
        "g": {"belt": "1", "probabilities": {"red": 1.0, "blue": 1.0}},
    }

    def kinds(step_s: float, seed: int) -> list[tuple[str, str]]:
        belts = plant(lanes(50.0, 50.0), feeders=feeders, seed=seed)
        return [(belt, kind) for _, belt, kind, _ in fed(belts, 60.0, step_s)]

    assert sorted(kinds(0.04, 5)) == sorted(kinds(3.0, 5))
    assert sorted(kinds(0.04, 5)) != sorted(kinds(0.04, 6))


def supply(kinds: str = "", count: int = 0, intervals_s: tuple[float, float] = (1.0, 1.0)) -> FeedSpec:
    shortest_s, longest_s = intervals_s
    return FeedSpec(
        sequence=tuple(kinds), count=count, min_interval_s=shortest_s, max_interval_s=longest_s, length_m=0.2
    )


supplies = st.builds(
    supply,
    st.sampled_from(["", "r", "rrb", "rgb"]),
    st.integers(0, 4),
    st.sampled_from([(0.0, 0.0), (1.0, 1.0), (1.0, 3.0), (0.0, 2.0)]),
)
ticks_s = st.lists(st.sampled_from([0.0, 0.1, 0.5, 1.0, 2.5, 10.0]), max_size=30)


@given(supplies, st.sampled_from(["1", "12", "123"]), st.integers(0, 3), ticks_s)
def test_any_feeder_gives_its_kinds_in_turn_within_its_intervals(
    spec: FeedSpec, belts: str, seed: int, pauses_s: list[float]
) -> None:
    feeder = Feeder("f", belts, spec, seed=seed)
    spread_s = spec.max_interval_s - spec.min_interval_s
    assert 0.0 <= feeder.due_s <= spread_s
    given_packages: list[tuple[str, str, float]] = []
    for pause_s in pauses_s:
        due_s = feeder.due_s
        feeder.tick(pause_s)
        assert feeder.due_s == max(due_s - pause_s, 0.0)
        is_over = not spec.sequence or len(given_packages) == spec.count > 0
        assert feeder.is_done is is_over
        if feeder.is_done or feeder.due_s:
            continue

        number = len(given_packages)
        belt = feeder.belt
        kind = feeder.take()

        assert (belt, kind) == (belts[number % len(belts)], spec.sequence[number % len(spec.sequence)])
        assert spec.min_interval_s <= feeder.due_s <= spec.max_interval_s
        given_packages.append((belt, kind, feeder.due_s))
        assert feeder.taken == len(given_packages)

    feeder.restart()
    assert feeder.taken == 0
    for package in given_packages:  # the same again, with the same intervals
        assert (feeder.belt, feeder.take(), feeder.due_s) == package


durations_s = st.lists(st.sampled_from([0.5, 1.0, 2.5]), min_size=1, max_size=4)


@given(durations_s, ticks_s)
def test_any_schedule_runs_its_steps_once_in_order(durations: list[float], pauses_s: list[float]) -> None:
    feeders = [Feeder(f"f{number}", "1", supply("r"), seed=1) for number in range(len(durations))]
    schedule = Schedule(
        [
            FeedingStep(name=str(number), speed_mps=1.0, duration_s=duration_s, feeders=(feeders[number],))
            for number, duration_s in enumerate(durations)
        ]
    )
    current = 0
    left_s = durations[0]
    for pause_s in pauses_s:
        is_running = current < len(durations)
        left_s -= pause_s
        begins = False
        if is_running and left_s <= 0.0:
            current += 1
            begins = current < len(durations)
            left_s = durations[current] if begins else 0.0

        assert schedule.tick(pause_s) is begins
        is_over = current == len(durations)
        assert (schedule.index, schedule.is_over) == (current, is_over)
        assert schedule.step.name == str(min(current, len(durations) - 1))
        assert schedule.feeders == (() if is_over else (feeders[current],))

    feeders[-1].take()
    schedule.restart()
    assert (schedule.index, schedule.left_s, feeders[-1].taken) == (0, durations[0], 0)


@pytest.mark.parametrize(
    "feeder",
    [
        {"belt": "0", "sequence": ["x"], "probabilities": {"x": 1.0}},
        {"belt": "0", "probabilities": {"x": 1.0, "y": -1.0}},
        {"belt": "0", "sequence": ["x"], "min_interval_s": 2.0, "max_interval_s": 1.0},
    ],
)
def test_feeders_that_make_no_sense_are_refused(feeder: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        config(feeders={"f": feeder})


def test_schedule_runs_its_steps_in_order_with_their_speeds(tmp_path: Path) -> None:
    belts = plant(VR, schedule=written(tmp_path))
    assert (belts.state(0).step, belts.state(0).speed_mps) == ("-1", 0.5)
    assert fed(belts, 9.9) == []

    came = fed(belts, 29.9)
    assert (belts.state(0).step, belts.state(0).speed_mps) == ("0", 1.0)
    assert min(time_s for time_s, _, _, _ in came) >= 10.0

    counts = Counter(belt for _, belt, _, _ in came)
    assert 10 <= counts["a"] <= 20
    assert counts["b"] == 7

    sequence = [kind for _, belt, kind, _ in came if belt == "b"]
    assert sequence == ["blue", "blue", "red"] * 2 + ["blue"]
    belts.step(round(30.1 * S))
    assert (belts.state(0).step, belts.state(0).speed_mps) == ("7", 2.0)

    total = belts.fed
    belts.step(60 * S)
    assert (belts.state(0).step, belts.state(0).speed_mps, belts.fed) == ("end", 2.0, total)

    belts.reset()
    assert (belts.state(0).step, belts.state(0).speed_mps, belts.fed) == ("-1", 0.5, 0)


@pytest.mark.parametrize(("name", "steps", "fastest_mps"), [("feeders_0", 9, 2.0), ("feeders_3", 13, 10.0)])
def test_toolkits_schedules_run_as_they_are(name: str, steps: int, fastest_mps: float) -> None:
    path = data_file(f"pointit-ros2/{name}.yaml")
    assert len(read_schedule(path).steps) == steps
    belts = plant(VR, schedule=str(path))
    speeds: set[float] = set()
    now_s = 0.0
    while belts.state(0).step != "end":
        now_s += 1.0
        belts.step(round(now_s * S))
        speeds.add(belts.state(0).speed_mps)
    assert max(speeds) == fastest_mps
    assert belts.fed > 50
    belts.step(round((now_s + 100) * S))
    assert belts.size == 0


def test_belts_of_other_names_are_found_or_said(tmp_path: Path) -> None:
    path = written(tmp_path)
    with pytest.raises(
        ConfigError,
        match=r"feeders\.yaml: step -1, feeder 'a': the map has no belt a or belt_a or part_a, "
        r"there are 0, 1; set feeder_belts: \{a: BELT\}",
    ):
        plant(lanes(5.0, 5.0), schedule=path)
    belts = plant(lanes(50.0, 50.0), schedule=path, feeder_belts={"a": "1", "b": "0"})
    belts.step(25 * S)
    assert {tracked.surface_id for tracked in belts.tracked(0).objects} == {"0", "1"}


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("duration: 20.", "duration: 0", "steps.0.duration"),
        (
            "{0: 0.3, 1: 0.7}",
            "{0: 0.3, 2: 0.7}",
            r"step -1, feeder 'a': kind 2 has no name; set kinds: \{2: NAME\}",
        ),
        ("min_interval: 1.", "min_interval: 4.", "min_interval 4 is above max_interval 2"),
        ("random: True", "randm: True", "randm"),
    ],
)
def test_schedule_that_cannot_be_used_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    path = written(tmp_path, SCHEDULE.replace(old, new))
    with pytest.raises(ConfigError, match=sentence) as refused:
        check_schedule(config(schedule=path))
    assert str(refused.value).startswith(path)


MS = S // 1000


@settings(max_examples=15)
@given(st.sampled_from(sorted(ROOMS)), st.integers(1, 30_000), st.integers(1, 60_000), st.integers(300, 2000))
def test_belts_of_any_room_run_empty_while_feeders_rest(
    name: str, rest_ms: int, pause_ms: int, interval_ms: int
) -> None:
    feeder = {"interval_s": interval_ms / 1000, "length_m": 0.3, "initial": 2}
    belts = plant(ROOMS[name], feeder=feeder)
    belts.step(rest_ms * MS)
    belts.set_feeding(is_on=False)
    fed = belts.fed
    there = {tracked.id for tracked in belts.tracked(0).objects}
    left = 0
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


def test_feeding_switch_is_saved_immediately() -> None:
    belts = plant(FORK)
    for is_on in (False, True):
        changes = belts.changes
        belts.set_feeding(is_on=is_on)
        assert belts.changes > changes


async def test_feeders_rest_and_feed_again_by_request() -> None:
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


def test_state_reports_the_end_of_feeding_which_a_request_restarts() -> None:
    belts = plant(FORK, feeder={"sequence": ["red", "blue"], "interval_s": 1.0, "count": 3})
    belts.step(S)
    assert belts.state(0).step == ""
    belts.step(60 * S)
    assert (belts.state(0).step, belts.fed, belts.size) == (END, 3, 0)
    belts.set_feeding(is_on=False)
    belts.step(70 * S)
    belts.set_feeding(is_on=True)
    belts.step(71 * S)
    assert belts.state(0).step == ""
    belts.step(140 * S)
    assert (belts.state(0).step, belts.fed) == (END, 6)
    belts.reset()
    assert (belts.state(0).step, belts.fed) == ("", 0)


@pytest.mark.parametrize("feeder", [{"sequence": []}, {"interval_s": 1.0}])
def test_feeders_without_packages_or_without_a_count_never_end(feeder: dict[str, object]) -> None:
    belts = plant(FORK, feeder=feeder)
    belts.step(100 * S)
    assert belts.state(0).step == ""


def test_packages_that_leave_without_a_bay_are_counted_by_kind() -> None:
    belts = plant(lanes(2.0), feeder={"sequence": ["red", "blue"], "interval_s": 1.0, "count": 4})
    belts.step(S // 2)
    first = belts.tracked(0).objects[0].id
    belts.select({first: "anna"})
    belts.step(60 * S)
    counts = {(each.bay, each.kind): (each.count, each.selected) for each in belts.state(0).bays}
    assert counts == {("", "red"): (2, 1), ("", "blue"): (2, 0)}
