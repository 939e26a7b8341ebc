"""Undo and buttons: what a button started cannot be undone, whichever way it went off."""

from collections.abc import Callable

import pytest

from pointit.schemas import Environment, SetThing
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.services.selector.selection_publisher import OutgoingMessage
from tests.unit.selector.room import at
from tests.unit.selector.test_things import Things, thing

End = Callable[[Things], list[OutgoingMessage]]

ENDS: dict[str, End] = {
    "by itself": lambda room: room.engine.tick(at(room.time_s + 2.0)),
    "by clear": lambda room: room.engine.clear("anna", at(room.time_s)),
    "by release": lambda room: room.engine.release("anna", "screws", False, at(room.time_s)),
    "by a take-over": lambda room: room.engine.release("bert", "screws", True, at(room.time_s)),
}
"""Ways in which a button that is shown goes off, or changes its owner."""


def fire(room: Things) -> None:
    room.point(80.0, 0.1)
    room.take(room.engine.set_thing("anna", SetThing(thing="screws"), at(room.time_s)))


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS.keys())
def test_undo_fires_no_button(end: End) -> None:
    room = Things(thing("screws", 1.0))
    fire(room)
    room.take(end(room))
    room.point(80.0, 1.0)
    fired = [event.event for event in room.events].count("selected")

    for user in ("anna", "bert"):
        room.take(room.engine.undo(user, at(room.time_s)))

    assert [event.event for event in room.events].count("selected") == fired
    assert all(text.endswith("there is nothing to take back") for _user, text in room.unclear)
    assert len(room.unclear) == 2


def test_undo_of_clear_gives_back_all_but_the_button() -> None:
    room = Things(thing("radio", mode="switch"), thing("screws", 1.0))
    fire(room)
    room.take(room.engine.set_thing("anna", SetThing(thing="radio"), at(room.time_s)))
    room.take(room.engine.clear("anna", at(room.time_s)))

    room.point(80.0, 1.0)
    room.take(room.engine.undo("anna", at(room.time_s)))

    assert [each.id for each in room.engine.selection(at(room.time_s)).objects] == ["radio"]


def test_undo_does_not_fire_what_has_become_a_button() -> None:
    room = Things(thing("radio", mode="switch"))
    room.point(80.0, 0.1)
    room.take(room.engine.set_thing("anna", SetThing(thing="radio"), at(room.time_s)))
    room.take(room.engine.clear("anna", at(room.time_s)))

    changed = Environment(stamp_ns=0, name="room", things=(thing("radio"),))
    room.take(room.engine.on_objects(TRACKER, listing(changed, at(room.time_s))))
    room.take(room.engine.undo("anna", at(room.time_s)))

    assert room.events[-1].event == "refused"
    assert room.engine.selection(at(room.time_s)).objects == ()
