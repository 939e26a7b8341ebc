"""`pointit run scenario_4`: packages are selected and dispatched, even when services are killed meanwhile."""

import os
import shlex
import signal
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from pointit.schemas import Selection, SelectionEvent, TrackedObjects
from pointit.schemas.topics import OBJECTS, SELECTION, SELECTION_EVENTS
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands, Onlooker, onlooker, summary_of

TARGET, BAY_SELECTED, BAY_REST = "red", "1", "3"


def listen() -> tuple[str, str]:
    return "--listen", f"tcp/127.0.0.1:{free_port()}"


@dataclass
class Books:
    """The books of an accountant beside the belts."""

    kinds: dict[str, str] = field(default_factory=dict[str, str])
    there: frozenset[str] = frozenset()
    selected: frozenset[str] = frozenset()
    events: list[SelectionEvent] = field(default_factory=list[SelectionEvent])
    listings: int = 0

    def attach(self, seen: Onlooker) -> None:
        seen.bus.subscribe(OBJECTS, lambda message, _tracker: self.on_objects(message))
        seen.bus.subscribe(SELECTION, lambda message, _name: self.on_selection(message))
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: self.events.append(event))

    def on_objects(self, message: TrackedObjects) -> None:
        self.listings += 1
        self.there = frozenset(thing.id for thing in message.objects)
        for thing in message.objects:
            assert self.kinds.setdefault(thing.id, thing.kind) == thing.kind

    def on_selection(self, message: Selection) -> None:
        self.selected = frozenset(thing.id for thing in message.objects)

    def dispatched(self) -> dict[str, set[str]]:
        """Return the bays at which each object came out."""
        bays: dict[str, set[str]] = {}
        for event in self.events:
            if event.event == "dispatched":
                bays.setdefault(event.object_id, set()).add(event.bay)
        return bays

    def gone(self) -> set[str]:
        """Return the objects that cannot be selected any more: they have left, or were deselected."""
        ends = ("dispatched", "deselected", "left")
        return {event.object_id for event in self.events if event.event in ends}

    def owned(self) -> set[str]:
        """Return the objects that are, or were when they left, selected, by the events alone."""
        owned: set[str] = set()
        for event in self.events:
            if event.event == "selected":
                owned.add(event.object_id)
            elif event.event == "deselected":
                owned.discard(event.object_id)
        return owned


async def test_red_packages_leave_at_bay_1_and_the_others_at_bay_3(
    commands: Commands, own_state: Path
) -> None:
    ended = await commands.pointit(
        *("run", "scenario_4", "--speed", "3", "--duration", "75", "--no-view", "--json"), *listen()
    )
    assert ended.code == 0, ended.err
    assert "Traceback" not in ended.err
    summary = summary_of(ended)
    bays = {bay: Counter[str](kinds) for bay, kinds in summary["dispatched"].items()}
    assert set(bays) <= {BAY_SELECTED, BAY_REST}
    assert bays[BAY_SELECTED][TARGET] >= 1, summary
    assert bays[BAY_REST]["blue"] >= 1, summary
    assert bays[BAY_SELECTED]["blue"] == 0, summary
    kept = {path.parent.name for path in (own_state / "lab").glob("*/*.sqlite")}
    assert kept == {"selector", "conveyor-sim"}, (
        "services keep what they must not lose, in the test's own folder"
    )


@pytest.mark.long  # tests/faults kills each service; tests/unit/conveyor_sim kills the conveyor and counts
@pytest.mark.timeout(240)
async def test_selector_and_conveyor_may_be_killed_and_nothing_is_lost_or_told_twice(
    commands: Commands,
) -> None:
    option, endpoint = listen()
    run = commands.start(
        *("run", "scenario_4", "--users", "2", "--processes", "--duration", "600", "--no-view"),
        option,
        endpoint,
    )
    books = Books()
    async with onlooker(endpoint) as seen:
        books.attach(seen)
        await until(lambda: {"selector", "conveyor-sim"} <= set(seen.health), 30, "health")
        await until(lambda: len(books.selected & books.there) >= 1, 60, "a selected package on the belts")

        selected = books.selected
        books.selected = frozenset()
        await restart(commands, run, seen, "selector")
        await until(lambda: bool(books.selected), 20, "the selection again")
        await until(lambda: selected - books.gone() <= books.selected, what="all that was selected, again")

        there = books.there
        listings = books.listings
        await restart(commands, run, seen, "conveyor-sim")
        await until(lambda: books.listings > listings + 25, 20, "the packages again")
        # that a package came out and that it has left the belts are published on different topics
        await until(lambda: there - set(books.dispatched()) <= books.there, what="the packages of before")

        before = len(books.dispatched())
        await until(lambda: len(books.dispatched()) >= before + 4, 90, "packages at the bays after it all")
        await until(
            lambda: set(books.kinds) == {*books.there, *books.dispatched()},
            what="each package to be on the belts or to have come out",
        )
    ended = await run.stop()
    assert ended.code == 0, ended.err

    bays = books.dispatched()
    assert all(len(at) == 1 for at in bays.values()), bays
    owned = books.owned()
    refused = {event.object_id for event in books.events if event.event == "refused"}
    for name, (bay,) in bays.items():
        if name not in refused:
            assert bay == (BAY_SELECTED if name in owned else BAY_REST), name
    assert not {name for name in owned if books.kinds[name] != TARGET}


async def restart(commands: Commands, run: Command, seen: Onlooker, instance: str) -> None:
    """Kill `instance` and start it again as printed by the run."""
    os.kill(seen.health[instance].pid, signal.SIGKILL)
    sentence = f"{instance} was ended by SIGKILL; start it again with: "
    await run.says(sentence)
    (told,) = (line for line in run.logged() if line.startswith(sentence))
    command, _, _ = told.removeprefix(sentence).rpartition(" (its log: ")
    del seen.health[instance]
    commands.run(shlex.split(command))
    await seen.hears(instance)
