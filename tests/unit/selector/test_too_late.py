"""Objects whose way to a bay is decided: refused when it is tried, closed with where and when they left."""

import pytest

from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    ActResult,
    ConveyorState,
    Departure,
    ThingState,
    ThingStates,
    TrackedObject,
)
from pointit.services.selector.selection_publisher import OutgoingMessage
from tests.unit.selector.room import Room, at, package

LEAD_S = 0.25


def bound(object_id: str, x_m: float, until_s: float | None, *, bay: str = "3") -> TrackedObject:
    until_ns = None if until_s is None else 0 if until_s == 0.0 else at(until_s)
    return package(object_id, x_m).model_copy(update={"bay": bay, "bay_until_ns": until_ns})


def departure(object_id: str, time_s: float, bay: str, user: str = "") -> ConveyorState:
    gone = Departure(object_id=object_id, stamp_ns=at(time_s), bay=bay, user=user)
    return ConveyorState(stamp_ns=at(time_s), speed_mps=0.5, departures=(gone,))


class Belt(Room):
    """A room whose packages have the carrier `conveyor-sim`."""

    def __init__(self, *objects: TrackedObject, **config: object) -> None:
        super().__init__(*objects, **config)
        states = tuple(ThingState(id=each.id, state="unknown") for each in objects)
        message = ThingStates(stamp_ns=self.now_ns, things=states)
        self.selecting.on_states("conveyor-sim", message, self.now_ns)
        self.selecting.on_carrier("conveyor-sim", True, self.now_ns)

    def take(self, outputs: list[OutgoingMessage]) -> list[OutgoingMessage]:
        return super().take([each for each in outputs if not isinstance(each.message, ActOutcome)])

    def tell(self, text: str = "") -> None:
        """Tell that the last act is done, or failed with a reason."""
        act = next(each for each in reversed(self.events) if each.carriers)
        result = ActResult(
            stamp_ns=self.now_ns,
            object_id=act.object_id,
            event_ns=act.stamp_ns,
            result="failed" if text else "done",
            state="unknown",
            code="refused" if text else "",
            text=text,
        )
        self.take(self.selecting.on_result("conveyor-sim", result, self.now_ns))


@pytest.mark.parametrize("method", ["gauge", "hold", "fraction"])
def test_object_past_its_last_way_is_refused_with_a_cue(method: str) -> None:
    room = Room(bound("a", 5.0, 0.0), method=method)
    room.stay(2.0, anna=5.0)
    assert room.told == [("refused", "a", "anna")]
    reason = "red is past its last way to another bay, it goes on to bay 3"
    assert room.events[0].reason == reason
    assert [(cue.cue, cue.text) for cue in room.cues["anna"]] == [("refused", reason)]
    assert not room.owners
    assert room.hovers["anna"][20].action == "refuse"
    assert [record.event for record in room.records] == ["refused"]


def test_selection_is_accepted_until_the_lead_before_its_last_way() -> None:
    early = Room(bound("a", 5.0, 3.0), lead_s=LEAD_S)
    early.stay(1.0, anna=5.0)
    fired_s = (early.events[0].stamp_ns - at(0.0)) / 1e9
    assert early.owners == {"a": "anna"}
    just = Room(bound("a", 5.0, fired_s + LEAD_S + 0.001), lead_s=LEAD_S)
    just.stay(1.0, anna=5.0)
    assert just.owners == {"a": "anna"}
    late = Room(bound("a", 5.0, fired_s + LEAD_S), lead_s=LEAD_S)
    late.stay(1.0, anna=5.0)
    assert late.told == [("refused", "a", "anna")]


def chosen(*object_ids: str) -> Room:
    """Return a room in which anna has selected `object_ids`, which are then on their way to bay 1."""
    room = Room(*(bound(name, 2.0 + 2.0 * number, 100.0) for number, name in enumerate(object_ids)))
    for number, _ in enumerate(object_ids):
        room.stay(1.2, anna=2.0 + 2.0 * number)
    assert room.owners == dict.fromkeys(object_ids, "anna")
    room.objects = [bound(one.id, one.surface_position_m, 0.0, bay="1") for one in room.objects]
    room.wait(1.0)
    room.events.clear()
    room.cues.clear()
    return room


def test_pointing_does_not_deselect_an_object_past_its_last_way() -> None:
    room = chosen("a")
    room.stay(1.0, anna=9.0)
    room.stay(1.5, anna=2.0)
    assert room.told == [("refused", "a", "anna")]
    assert room.owners == {"a": "anna"}


def take_back(room: Room, deed: str, now_ns: int) -> None:
    if deed == "release":
        room.take(room.selecting.release("ben", "a", False, now_ns))
    else:
        room.take(getattr(room.selecting, deed)("anna", now_ns))


@pytest.mark.parametrize("deed", ["undo", "clear", "release"])
def test_no_request_deselects_an_object_past_its_last_way(deed: str) -> None:
    room = chosen("a")
    take_back(room, deed, room.now_ns)
    assert [event.event for event in room.events] == ["refused"]
    assert room.events[0].cause == deed
    assert room.owners == {"a": "anna"}
    assert [cue.cue for cues in room.cues.values() for cue in cues] == ["refused"]


@pytest.mark.parametrize("deed", ["undo", "clear", "release"])
def test_objects_of_a_silent_tracker_are_never_too_late(deed: str) -> None:
    """The conveyor has ended; where its objects go now, nobody knows."""
    room = chosen("a")
    take_back(room, deed, room.now_ns + NS_PER_S + 1)  # older than objects_stale_after_s, not yet given up
    assert [event.event for event in room.events] == ["deselected"]
    assert not room.owners


def test_clear_deselects_objects_in_time_and_undo_restores_these_only() -> None:
    room = chosen("a", "b")
    room.objects = [bound("a", 2.0, 0.0, bay="1"), bound("b", 4.0, 100.0, bay="1")]
    room.wait(0.2)
    room.take(room.selecting.clear("anna", room.now_ns))
    assert sorted(room.told) == [("deselected", "b", "anna"), ("refused", "a", "anna")]
    room.take(room.selecting.undo("anna", room.now_ns))
    assert room.owners == {"a": "anna", "b": "anna"}


def test_takeover_changes_only_the_owner_and_is_never_too_late() -> None:
    room = chosen("a")
    room.take(room.selecting.release("ben", "a", True, room.now_ns))
    assert room.owners == {"a": "ben"}
    room.take(room.selecting.undo("ben", room.now_ns))
    assert room.owners == {"a": "anna"}


def test_departed_object_is_closed_with_the_conveyors_time_and_bay() -> None:
    room = chosen("a")
    selections = len(room.selections)
    state = departure("a", 2.0, "1", "anna")
    room.take(room.selecting.on_conveyor(state))
    room.take(room.selecting.on_conveyor(state))
    assert not room.owners
    assert len(room.selections) == selections + 1
    left = room.records[-1]
    assert (left.event, left.stamp_ns, left.user, left.reason) == ("left", at(2.0), "anna", "left at bay 1")
    assert [record.event for record in room.records].count("left") == 1


@pytest.mark.parametrize("method", ["gauge", "hold", "fraction"])
def test_object_refused_by_the_conveyor_is_latched(method: str) -> None:
    room = Belt(bound("a", 5.0, 100.0), method=method)
    room.stay(1.2, anna=5.0)
    room.stay(1.2, anna=9.0)
    room.stay(0.3, anna=5.0)  # back, to take it back
    room.tell("too late for bay 1")
    room.stay(3.0, anna=5.0)
    assert room.told == [("selected", "a", "anna"), ("deselected", "a", "anna")]
    room.stay(1.2, anna=9.0)
    room.stay(1.2, anna=5.0)
    assert room.owners == {"a": "anna"}


def test_refused_deselection_gives_the_object_back_to_its_owner() -> None:
    room = Belt(bound("a", 5.0, 100.0))
    room.stay(1.2, anna=5.0)
    room.tell()
    room.take(room.selecting.clear("anna", room.now_ns))
    assert not room.owners
    room.tell("too late for bay 1")
    assert room.owners == {"a": "anna"}
    assert room.events[-1].event == "selected"
    assert [cue.cue for cue in room.cues["anna"]] == ["selected", "refused"]
