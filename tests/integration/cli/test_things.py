"""`pointit things` against a real bus."""

import asyncio
import json
import signal
from pathlib import Path
from time import time_ns
from typing import Any

from pointit.schemas import (
    ActResult,
    Done,
    Environment,
    ReadHistory,
    ReadHistoryReply,
    SelectionEvent,
    SetThing,
    ThingState,
    ThingStates,
)
from pointit.schemas.environment import Thing
from pointit.schemas.topics import (
    ACT_RESULTS,
    CARRIER_ALIVE,
    MAP,
    READ_HISTORY,
    SELECTION_EVENTS,
    SET_THING,
    THING_STATES,
)
from tests.support.bench import until
from tests.support.cli_site import Site, next_line

PLACE: dict[str, Any] = {"center_m": (1.0, 2.0, 1.0), "size_m": (0.2, 0.2, 0.2)}
SCREWS = Thing(id="screws", strip="shelf", part_m=(0.1, 0.5), label="the screws", **PLACE)
RADIO = Thing(id="radio", mode="switch", lamp="radio_lamp", **PLACE)


def happened(thing: str, event: str, *carriers: str) -> SelectionEvent:
    fields = {"stamp_ns": time_ns(), "event": event, "object_id": thing, "user": "anna", "carriers": carriers}
    return SelectionEvent.model_validate(fields)


async def history(_query: ReadHistory, _name: str) -> ReadHistoryReply:
    told = [("screws", "selected"), ("screws", "deselected"), ("box_7", "selected"), ("radio", "selected")]
    told += [("radio", "deselected"), ("screws", "selected")]
    return ReadHistoryReply(events=tuple(happened(*each) for each in told))


async def test_things_have_their_light_and_how_often_they_fired(site: Site) -> None:
    site.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=(SCREWS, RADIO)))
    ended = await site.pointit("things", "list", "--json")
    assert json.loads(ended.out)["things"][1]["fired"] is None
    assert "the counts of the things are unknown: selector does not answer" in ended.err

    site.bus.serve(READ_HISTORY, history)
    screws = ThingState(id="screws", state="unavailable", reason="no power")
    for name, state in (
        ("first", ThingState(id="screws")),
        ("home", screws),
        ("last", ThingState(id="screws")),
    ):
        site.bus.publisher(THING_STATES, name).put(ThingStates(stamp_ns=1, things=(state,)))

    ended = await site.pointit("things", "list", "--json")
    assert ended.code == 0
    screws_row, radio_row = json.loads(ended.out)["things"]
    assert screws_row == {
        "thing": "screws",
        "label": "the screws",
        "mode": "button",
        "light": "shelf 0.1-0.5 m",
        "state": "unavailable: no power",
        "fired": 2,
    }
    assert (radio_row["light"], radio_row["state"], radio_row["fired"]) == ("radio_lamp", "", 1)


async def test_activations_of_earlier_maps_are_not_counted(site: Site) -> None:
    queries: list[ReadHistory] = []

    async def mixed_history(query: ReadHistory, _name: str) -> ReadHistoryReply:
        queries.append(query)
        events = [happened("screws", "selected").model_copy(update={"stamp_ns": ns}) for ns in (5, 6, 9)]
        return ReadHistoryReply(events=tuple(events))

    site.bus.publisher(MAP).put(Environment(stamp_ns=6, name="shop", things=(SCREWS, RADIO)))
    site.bus.serve(READ_HISTORY, mixed_history)
    ended = await site.pointit("things", "list", "--json")
    assert [query.since_ns for query in queries] == [6]
    assert [row["fired"] for row in json.loads(ended.out)["things"]] == [2, 0]


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


async def test_programs_react_beside_a_running_site_until_they_are_ended(site: Site, tmp_path: Path) -> None:
    told = tmp_path / "told"
    file = tmp_path / "my_site.yaml"
    file.write_text(f"screws: sh -c 'echo {{user}} {{state}} >> {told}'\nradio: [sh -c 'exit 3']\n")
    site.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=(SCREWS, RADIO)))
    events = site.bus.publisher(SELECTION_EVENTS)
    carriers: list[str] = []
    site.bus.watch(CARRIER_ALIVE, lambda name, *, present: carriers.append(name if present else "ended"))
    results: list[ActResult] = []
    site.bus.subscribe(ACT_RESULTS, lambda result, _name: results.append(result))
    async with site.command("things", "react", str(file), "screws=sleep 55") as process:
        assert process.stdout is not None
        assert await process.stdout.readline() == b"reacting to things of map shop; Ctrl-C ends it\n"
        await until(lambda: bool(carriers), what="the carrier")

        for thing in ("screws", "radio"):
            events.put(happened(thing, "selected", *carriers))
        await until(told.is_file, 20)
        assert "radio: sh -c 'exit 3' ended with exit code 3" in await next_line(process.stderr)
        await until(lambda: bool(results), what="the result")
        assert (results[0].object_id, results[0].result) == ("radio", "failed")

        began_s = asyncio.get_running_loop().time()
        process.send_signal(signal.SIGINT)
        lines = (await process.stdout.read()).decode().splitlines()
        assert await process.wait() == 0
        assert asyncio.get_running_loop().time() - began_s < 10.0

    assert told.read_text() == "anna on\n"
    assert lines == ["Acts: 0 done, 2 failed."]
    assert carriers[-1] == "ended"


async def test_reactions_to_things_that_the_map_lacks_are_refused(site: Site) -> None:
    site.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=(SCREWS, RADIO)))
    ended = await site.pointit("things", "react", "scews=true", code=2)
    assert "scews: the map has no thing 'scews'; did you mean screws?" in ended.err
    ended = await site.pointit("things", "react", code=2)
    assert "nothing to do: name a FILE.yaml" in ended.err
