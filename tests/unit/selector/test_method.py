"""Another method or dwell time while people point: what is selected stays, progress restarts."""

from typing import Any, cast

import pytest

from pointit.runtime.errors import RefusedError
from pointit.schemas import ReservedObject, Selection, SetMethod, SetMethodReply
from pointit.schemas.topics import SET_METHOD
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.pointer import GuardedMethod, apply_method
from pointit.services.selector.selection_methods import PointingSample, SelectionProgress
from tests.unit.selector.room import Room, at, package, pointing
from tests.unit.selector.served import Served, served

METHODS: tuple[str, ...] = ("hold", "fraction", "gauge")
PAIRS = [("hold", "gauge"), ("gauge", "fraction"), ("fraction", "hold"), ("gauge", "gauge")]
CONFIG = SelectorConfig()


def switch(room: Room, method: str | None = None, dwell_s: float | None = None) -> None:
    room.selecting.use(apply_method(room.config, room.config, method, dwell_s))


@pytest.mark.parametrize("method", METHODS)
def test_named_method_has_its_own_or_the_given_dwell_time(method: str) -> None:
    own = apply_method(CONFIG, CONFIG.model_copy(update={"window_s": 3.0}), method, None)
    assert (own.method, own.dwell_s) == (method, 0.5 if method == "gauge" else 0.8)
    slow = apply_method(CONFIG, CONFIG, method, 2.0)
    assert (slow.method, slow.dwell_s) == (method, 2.0)
    assert apply_method(CONFIG, slow, None, None) is slow
    assert apply_method(CONFIG, slow, None, 1.0).method == method
    assert slow.gauge.sparse_full_s == pytest.approx(1.4 if method == "gauge" else 0.35)


def test_impossible_method_is_refused_with_a_reason() -> None:
    with pytest.raises(ValueError, match=r"0\.05 s is less than the timestep of 0\.1 s of method hold"):
        apply_method(CONFIG, CONFIG, "hold", 0.05)
    lazy = CONFIG.model_copy(update={"gauge": CONFIG.gauge.model_copy(update={"sparse_full_s": 1.0})})
    with pytest.raises(ValueError, match="would take 12 s, limit 10 s"):
        apply_method(lazy, lazy, None, 6.0)
    assert apply_method(CONFIG, CONFIG, "gauge", 0.05).dwell_s == 0.05


def seconds_to_select(room: Room, x_m: float = 5.0) -> float:
    began_s = room.time_s
    seen = len(room.events)
    while len(room.events) == seen:
        room.stay(0.02, anna=x_m)
        assert room.time_s - began_s < 10.0, "it was never selected"
    return room.time_s - began_s


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dwell_s", [0.4, 1.5])
def test_selection_takes_the_dwell_time_that_was_set(method: str, dwell_s: float) -> None:
    room = Room(package("a", 5.0), package("b", 4.5), method="hold" if method == "gauge" else "gauge")
    switch(room, method, dwell_s)
    assert seconds_to_select(room) == pytest.approx(dwell_s, abs=0.25)


@pytest.mark.parametrize(("before", "after"), PAIRS)
def test_new_method_resets_progress_and_keeps_selections_and_reservations(before: str, after: str) -> None:
    room = Room(package("a", 5.0), package("b", 8.0), method=before)
    seconds_to_select(room, 8.0)
    room.stay(0.7, anna=2.0)
    room.stay(0.45, anna=5.0)
    assert room.hovers["anna"][-1].progress > 0.3

    switch(room, after, 0.9)
    selection = room.selecting.selection(room.now_ns)
    assert {one.id: one.user for one in selection.objects} == {"b": "anna"}
    assert [(one.id, one.user) for one in selection.reserved] == [("a", "anna")]
    assert isinstance(selection.reserved[0], ReservedObject)

    room.stay(0.02, anna=5.0)
    assert room.hovers["anna"][-1].progress < 0.2
    assert seconds_to_select(room) > 0.5
    assert room.owners == {"a": "anna", "b": "anna"}
    assert room.records[-1].method == after


@pytest.mark.parametrize(("before", "after"), PAIRS)
def test_new_method_keeps_a_just_selected_object_latched(before: str, after: str) -> None:
    room = Room(package("a", 5.0), method=before)
    seconds_to_select(room)
    switch(room, after, 0.4)
    room.stay(3.0, anna=5.0)
    assert room.owners == {"a": "anna"}
    room.stay(1.0, anna=2.0)  # they leave it, come back, and now they mean it
    room.stay(1.0, anna=5.0)
    assert room.owners == {}


async def ask(site: Served, **query: Any) -> SetMethodReply:
    reply: SetMethodReply = await site.bus.call(SET_METHOD, SetMethod(**query))
    return reply


async def test_service_reports_its_method_and_changes_it_while_running() -> None:
    async with served() as site:
        reply = await ask(site)
        assert (reply.method, reply.dwell_s) == ("gauge", 0.5)
        assert reply.message == "staying on an object for 0.5 s selects it: gauge"

        await site.stay("anna", 1.0, "a", "b")
        assert site.owners == [("a", "anna")]
        reply = await ask(site, method="fraction", dwell_s=2.0)
        assert (reply.method, reply.dwell_s) == ("fraction", 2.0)
        assert reply == await ask(site)

        await site.stay("anna", 2.0, "a", "b")
        assert site.told == [("selected", "a", "anna")]
        await site.stay("anna", 2.0, "a", "b")
        await site.stay("anna", 9.0, "a", "b")
        assert [event.object_id for event in site.events] == ["a", "b"]
        assert site.owners == [("a", "anna"), ("b", "anna")]
        with pytest.raises(RefusedError, match="timestep"):
            await ask(site, dwell_s=0.01)
        assert (await ask(site, method="gauge")).dwell_s == 0.5


async def test_query_of_the_method_resets_no_progress() -> None:
    async with served(window_s=3.0, method="hold") as site:
        hovers = site.hovers["anna"]
        await site.stay("anna", 1.0, "a")
        before = hovers[-1].progress
        assert before > 0.3
        await ask(site)
        await ask(site, method="hold", dwell_s=3.0)
        await site.stay("anna", 1.0, "a")
        assert min(hover.progress for hover in hovers[26:]) >= before


def test_selections_have_the_method_once_a_shard_runs() -> None:
    room = Room(package("a", 3.0))
    first = room.selecting.selection(at(0.0))
    assert (first.method, first.dwell_s) == (None, None)
    room.selecting.tell_method()
    told = [one.message for one in room.selecting.tick(at(0.5))]
    assert [(one.method, one.dwell_s) for one in told if isinstance(one, Selection)] == [("gauge", 0.8)]
    assert room.selecting.tick(at(1.0)) == []


class Method:
    """A method whose results are those of a test."""

    def __init__(self, progress: Any, latched: Any = ()) -> None:
        self.progress = progress
        self.latched = latched

    def step(self, _pointing: PointingSample) -> Any:
        return self.progress

    def latch(self, object_id: str) -> None:
        raise AssertionError(object_id)


def sample_at(now_s: float) -> PointingSample:
    return PointingSample(pointing(now_s, 5.0), "a", None, bool)


def stepped(method: Method) -> tuple[GuardedMethod, SelectionProgress]:
    made: Any = method
    guarded = GuardedMethod(lambda: made)
    return guarded, guarded.step(sample_at(1.0))


@pytest.mark.parametrize(
    ("progress", "fault"),
    [
        (SelectionProgress(cast("Any", 7)), "TypeError: object_id 7, expected text or None"),
        (SelectionProgress("a", fired=cast("Any", b"a")), "TypeError: fired b'a', expected text or None"),
        (SelectionProgress("a", 1.5), "ValueError: progress 1.5, expected 0 to 1"),
        (SelectionProgress("a", 0.5, None, -1.0), "ValueError: spent_s -1.0, expected 0 or more"),
        (None, "TypeError: "),
    ],
)
def test_wrong_result_is_a_fault_and_selects_nothing(progress: SelectionProgress | None, fault: str) -> None:
    guarded, shown = stepped(Method(progress))
    assert guarded.fault.startswith(fault)
    assert shown == SelectionProgress("a")


@pytest.mark.parametrize("latched", [lambda: {"a"}, None, [["a"]]], ids=["method", "none", "lists"])
def test_invalid_latched_objects_are_a_fault(latched: object) -> None:
    guarded, _ = stepped(Method(SelectionProgress("a"), latched))
    assert guarded.fault == ""
    assert set(guarded.latched) == set()
    assert guarded.fault.startswith("TypeError: ")


def test_method_counts_as_sound_after_working_for_a_while() -> None:
    method: Any = Method(None)
    guarded = GuardedMethod(lambda: method)
    guarded.step(sample_at(1.0))
    method.progress = SelectionProgress("a", 0.5)
    assert [guarded.step(sample_at(now_s)).progress for now_s in (1.9, 2.0, 31.9)] == [0.0, 0.5, 0.5]
    assert guarded.fault.startswith("TypeError: ")
    guarded.step(sample_at(32.1))
    assert guarded.fault == ""


def test_objects_latched_before_the_first_cursor_reach_the_method() -> None:
    method: Any = Method(SelectionProgress("a"))
    latched = method.latched = set[str]()
    method.latch = latched.add
    guarded = GuardedMethod(lambda: method)
    for object_id in ("a", "b"):
        guarded.latch(object_id)
    assert set(guarded.latched) == {"a", "b"}
    guarded.step(sample_at(1.0))
    assert latched == {"a", "b"}
