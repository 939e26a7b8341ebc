"""Several people at once: reservations, owners, presence, undo, release; one owner whatever happens."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Hover, TrackedObjects
from tests.unit.selector.room import Room, at, package


def test_first_person_to_point_steadily_reserves_the_object() -> None:
    room = Room(package("a", 5.0), package("b", 8.0))
    room.stay(0.3, 50.0, anna=5.0)
    room.stay(0.1, 50.0, anna=5.0, ben=5.0)
    assert [(one.id, one.user) for one in room.selections[-1].reserved] == [("a", "anna")]
    assert room.hovers["ben"][-1].taken_by == "anna"
    assert room.hovers["ben"][-1].action == "refuse"
    assert room.hovers["anna"][-1].taken_by == ""
    room.stay(1.0, 50.0, anna=5.0, ben=5.0)
    assert room.told == [("selected", "a", "anna"), ("refused", "a", "ben")]
    assert not room.selections[-1].reserved
    room.stay(3.0, 50.0, anna=5.0, ben=5.0)
    assert len(room.events) == 2  # told once


def test_empty_hovers_are_sent_at_once_then_at_5_hz() -> None:
    room = Room(package("a", 5.0))
    room.stay(0.3, 50.0, anna=5.0)
    assert len(room.hovers["anna"]) == 15
    room.stay(0.02, 50.0, anna=8.0)
    assert room.hovers["anna"][15:] == [Hover(stamp_ns=room.now_ns, seq=16)]
    room.stay(1.0, 50.0, anna=8.0)
    assert [hover.seq for hover in room.hovers["anna"][16:]] == [17, 18, 19, 20, 21]
    room.stay(0.02, 50.0, anna=5.0)
    assert room.hovers["anna"][-1].object_id == "a"
    room.stay(0.02, 50.0, anna=8.0)
    assert not room.hovers["anna"][-1].object_id


def test_reserved_object_is_refused_to_others_with_the_reason() -> None:
    room = Room(
        package("a", 5.0), confirm="none", method="gauge", gauge={"full_s": 2.0, "sparse_full_s": 2.0}
    )
    room.stay(0.3, 50.0, anna=5.0)
    room.selecting.set_present("ben", True, room.now_ns)
    room.stay(1.0, 50.0, anna=5.0, ben=5.0)
    assert room.events == []
    for _ in range(3):  # anna comes and goes, and it stays hers
        room.stay(0.3, 50.0, anna=8.0, ben=5.0)
        room.stay(0.3, 50.0, anna=5.0, ben=5.0)
    assert room.told == [("refused", "a", "ben")]
    assert room.events[0].reason == "red is being selected by anna; wait or choose another one"
    assert [cue.text for cue in room.cues["ben"]] == [room.events[0].reason]


def test_reservation_ends_a_moment_after_the_object_is_left() -> None:
    room = Room(package("a", 5.0))
    room.stay(0.4, 50.0, anna=5.0)
    room.stay(0.45, 50.0, anna=8.0)
    assert room.selections[-1].reserved
    room.stay(0.1, 50.0, anna=8.0)
    assert not room.selections[-1].reserved
    room.stay(0.4, 50.0, ben=5.0)
    assert [one.user for one in room.selections[-1].reserved] == ["ben"]


def gone_after(room: Room, away_s: float) -> None:
    """Anna selects, is announced, leaves, and `away_s` pass."""
    room.selecting.set_present("anna", True, room.now_ns)
    room.stay(1.0, 50.0, anna=5.0)
    room.wait(60.0)  # present without pointing is present
    room.selecting.set_present("anna", False, room.now_ns)
    room.wait(away_s)


def test_only_the_owner_deselects_until_they_are_gone() -> None:
    room = Room(package("a", 5.0), ownerless_after_s=10.0)
    gone_after(room, 8.0)
    room.stay(1.0, 50.0, ben=5.0)
    assert room.told == [("selected", "a", "anna"), ("refused", "a", "ben")]
    assert room.events[-1].reason == "red is selected by anna; only anna can deselect it"
    room.stay(2.0, 50.0, ben=8.0)
    assert room.hovers["ben"][-1].object_id == ""
    room.stay(1.0, 50.0, ben=5.0)
    assert room.told[2:] == [("deselected", "a", "ben")]


def test_undo_refuses_a_departed_object_and_then_continues() -> None:
    room = Room(package("a", 5.0), package("b", 7.0))
    room.stay(1.0, 50.0, anna=5.0)
    room.stay(1.0, 50.0, anna=7.0)
    room.objects = room.objects[:1]
    room.wait(2.0)
    assert room.owners == {"a": "anna"}
    room.take(room.selecting.undo("anna", room.now_ns))
    assert room.told[-1] == ("refused", "b", "anna")
    assert room.events[-1].reason == "red has left; what was done with it cannot be taken back"
    room.take(room.selecting.undo("anna", room.now_ns))
    assert room.owners == {}


def test_tracker_with_a_clock_ahead_ends_no_ownership() -> None:
    room = Room(package("a", 5.0))
    room.stay(1.0, 50.0, anna=5.0)
    listed = room.objects
    room.objects = ()
    room.time_s += 0.02
    room.list_objects()  # the tracker flickers
    for stamp_ns in (at(room.time_s + 3600.0), 2**62):
        room.take(room.selecting.on_objects(f"other {stamp_ns}", TrackedObjects(stamp_ns=stamp_ns)))
    room.objects = listed
    room.wait(0.2)
    assert room.owners == {"a": "anna"}
    room.objects = ()
    room.wait(0.7)
    assert room.owners == {}


@pytest.mark.parametrize("has_left", [False, True])
def test_pointing_person_does_not_reverse_an_undo(*, has_left: bool) -> None:
    room = Room(package("a", 5.0))
    room.stay(1.0, 50.0, anna=5.0)
    if has_left:
        room.stay(1.0, 50.0, anna=8.0)
        room.stay(0.2, 50.0, anna=5.0)  # what its gauge did the first time is over
    room.take(room.selecting.undo("anna", room.now_ns))
    room.stay(3.0, 50.0, anna=5.0)
    assert room.told == [("selected", "a", "anna"), ("deselected", "a", "anna")]


def test_release_deselects_any_owners_object_and_sends_them_a_cue() -> None:
    room = Room(package("a", 5.0))
    room.stay(1.0, 50.0, anna=5.0)
    room.take(room.selecting.release("boss", "a", False, room.now_ns))
    assert room.owners == {}
    assert room.told[-1] == ("deselected", "a", "boss")
    assert room.events[-1].cause == "release"
    assert room.cues["anna"][-1].text == "red was released by boss"
    room.take(room.selecting.undo("boss", room.now_ns))
    assert room.owners == {"a": "anna"}
    assert room.told[-1] == ("selected", "a", "anna")


@pytest.mark.parametrize(
    ("object_id", "take_over", "why"),
    [("b", False, "is not selected"), ("nowhere", True, "is not selected"), ("a", True, "is yours already")],
)
def test_impossible_release_is_refused(object_id: str, why: str, *, take_over: bool) -> None:
    room = Room(package("a", 5.0), package("b", 7.0))
    room.stay(1.0, 50.0, anna=5.0)
    room.take(room.selecting.release("anna", object_id, take_over, room.now_ns))
    assert len(room.events) == 1
    assert why in room.cues["anna"][-1].text


def test_selection_survives_a_flicker_of_the_tracker_but_no_departure() -> None:
    room = Room(package("a", 5.0))
    room.stay(1.0, 50.0, anna=5.0)
    objects = room.objects
    for _ in range(5):
        room.objects = ()
        room.stay(0.3, 50.0, anna=5.0)
        room.objects = objects
        room.stay(0.3, 50.0, anna=5.0)

    assert room.told == [("selected", "a", "anna")]
    assert room.owners == {"a": "anna"}
    room.objects = ()
    room.stay(0.6, 50.0, anna=5.0)
    assert room.owners == {}
    assert len(room.events) == 1  # its tracker tells that it left
    assert [(record.event, record.object_id, record.owner) for record in room.records] == [
        ("selected", "a", "anna"),
        ("left", "a", "anna"),
    ]


users = st.sampled_from(["anna", "ben", "carl"])
objects = st.sampled_from(["a", "b", "c"])
PLACES = {"a": 2.0, "b": 5.0, "c": 8.0}


stays = st.tuples(
    st.just("stay"), st.dictionaries(users, objects, max_size=3), st.sampled_from([0.2, 0.7, 1.0])
)
others = st.tuples(
    st.sampled_from(["come", "go", "leave", "return", "wait", "undo", "clear", "release", "take over"]),
    users,
    objects,
)
Doing = tuple[str, dict[str, str], float] | tuple[str, str, str]


def do(room: Room, doing: Doing) -> None:
    now_ns = room.now_ns
    match doing:
        case ("stay", dict() as people, float() as duration_s):
            room.stay(duration_s, 20.0, **{user: PLACES[place] for user, place in people.items()})
        case (what, str() as user, str() as object_id):
            others = [one for one in room.objects if one.id != object_id]
            match what:
                case "come" | "go":
                    room.take(room.selecting.set_present(user, what == "come", now_ns))
                case "leave":
                    room.objects = others
                case "return":
                    room.objects = [*others, package(object_id, PLACES[object_id])]
                case "undo":
                    room.take(room.selecting.undo(user, now_ns))
                case "clear":
                    room.take(room.selecting.clear(user, now_ns))
                case "wait":
                    room.wait(1.5)
                case _:
                    room.take(room.selecting.release(user, object_id, what == "take over", now_ns))
        case _:
            raise AssertionError(doing)


@given(
    st.sampled_from(["gauge", "hold"]),
    st.sampled_from([1.0, 3600.0]),
    st.lists(st.one_of(stays, stays, others), min_size=5, max_size=25),
)
def test_object_has_one_owner_and_events_agree_with_any_actions(
    method: str, ownerless_after_s: float, doings: list[Doing]
) -> None:
    room = Room(
        *(package(object_id, x_m) for object_id, x_m in PLACES.items()),
        method=method,
        ownerless_after_s=ownerless_after_s,
    )
    for doing in doings:
        do(room, doing)
        room.take(room.selecting.tick(room.now_ns))
        ids = [one.id for one in room.selecting.selection(room.now_ns).objects]
        assert len(ids) == len(set(ids))
    room.wait(2.0)

    assert set(room.owners) <= {one.id for one in room.objects}
    for selection in room.selections:
        assert len({one.id for one in selection.objects}) == len(selection.objects)
        assert len({one.id for one in selection.reserved}) == len(selection.reserved)

    story: dict[str, str] = {}
    for record in room.records:
        if record.event == "selected":
            assert record.object_id not in story
            story[record.object_id] = record.owner
        elif record.event in ("deselected", "left"):
            assert story.pop(record.object_id) == record.owner
            if ownerless_after_s == 3600.0 and record.cause in ("dwell", "clear"):
                assert record.user == record.owner
        elif record.owner:  # refused, as another person has it
            assert story[record.object_id] == record.owner != record.user or record.cause == "undo"
    assert room.owners == story

    told = [record.seq for record in room.records if record.seq is not None]
    assert told == [event.seq for event in room.events] == list(range(1, len(told) + 1))
