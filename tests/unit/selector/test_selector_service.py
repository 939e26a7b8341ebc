"""The selector on a bus: from cursors to hovers, selections, events and cues."""

import asyncio

import pytest

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.service import Context
from pointit.schemas import (
    ButtonEvent,
    ClearSelection,
    Cursor,
    ReleaseObject,
    SetThing,
    ThingState,
    ThingStates,
    UndoSelection,
    topics,
)  # fmt: skip
from pointit.schemas.topics import ANNOUNCED
from pointit.services.registry import process
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from tests.support.bench import until
from tests.unit.selector.served import cursor, objects, served


async def test_staying_selects_an_object_until_it_leaves() -> None:
    async with served() as site:
        events = site.events
        hovers = site.hovers["anna"]
        assert [one.objects for one in site.selections] == [()], "who joins late knows at once"

        await site.stay("anna", 2.05, "a", "b")
        assert [(e.event, e.object_id, e.kind, e.user) for e in events] == [("selected", "b", "red", "anna")]
        assert site.owners == [("b", "anna")]
        assert [cue.cue for cue in site.cues["anna"]] == ["selected"]
        assert (len(hovers), hovers[-1].stamp_ns) == (25, site.clock.now_ns())
        assert {hover.object_id for hover in hovers} == {"b"}

        rising = [hover.progress for hover in hovers if hover.stamp_ns < events[0].stamp_ns]
        assert rising == sorted(rising)
        assert rising[0] == 0.0
        assert rising[-1] > 0.8

        for _ in range(2):
            site.bench.put(topics.OBJECTS, objects(site.clock, "a"), "conveyor")
            await site.bench.settle()
            site.clock.advance(0.6)  # a tracker may flicker
        assert site.owners == []
        assert len(events) == 1, "the conveyor tells that it left"


async def test_service_uses_the_topics_and_requests_of_its_row() -> None:
    async with served() as site:
        view = ServiceBus(site.bus, site.clock, "selector", "selector")
        Selector(SelectorConfig(), Context(bus=view, clock=site.clock))
        shard = ServiceBus(site.bus, site.clock, "selector", "selector.b")
        Selector(SelectorConfig(people=("ben",)), Context(bus=shard, clock=site.clock, name="b"))
        await site.stay("anna", 1.0, "a")
        row = process("selector")
        assert view.reads | shard.reads == {topic.key for topic in row.reads}
        # names are announced to named people only: test_announcements
        assert view.writes | shard.writes == {topic.key for topic in row.writes} - {ANNOUNCED.key}
        assert view.served == {request.key for request in row.serves}
        assert shard.served == set()
        await shard.close()
        await view.close()


async def test_silent_tracker_is_warned_of_then_forgotten_with_its_objects() -> None:
    async with served() as site:
        await site.stay("anna", 1.0, "a")
        assert site.owners == [("a", "anna")]
        assert site.health[-1].warnings == ()
        site.clock.advance(2.0)
        await until(lambda: site.warns("from conveyor,"), what="the warning")
        assert site.owners
        site.clock.advance(28.0)
        assert site.owners, "it may come back"
        site.clock.advance(1.0)
        await until(lambda: not site.health[-1].warnings, what="the tracker to be forgotten")
        site.clock.advance(1.0)
        await until(lambda: not site.owners, what="its objects to leave the selection")
        await until(lambda: not site.health[-1].warnings, what="the warning to go")


async def test_unavailable_carrier_is_a_warning_while_its_things_are_refused() -> None:
    async with served() as site:
        carrier = site.bus.announce(topics.CARRIER_ALIVE, "hue")
        for state, warning in (("unavailable", "acts on radio are refused: no power"), ("off", "")):
            radio = ThingState.model_validate({"id": "radio", "state": state, "reason": "no power"})
            states = ThingStates(stamp_ns=site.clock.now_ns(), things=(radio,))
            site.bench.put(topics.THING_STATES, states, "hue")
            await site.bench.settle()
            site.clock.advance(1.0)
            await until(
                lambda warning=warning: (
                    bool(site.health) and site.health[-1].warnings == (warning,) * bool(warning)
                ),
                what="the report",
            )
        carrier.close()
        await site.bench.settle()
        site.clock.advance(1.0)

        await until(
            lambda: site.warns("acts on radio are refused: hue has ended: start it again"), what="its end"
        )

        for _ in range(3):
            site.clock.advance(30.0)
            await site.bench.settle(3)
        await until(lambda: not site.health[-1].warnings, what="the carrier to be forgotten")


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("method", "stare", "method.*stare"),
        ("fraction", 1.5, "fraction.*1.5"),
        ("window_s", 0.05, "window_s.*0.05"),
        ("margin", 0.1, "no parameter margin.*margin_m"),
    ],
)
def test_wrong_parameter_is_named(field: str, value: object, said: str) -> None:
    layers = Layers()
    layers.add({field: value}, "file.yaml")
    with pytest.raises(ConfigError, match=said):
        layers.build(SelectorConfig)


async def test_two_trackers_at_25_hz_are_both_seen() -> None:
    """Both write before anybody reads: on one key the newer would take the older's place."""
    async with served() as site:
        for _ in range(25):
            site.clock.advance(0.04)
            site.bench.put(topics.OBJECTS, objects(site.clock, "a"), "conveyor")
            site.bench.put(topics.OBJECTS, objects(site.clock, "b"), "robot")
            await site.bench.settle(3)
            for user, at_m in (("anna", 1.0), ("ben", 2.0)):
                now_ns = site.clock.now_ns()
                at = Cursor(stamp_ns=now_ns, surface="strip", surface_id="0", position_m=at_m)
                site.bench.put(topics.CURSOR, at, user)
            await site.bench.settle(3)
        for user, name in (("anna", "a"), ("ben", "b")):
            assert {hover.object_id for hover in site.hovers[user]} == {name}


async def test_undo_and_release_reply_with_the_change_or_the_reason() -> None:
    async with served() as site:
        call = site.bus.call
        with pytest.raises(RefusedError, match="there is nothing to take back"):
            await call(topics.UNDO_SELECTION, UndoSelection(), "anna")
        with pytest.raises(RefusedError, match="object a is not selected"):
            await call(topics.RELEASE_OBJECT, ReleaseObject(object_id="a"), "boss")

        nothing = await call(topics.CLEAR_SELECTION, ClearSelection(), "nobody")
        assert nothing.message.startswith("0 ")
        await site.stay("anna", 1.0, "a")
        taken = await call(topics.RELEASE_OBJECT, ReleaseObject(object_id="a", take_over=True), "ben")
        assert taken.message == "red a deselected, red a selected"

        await site.bench.settle()
        assert site.owners == [("a", "ben")]
        with pytest.raises(RefusedError, match="red is ben's by now"):
            await call(topics.UNDO_SELECTION, UndoSelection(), "anna")

        undone = await call(topics.UNDO_SELECTION, UndoSelection(), "ben")
        assert undone.message == "red a deselected, red a selected"
        await site.bench.settle()
        assert site.owners == [("a", "anna")]


async def test_switching_again_is_not_reported_as_success_during_an_act() -> None:
    async with served() as site:
        site.bus.announce(topics.CARRIER_ALIVE, "home")
        states = (ThingState(id="a", state="off"),)
        site.bench.put(topics.THING_STATES, ThingStates(stamp_ns=1, things=states), "home")
        listed = objects(site.clock, "a")
        switches = tuple(each.model_copy(update={"mode": "switch"}) for each in listed.objects)
        site.bench.put(topics.OBJECTS, listed.model_copy(update={"objects": switches}), "pui")
        await site.bench.settle(3)
        query = SetThing(thing="a", on=True)
        first = asyncio.create_task(site.bus.call(topics.SET_THING, query, "anna"))
        await until(lambda: bool(site.events))
        second = await site.bus.call(topics.SET_THING, query, "ben")
        assert second.message == "a is being switched on: its result is not told yet"
        assert (await first).message == "red a selected; home did not tell the result yet"


async def test_undo_for_an_absent_person_names_those_present() -> None:
    async with served() as site:
        await site.stay("anna", 1.0, "a")
        site.bus.announce(topics.USER_ALIVE, "ben")
        await site.bench.settle()
        for user, said in (
            ("nobody", r"^nobody is not there, but anna, ben: there is nothing to take"),
            ("ben", r"^there is nothing to take back$"),
        ):
            with pytest.raises(RefusedError, match=said):
                await site.bus.call(topics.UNDO_SELECTION, UndoSelection(), user)


async def test_press_confirms_when_configured() -> None:
    async with served(confirm="press") as site:
        await site.stay("anna", 1.0, "a")
        assert site.events == []
        assert site.hovers["anna"][-1].progress == 1.0
        site.bench.put(topics.BUTTON, ButtonEvent(stamp_ns=site.clock.now_ns()), "anna")
        await site.bench.settle()
        assert [(event.event, event.cause) for event in site.events] == [("selected", "button")]


async def test_object_that_left_within_the_window_is_not_selected() -> None:
    async with served(method="fraction", fraction=0.5) as site:
        for index in range(25):
            site.clock.advance(0.04)
            site.bench.put(topics.OBJECTS, objects(site.clock, *("a" if index < 12 else "")), "conveyor")
            await site.bench.settle(3)
            site.bench.put(topics.CURSOR, cursor(site.clock, 1.0), "anna")
            await site.bench.settle(3)
        assert site.told == []
        assert all(selection.objects == () for selection in site.selections)
        assert not any("refused" in cue.cue for cue in site.cues["anna"])
