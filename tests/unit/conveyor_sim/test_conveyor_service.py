"""The conveyor on a bus: waits for the map, reports objects, answers requests."""

from itertools import pairwise
from pathlib import Path

import pytest

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.service import Context
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    AddPackage,
    Environment,
    ResetConveyor,
    SelectedObject,
    Selection,
    SelectionEvent,
    SetFeeding,
    SetSpeed,
    Strip,
    TrackedObjects,
    topics,
)
from pointit.services.conveyor_sim.config import ConveyorSimConfig, TrackingConfig
from pointit.services.conveyor_sim.service import ConveyorSim
from pointit.services.conveyor_sim.tracking import PackageTracker
from pointit.services.registry import process
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.conveyor_sim.rooms import FORK
from tests.unit.conveyor_sim.shift import shift

LAB = Environment(
    stamp_ns=1,
    name="lab",
    strips=(
        Strip(id="0", line_m=((0.0, 0.0, 0.9), (0.0, 5.0, 0.9)), pixels=150, direction=-1),
        Strip(id="1", line_m=((0.0, 5.0, 0.9), (-5.0, 5.0, 0.9)), pixels=150),
    ),
)


def config(**changes: object) -> ConveyorSimConfig:
    return ConveyorSimConfig.model_validate({"surface": "strip", "rate_hz": 100.0, **changes})


async def test_objects_move_on_the_strips_of_the_map() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        lists = bench.collect(topics.OBJECTS)
        states = bench.collect(topics.CONVEYOR_STATE)
        bench.start(ConveyorSim, config(feeder={"sequence": ["red", "green"], "interval_s": 1.0}))
        await until(lambda: bool(states))
        assert (states[0].speed_mps, states[0].fed) == (0.5, 0)
        assert lists == []

        bench.put(topics.MAP, LAB)
        await until(lambda: bool(states) and states[-1].fed >= 3)
        for message in lists:
            for tracked in message.objects:
                assert tracked.surface == "strip"
                along = LAB.strips[int(tracked.surface_id)].line_m[0]
                reach = abs(tracked.position_m[0] - along[0]) + abs(tracked.position_m[1] - along[1])
                assert reach == pytest.approx(tracked.surface_position_m)
        spans = [
            (b.stamp_ns - a.stamp_ns, b.objects[-1].surface_position_m - a.objects[-1].surface_position_m)
            for a, b in pairwise(lists)
            if a.objects and b.objects and a.objects[-1].id == b.objects[-1].id
        ]
        spans = [span for span in spans if span[0] < 10e9]  # a machine busy for longer makes it stand still

        assert spans
        for span_ns, moved_m in spans:
            assert moved_m == pytest.approx(0.5 * span_ns / 1e9, abs=1e-6)


async def test_configured_speed_is_a_figure_also_after_a_request() -> None:
    async with memory_bench(VirtualClock()) as bench:
        reports = bench.collect(topics.HEALTH)
        bench.start(ConveyorSim, config(speed_mps=0.2))
        bench.put(topics.MAP, LAB)
        await until(lambda: bool(reports))
        await bench.bus.call(topics.SET_SPEED, SetSpeed(speed_mps=0.8))
        count = len(reports)
        await until(lambda: len(reports) > count)
        figures = [figure for figure in reports[-1].figures if figure.name == "default speed"]
        assert [(each.value, each.unit) for each in figures] == [(0.2, "m/s")]


async def test_requests_are_done_or_refused_in_a_sentence() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        lists = bench.collect(topics.OBJECTS)
        states = bench.collect(topics.CONVEYOR_STATE)
        bench.start(ConveyorSim, config(feeder={"sequence": []}))
        await bench.settle()
        for early in (
            bench.bus.call(topics.ADD_PACKAGE, AddPackage(kind="red")),
            bench.bus.call(topics.SET_SPEED, SetSpeed(speed_mps=1.0)),
            bench.bus.call(topics.RESET_CONVEYOR, ResetConveyor()),
            bench.bus.call(topics.SET_FEEDING, SetFeeding(feeding=False)),
        ):
            with pytest.raises(RefusedError, match="is pui running"):
                await early

        bench.put(topics.MAP, LAB)
        await bench.settle()
        added = await bench.bus.call(topics.ADD_PACKAGE, AddPackage(kind="red", lane="1"))
        await bench.settle()
        assert [(o.id, o.kind, o.surface_id) for o in lists[-1].objects] == [(added.object_id, "red", "1")]
        with pytest.raises(RefusedError, match="no room"):
            await bench.bus.call(topics.ADD_PACKAGE, AddPackage(kind="red", lane="1"))
        with pytest.raises(RefusedError, match="there are 0, 1"):
            await bench.bus.call(topics.ADD_PACKAGE, AddPackage(kind="red", lane="x"))

        clock.advance(0.5)
        await bench.bus.call(
            topics.SET_SPEED, SetSpeed(speed_mps=-1.0)
        )  # from here on, not from the last report
        await bench.settle()
        assert lists[-1].objects[0].surface_position_m == pytest.approx(0.25)
        assert lists[-1].objects[0].surface_speed_mps == -1.0
        assert states[-1].speed_mps == -1.0

        done = await bench.bus.call(topics.RESET_CONVEYOR, ResetConveyor())
        await bench.settle()
        assert done.message.startswith("1 ")
        assert lists[-1].objects == ()
        assert (states[-1].fed, states[-1].left, states[-1].speed_mps) == (0, 0, -1.0)


async def test_selected_packages_go_to_their_bay_and_late_acts_fail() -> None:
    async with shift(feeder={"sequence": []}) as one:
        lists = one.lists
        events = one.events
        states = one.states
        results = one.bench.collect(topics.ACT_RESULTS)
        things = one.bench.collect(topics.THING_STATES)
        names = [(await one.bus.call(topics.ADD_PACKAGE, AddPackage(kind="red"))).object_id]
        await one.go(2)
        names.append((await one.bus.call(topics.ADD_PACKAGE, AddPackage(kind="red"))).object_id)
        await one.go(5)

        chosen = tuple(SelectedObject(id=name, user="anna", since_ns=1) for name in names)
        one.bench.put(topics.SELECTION, Selection(stamp_ns=1, objects=chosen))
        assert {each.id for each in things[-1].things} == {*names}

        for number, name in enumerate([*names, "gone"], start=1):
            act = SelectionEvent(
                stamp_ns=one.bench.clock.now_ns() + number,
                event="selected",
                object_id=name,
                user="anna",
                carriers=("conveyor-sim",),
            )
            one.bench.put(topics.SELECTION_EVENTS, act)
        await until(lambda: len(results) == 3)
        assert [(each.object_id, each.result, each.code) for each in results] == [
            ("gone", "failed", "unavailable"),
            (names[0], "failed", "refused"),
            (names[1], "done", ""),
        ]
        assert results[1].text == "it is past its last way to bay 1 and goes on to bay 3"

        one.bench.put(topics.SELECTION, Selection(stamp_ns=2, objects=chosen[1:]))
        await one.go(0.5)
        assert {tracked.id: tracked.bay for tracked in lists[-1].objects} == {names[0]: "3", names[1]: "1"}

        await one.go(9)
        done = [each for each in events if not each.carriers]
        assert [(e.event, e.object_id, e.bay) for e in done] == [
            ("dispatched", names[0], "3"),
            ("dispatched", names[1], "1"),
        ]
        assert [event.seq for event in done] == [1, 2]
        assert [(bay.bay, bay.selected) for bay in states[-1].bays] == [("1", 1), ("3", 0)]

        told = [(gone.object_id, gone.bay, gone.user, gone.stamp_ns) for gone in states[-1].departures]
        assert told == [(names[1], "1", "anna", done[1].stamp_ns)], "the other one was taken back in time"
        assert states[-1].refused == 1
        assert things[-1].things == ()


async def test_reports_are_as_late_as_configured() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        ages_s: list[float] = []
        bench.bus.subscribe(
            topics.OBJECTS, lambda message, _: ages_s.append((clock.now_ns() - message.stamp_ns) / 1e9)
        )
        bench.start(ConveyorSim, config(surface="belt", tracking={"latency_s": 0.3}))
        bench.put(topics.MAP, FORK)
        await until(lambda: len(ages_s) >= 5)
        assert min(ages_s) >= 0.3
        assert max(ages_s) < 0.3 + 2 / 25


def test_tracker_without_latency_reports_every_time_at_once() -> None:
    tracker = PackageTracker(TrackingConfig())
    for step in range(200):
        exact = TrackedObjects(stamp_ns=1_764_417_600_000_000_000 + step * 40_000_123)
        assert tracker.report(exact) is exact


async def test_schedule_with_an_error_is_refused_before_the_start(tmp_path: Path) -> None:
    path = tmp_path / "steps.yaml"
    path.write_text("steps: {1: {speed: 1}}")
    with pytest.raises(ConfigError, match=r"steps\.yaml.*duration"):
        ConveyorSim.validate_config(config(schedule=str(path)))


async def test_same_map_changes_nothing_and_another_map_restarts_the_plant() -> None:
    async with shift(room=LAB, surface="strip", feeder={"interval_s": 100.0}) as one:
        first = one.ids[0]
        one.clock.advance(0.1)
        one.bench.put(topics.MAP, Environment(stamp_ns=2, name="again", strips=LAB.strips))
        await one.bench.settle()
        seen = len(one.lists)
        await until(lambda: len(one.lists) > seen)
        assert one.ids[0] == first
        one.clock.advance(0.1)
        one.bench.put(topics.MAP, Environment(stamp_ns=3, name="half", strips=LAB.strips[1:]))
        await until(lambda: one.ids[0] != first)
        assert one.lists[-1].objects[0].surface_id == "1"


async def test_health_says_when_the_map_lacks_the_lanes() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        view = ServiceBus(bench.bus, clock, "conveyor-sim", "conveyor-sim")
        service = ConveyorSim(
            config(lanes=["1", "7"], feeder={"initial": 99}), Context(bus=view, clock=clock)
        )
        bench.put(topics.MAP, LAB)
        await bench.settle()

        assert view.report().warnings == (
            (
                "lanes: map 'lab' has no strip '7', there are 0, 1; use others, as by --set "
                "'conveyor-sim.lanes=[0]', or the other surface by --set conveyor-sim.surface=belt"
            ),
        )

        more = Strip(id="7", line_m=((0.0, 0.0, 0.0), (3.0, 0.0, 0.0)), pixels=10)
        bench.put(topics.MAP, Environment(stamp_ns=2, name="lab", strips=(*LAB.strips, more)))
        await bench.settle()
        (warning,) = view.report().warnings
        assert warning.startswith("feeder.initial: 99 configured, ")

        row = process("conveyor-sim")
        assert row.load() is type(service)
        assert view.reads == {topic.key for topic in row.reads}
        assert view.writes == {topic.key for topic in row.writes}
        assert view.served == {request.key for request in row.serves}
        await view.close()


async def test_machine_that_slept_does_not_make_the_objects_jump() -> None:
    async with shift(room=LAB, surface="strip", feeder={"count": 1}) as one:
        one.clock.advance(3600.0)
        await until(lambda: one.lists[-1].stamp_ns == one.clock.now_ns())
        assert one.lists[-1].objects[0].surface_position_m == 0.0
        assert one.events == []
