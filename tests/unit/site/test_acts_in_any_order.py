"""200 acts of a real selector's core, told in any order that a bus permits: no reader tells a false success.

Messages of one key come in order, each up to 2 s late; two keys have no common order.
"""

import random
from typing import Any

import pytest

from pointit.bridges.foxglove.objects import ObjectOwnership
from pointit.schemas import ActOutcome, Message, Selection, SelectionEvent, ThingState, topics
from pointit.services.selector.selection_publisher import OutgoingMessage
from pointit.site.site_state import Change, SiteState
from tests.unit.selector.room import at
from tests.unit.selector.test_acts import LAMP, Home, restarted

ACTS = 200
MAX_LATE_S = 2.0
BELL = ThingState(id="screws")
TOPICS: dict[type[Message], Any] = {
    Selection: topics.SELECTION,
    SelectionEvent: topics.SELECTION_EVENTS,
    ActOutcome: topics.OUTCOMES,
}
Act = tuple[str, int]
"""Object and stamp of its event."""


class Wire(Home):
    """A home whose messages are kept with the times at which they were sent."""

    def __init__(self, *states: ThingState) -> None:
        self.sent: list[tuple[float, Message]] = []
        self.told_s: dict[tuple[Act, str], float] = {}
        """Time of each outcome, by its act and status."""
        super().__init__(*states)

    def take(self, outputs: list[OutgoingMessage]) -> None:
        super().take(outputs)
        for _user, message in outputs:
            if type(message) in TOPICS:
                self.sent.append((self.time_s, message))
            if isinstance(message, ActOutcome):
                act = message.object_id, message.event_ns
                self.told_s.setdefault((act, message.status), self.time_s)

    def is_told(self, act: Act, time_s: float, *statuses: str) -> bool:
        """Return True if the act was told as one of `statuses` by then."""
        return any(self.told_s.get((act, status), time_s + 1.0) <= time_s for status in statuses)


def live(wire: Wire, choice: random.Random) -> None:
    """Ask for 200 acts, which end in every way; sometimes the carrier or the selector is killed."""
    people = ("anna", "bert", "carl")
    while len(wire.acts) < ACTS:
        asked = len(wire.acts)
        wire.set(choice.choice(("lamp", "screws")), choice.choice(people))
        wire.point(80.0, choice.uniform(0.02, 0.1))
        if len(wire.acts) == asked:  # refused
            wire.point(80.0, 0.7)
            continue
        act = wire.acts[-1]
        wanted = "on" if act.is_on else "off"
        state = {"state": wanted} if act.object_id == "lamp" else {}
        fate = choice.random()
        if fate < 0.2:
            wire.tell("started", event=act)
            wire.point(80.0, 0.1)
        if fate < 0.05:
            restarted(wire)
            wire.report(LAMP, BELL)
            wire.take(wire.engine.on_carrier("home", True, at(wire.time_s)))
        if fate < 0.5:
            wire.tell("done", event=act, **state)
        elif fate < 0.8:
            other = {"state": "off" if wanted == "on" else "on"} if state else {}
            wire.tell("failed", event=act, code="error", text="no power", **other)
        elif fate < 0.85:
            wire.take(wire.engine.on_carrier("home", False, at(wire.time_s)))
            wire.take(wire.engine.on_carrier("home", True, at(wire.time_s)))
        elif fate < 0.9:
            wire.point(80.0, 6.5)  # no answer in time
        # else the next act replaces it
    wire.point(80.0, 7.0)


def deliveries(wire: Wire, choice: random.Random) -> list[tuple[float, Message]]:
    """Return the messages with the times of their arrival."""
    last_s: dict[type[Message], float] = {}
    arrived: list[tuple[float, Message]] = []
    for sent_s, message in wire.sent:
        kind = type(message)
        arrival_s = max(sent_s + choice.uniform(0.0, MAX_LATE_S), last_s.get(kind, 0.0))
        last_s[kind] = arrival_s
        arrived.append((arrival_s, message))
    return sorted(arrived, key=lambda item: item[0])


class Readers:
    """What all screens are made of: the state of the site with its events, and the selection."""

    def __init__(self, wire: Wire) -> None:
        self.site = SiteState(self._on_change)
        self.successes = 0
        self._wire = wire
        self._time_s = 0.0
        self._carried: set[Act] = set()
        for event in wire.acts:
            if not event.takes_back:
                self._carried.add((event.object_id, event.stamp_ns))

    def read(self, time_s: float, message: Message) -> None:
        """Read a message, and check what is told after it."""
        self._time_s = time_s
        topic = TOPICS[type(message)]
        self.site.take(topic, "", message, time_s)
        selection = self.site.get(topics.SELECTION)
        if selection is not None:
            self._check_objects(selection)
            self._check_acts(selection)

    def _on_change(self, change: Change) -> None:
        """Check an event of the page, the log of Foxglove, ROS, metrics and exports."""
        event = change.message
        if not isinstance(event, SelectionEvent) or event.event == "refused":
            return
        act = event.object_id, event.stamp_ns
        if act in self._carried:
            self.successes += 1
            assert event.status in ("done", "pending")
            assert self._wire.is_told(act, self._time_s, event.status), f"{event} at {self._time_s} s"

    def _check_objects(self, selection: Selection) -> None:
        for item in selection.settled:
            act = item.id, item.since_ns
            if act not in self._carried:
                continue
            statuses = ["done", "pending"]
            if item.id == "lamp":  # its target may report that it is on, although it told a failure
                statuses += ["failed", "unanswered"]
            assert self._wire.is_told(act, self._time_s, *statuses), f"{item} at {self._time_s} s"
        owners = ObjectOwnership.of(selection, {}).owners
        assert set(owners) == {item.id for item in selection.settled}

    def _check_acts(self, selection: Selection) -> None:
        for state in selection.acts:
            act = state.object_id, state.event_ns
            if state.status in ("asked", "pending"):
                assert state.object_id in selection.under_way
            if state.status in ("done", "pending") and act in self._carried:
                assert self._wire.is_told(act, self._time_s, state.status), f"{state} at {self._time_s} s"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_no_reader_tells_a_false_success_of_acts(seed: int) -> None:
    choice = random.Random(seed)
    wire = Wire(LAMP, BELL)
    live(wire, choice)

    readers = Readers(wire)
    for time_s, message in deliveries(wire, choice):
        readers.read(time_s, message)

    assert readers.successes > ACTS / 4
    assert {status for (_act, status) in wire.told_s} == {"done", "pending", "failed", "unanswered"}
