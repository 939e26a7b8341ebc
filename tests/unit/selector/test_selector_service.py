"""The selector on a bus: from cursors to hovers, selections, events and cues."""

import pytest

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.service import Context
from pointit.schemas import (
    ButtonEvent,
    Cursor,
    ReleaseObject,
    TrackedObject,
    TrackedObjects,
    UndoSelection,
    topics,
)
from pointit.services.registry import process
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from tests.support.bench import Bench, ManualClock, memory_bench, until


def strip_object(object_id: str, position_m: float) -> TrackedObject:
    return TrackedObject(
        id=object_id,
        kind="red",
        position_m=(position_m, 0.0, 0.9),
        length_m=0.3,
        surface="strip",
        surface_id="0",
        surface_position_m=position_m,
    )


def objects(clock: ManualClock, *ids: str) -> TrackedObjects:
    return TrackedObjects(
        stamp_ns=clock.now_ns(),
        objects=tuple(strip_object(object_id, ord(object_id) - ord("a") + 1.0) for object_id in ids),
    )


async def stay(bench: Bench, clock: ManualClock, user: str, position_m: float, *ids: str) -> None:
    """Keep the cursor there for a second at 25 Hz, with `ids` listed at 1, 2, … m."""
    for _ in range(25):
        clock.advance(0.04)
        bench.put(topics.OBJECTS, objects(clock, *ids), "conveyor")
        await bench.settle(3)
        at = Cursor(
            stamp_ns=clock.now_ns(),
            surface="strip",
            surface_id="0",
            point_m=(position_m, 0.0, 0.9),
            position_m=position_m,
        )
        bench.put(topics.CURSOR, at, user)
        await bench.settle(3)


async def test_staying_on_an_object_selects_it_and_its_leaving_ends_that() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        selections, events = bench.collect(topics.SELECTION), bench.collect(topics.SELECTION_EVENTS)
        hovers, cues = bench.collect(topics.HOVER, "anna"), bench.collect(topics.FEEDBACK, "anna")
        bench.start(Selector)
        await bench.settle()
        assert [s.objects for s in selections] == [
            ()
        ]  # who joins late knows at once that nothing is selected
        await stay(bench, clock, "anna", 2.05, "a", "b")
        assert [(e.event, e.object_id, e.kind, e.user) for e in events] == [("selected", "b", "red", "anna")]
        assert [(o.id, o.user) for o in selections[-1].objects] == [("b", "anna")]
        assert [cue.cue for cue in cues] == ["selected"]
        assert len(hovers) == 25
        assert hovers[-1].stamp_ns == clock.now_ns()
        assert {hover.object_id for hover in hovers} == {"b"}
        rising = [hover.progress for hover in hovers if hover.stamp_ns < events[0].stamp_ns]
        assert rising == sorted(rising)
        assert rising[0] == 0.0
        assert rising[-1] > 0.8

        for _ in range(2):
            bench.put(topics.OBJECTS, objects(clock, "a"), "conveyor")
            await bench.settle()
            clock.advance(0.6)  # a tracker may flicker
        assert selections[-1].objects == ()
        assert len(events) == 1  # the conveyor tells that it left


async def test_somebody_elses_object_is_refused_with_a_reason() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        selections, events = bench.collect(topics.SELECTION), bench.collect(topics.SELECTION_EVENTS)
        cues = bench.collect(topics.FEEDBACK, "ben")
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        await stay(bench, clock, "ben", 1.0, "a")
        assert [(e.event, e.user) for e in events] == [("selected", "anna"), ("refused", "ben")]
        assert "anna" in events[-1].reason
        assert [(cue.cue, cue.text) for cue in cues] == [("refused", events[-1].reason)]
        assert [o.user for o in selections[-1].objects] == ["anna"]


async def test_it_reads_writes_and_answers_what_its_row_says() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        view = ServiceBus(bench.bus, clock, "selector", "selector")
        Selector(SelectorConfig(), Context(bus=view, clock=clock))
        shard = ServiceBus(bench.bus, clock, "selector", "selector.b")
        Selector(SelectorConfig(people=("ben",)), Context(bus=shard, clock=clock, name="b"))
        await stay(bench, clock, "anna", 1.0, "a")
        row = process("selector")
        assert view.reads | shard.reads == {topic.key for topic in row.reads}
        assert view.writes | shard.writes == {topic.key for topic in row.writes}
        assert view.served == {request.key for request in row.serves}
        assert shard.served == set()
        await shard.close()
        await view.close()


async def test_a_tracker_that_fell_silent_is_warned_of_and_then_forgotten_with_its_objects() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        health, selections = bench.collect(topics.HEALTH), bench.collect(topics.SELECTION)
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        assert [o.id for o in selections[-1].objects] == ["a"]
        assert health[-1].warnings == ()
        clock.advance(2.0)
        await until(lambda: any("from conveyor," in text for text in health[-1].warnings), what="the warning")
        assert selections[-1].objects
        clock.advance(28.0)
        assert selections[-1].objects  # it may come back
        clock.advance(1.0)
        await until(lambda: not health[-1].warnings, what="the tracker to be forgotten")
        clock.advance(1.0)
        await until(lambda: not selections[-1].objects, what="its objects to leave the selection")
        await until(lambda: not health[-1].warnings, what="the warning to go")


async def test_what_somebody_who_left_has_selected_is_anybodys_after_a_while() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        events = bench.collect(topics.SELECTION_EVENTS)
        bench.start(Selector, SelectorConfig(ownerless_after_s=10.0))
        await bench.settle()
        token = bench.bus.announce(topics.USER_ALIVE, "anna")
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        token.close()
        await bench.settle()
        await stay(bench, clock, "ben", 1.0, "a")
        assert [(e.event, e.user) for e in events] == [("selected", "anna"), ("refused", "ben")]
        assert events[-1].reason == "red is selected by anna; only anna can deselect it"
        clock.advance(10.0)
        await stay(bench, clock, "ben", 9.0, "a")  # looks elsewhere, so that it may be toggled again
        await stay(bench, clock, "ben", 1.0, "a")
        assert (events[-1].event, events[-1].user) == ("deselected", "ben")


async def test_who_is_back_in_time_keeps_what_is_theirs() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        events = bench.collect(topics.SELECTION_EVENTS)
        bench.start(Selector, SelectorConfig(ownerless_after_s=1.0))
        await bench.settle()
        bench.bus.announce(topics.USER_ALIVE, "anna").close()
        again = bench.bus.announce(topics.USER_ALIVE, "anna")
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        clock.advance(30.0)
        await stay(bench, clock, "ben", 1.0, "a")
        assert events[-1].event == "refused"
        again.close()


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("method", "stare", "method.*stare"),
        ("fraction", 1.5, "fraction.*1.5"),
        ("window_s", 0.05, "window_s.*0.05"),
        ("margin", 0.1, "no parameter margin.*margin_m"),
    ],
)
def test_a_wrong_parameter_is_named(field: str, value: object, said: str) -> None:
    layers = Layers()
    layers.add({field: value}, "file.yaml")
    with pytest.raises(ConfigError, match=said):
        layers.build(SelectorConfig)


async def test_two_trackers_at_25_hz_side_by_side_are_both_seen() -> None:
    """Both write before anybody reads: on one key the newer would take the older's place."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        hovers = {user: bench.collect(topics.HOVER, user) for user in ("anna", "ben")}
        bench.start(Selector)
        await bench.settle()
        for _ in range(25):
            clock.advance(0.04)
            bench.put(topics.OBJECTS, objects(clock, "a"), "conveyor")
            bench.put(topics.OBJECTS, objects(clock, "b"), "robot")
            await bench.settle(3)
            for user, position_m in (("anna", 1.0), ("ben", 2.0)):
                at = Cursor(stamp_ns=clock.now_ns(), surface="strip", surface_id="0", position_m=position_m)
                bench.put(topics.CURSOR, at, user)
            await bench.settle(3)
        assert {hover.object_id for hover in hovers["anna"]} == {"a"}
        assert {hover.object_id for hover in hovers["ben"]} == {"b"}


async def test_undo_and_release_answer_what_they_did_or_why_not() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        selections = bench.collect(topics.SELECTION)
        bench.start(Selector)
        await bench.settle()
        with pytest.raises(RefusedError, match="there is nothing to take back"):
            await bench.bus.call(topics.UNDO_SELECTION, UndoSelection(), "anna")
        with pytest.raises(RefusedError, match="object a is not selected"):
            await bench.bus.call(topics.RELEASE_OBJECT, ReleaseObject(object_id="a"), "boss")
        await stay(bench, clock, "anna", 1.0, "a")
        taken = await bench.bus.call(
            topics.RELEASE_OBJECT, ReleaseObject(object_id="a", take_over=True), "ben"
        )
        assert taken.message == "red a deselected, red a selected"
        await bench.settle()
        assert [(one.id, one.user) for one in selections[-1].objects] == [("a", "ben")]
        with pytest.raises(RefusedError, match="red is ben's by now"):
            await bench.bus.call(topics.UNDO_SELECTION, UndoSelection(), "anna")
        undone = await bench.bus.call(topics.UNDO_SELECTION, UndoSelection(), "ben")
        assert undone.message == "red a deselected, red a selected"
        await bench.settle()
        assert [(one.id, one.user) for one in selections[-1].objects] == [("a", "anna")]


async def test_undo_for_somebody_who_is_not_there_names_who_is() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        bench.bus.announce(topics.USER_ALIVE, "ben")
        await bench.settle()
        with pytest.raises(
            RefusedError, match=r"^nobody is not there, but anna, ben: there is nothing to take"
        ):
            await bench.bus.call(topics.UNDO_SELECTION, UndoSelection(), "nobody")
        with pytest.raises(RefusedError, match=r"^there is nothing to take back$"):
            await bench.bus.call(topics.UNDO_SELECTION, UndoSelection(), "ben")


async def test_a_press_confirms_where_that_is_wanted() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        events, hovers = bench.collect(topics.SELECTION_EVENTS), bench.collect(topics.HOVER, "anna")
        bench.start(Selector, SelectorConfig(confirm="press"))
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        assert events == []
        assert hovers[-1].progress == 1.0
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=clock.now_ns()), "anna")
        await bench.settle()
        assert [(event.event, event.cause) for event in events] == [("selected", "button")]
