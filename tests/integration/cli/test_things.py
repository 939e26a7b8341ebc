"""`pointit things` against a real bus."""

import json
from typing import Any

from pointit.schemas import Done, Environment, ReadHistory, ReadHistoryReply, SelectionEvent, SetThing
from pointit.schemas.environment import Thing
from pointit.schemas.topics import MAP, READ_HISTORY, SET_THING
from tests.support.cli_site import Site

PLACE: dict[str, Any] = {"center_m": (1.0, 2.0, 1.0), "size_m": (0.2, 0.2, 0.2)}
SCREWS = Thing(id="screws", strip="shelf", part_m=(0.1, 0.5), label="the screws", **PLACE)
RADIO = Thing(id="radio", mode="switch", lamp="radio_lamp", **PLACE)


def happened(thing: str, event: str) -> SelectionEvent:
    return SelectionEvent.model_validate({"stamp_ns": 1, "event": event, "object_id": thing, "user": "anna"})


async def history(_query: ReadHistory, _name: str) -> ReadHistoryReply:
    told = [("screws", "selected"), ("screws", "deselected"), ("box_7", "selected"), ("radio", "selected")]
    told += [("radio", "deselected"), ("screws", "selected")]
    return ReadHistoryReply(events=tuple(happened(*each) for each in told))


async def test_things_have_their_light_and_how_often_they_fired(site: Site) -> None:
    site.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=(SCREWS, RADIO)))
    ended = await site.pointit("things", "list", "--json")
    assert json.loads(ended.out)["things"][1]["fired"] is None
    assert "how often things fired is unknown: selector does not answer" in ended.err
    site.bus.serve(READ_HISTORY, history)
    ended = await site.pointit("things", "list", "--json")
    assert ended.code == 0
    assert json.loads(ended.out)["things"] == [
        {"thing": "screws", "label": "the screws", "mode": "button", "light": "shelf 0.1-0.5 m", "fired": 2},
        {"thing": "radio", "label": "radio", "mode": "switch", "light": "radio_lamp", "fired": 1},
    ]


async def test_map_without_things_is_said(site: Site) -> None:
    site.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop"))
    ended = await site.pointit("things", "list")
    assert ended.code == 1
    assert "the map shop has no things; add a section `things`" in ended.err


async def test_thing_is_tried_without_pointing(site: Site) -> None:
    asked: list[tuple[str, SetThing]] = []

    async def answer(query: SetThing, user: str) -> Done:
        asked.append((user, query))
        return Done(message="the screws screws selected")

    site.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=(SCREWS, RADIO)))
    ended = await site.pointit("things", "try", "screws")
    assert ended.code == 1
    assert "selector does not answer" in ended.err
    site.bus.serve(SET_THING, answer)
    ended = await site.pointit("things", "try", "screws")
    assert (ended.code, ended.out.strip()) == (0, "the screws screws selected")
    await site.pointit("things", "try", "radio", "--off", "--user", "anna")
    assert asked == [("operator", SetThing(thing="screws")), ("anna", SetThing(thing="radio", on=False))]
    ended = await site.pointit("things", "try", "scews")
    assert "the map has no thing 'scews'; did you mean screws?" in ended.err
