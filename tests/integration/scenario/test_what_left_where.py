"""Conveyor and selector, stepped together: what is selected leaves by its bay, or is refused at once."""

from collections import deque

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.schemas import ActResult, Cursor, Selection, SelectionEvent, ThingState, ThingStates
from pointit.services.conveyor_sim.feeding import NoRoomError
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import OutgoingMessage, Record
from tests.unit.conveyor_sim.rooms import FORK, S, config

USER = "anna"
STEP_NS = S // 25
STAY = 12
"""Steps on a package: more than it takes to select it."""
CARRIER = "conveyor-sim"
SLOWEST = 5
"""Steps that a selection takes to the conveyor at most: 0.2 s, less than the selector's lead."""


class Hall:
    """A conveyor with two diverters, a person whose cursor is exact, and messages that take a while."""

    def __init__(self, delay: int) -> None:
        belts = config(feeder={"sequence": []}, speed_mps=1.0)
        self.plant = Plant(FORK, belts, seed=0, start_ns=S)
        chosen = SelectorConfig.model_validate({"method": "hold", "window_s": 0.2})
        self.records: list[Record] = []
        self.selecting = SelectionEngine(chosen, self.records.append)
        self.selecting.on_map(FORK)
        self.selecting.on_carrier(CARRIER, True, S)
        self.events: list[SelectionEvent] = []
        self.bays: dict[str, tuple[str, bool]] = {}
        """By package that left: the bay, and whether it was selected just before."""
        self._coming: deque[tuple[int, Selection | SelectionEvent]] = deque()
        self._delay_ns = delay * STEP_NS
        self.names: list[str] = []

    @property
    def owners(self) -> dict[str, str]:
        return {one.id: one.user for one in self.selecting.selection(self.plant.now_ns).objects}

    def step(self, pointed: str = "") -> None:
        now_ns = self.plant.now_ns + STEP_NS
        while self._coming and self._coming[0][0] <= now_ns:
            self._arrive(self._coming.popleft()[1])
        before = self.owners
        for event in self.plant.step(now_ns):
            self.events.append(event)
            if event.event == "dispatched":
                self.bays[event.object_id] = (event.bay, event.object_id in before)
        states = tuple(ThingState(id=name, state="unknown") for name in self.plant.names)
        self.selecting.on_states(CARRIER, ThingStates(stamp_ns=now_ns, things=states), now_ns)
        listed = self.plant.tracked(now_ns)
        self.take(self.selecting.on_objects("conveyor", listed))
        self.take(self.selecting.on_conveyor(self.plant.state(now_ns)))
        cursor = Cursor(stamp_ns=now_ns, surface="none")
        for tracked in listed.objects:
            if tracked.id == pointed and tracked.surface == "belt":
                cursor = Cursor(
                    stamp_ns=now_ns,
                    surface="belt",
                    surface_id=tracked.surface_id,
                    position_m=tracked.surface_position_m,
                    point_m=tracked.position_m,
                )
        self.take(self.selecting.on_cursor(USER, cursor))

    def take(self, outputs: list[OutgoingMessage]) -> None:
        for output in outputs:
            message = output.message
            if isinstance(message, SelectionEvent):
                self.events.append(message)
            if isinstance(message, Selection | SelectionEvent):
                self._coming.append((self.plant.now_ns + self._delay_ns, message))

    def _arrive(self, message: Selection | SelectionEvent) -> None:
        """Pass a message to the conveyor, which tells the result of an act."""
        if isinstance(message, Selection):
            self.plant.select({one.id: one.user for one in message.objects})
        elif message.carriers:
            text = self.plant.refusals.get(message.object_id, "it has left")
            result = ActResult(
                stamp_ns=self.plant.now_ns,
                object_id=message.object_id,
                event_ns=message.stamp_ns,
                result="failed" if text else "done",
                code="refused" if text else "",
                text=text,
            )
            self.take(self.selecting.on_result(CARRIER, result, self.plant.now_ns))

    def do(self, deed: str, number: int) -> None:
        now_ns = self.plant.now_ns
        name = self.names[number % len(self.names)] if self.names else ""
        if deed == "add":
            try:
                self.names.append(self.plant.add("red", "main", 0.3))
            except NoRoomError:
                self.step()
        elif deed == "undo":
            self.take(self.selecting.undo(USER, now_ns))
        elif deed == "clear":
            self.take(self.selecting.clear(USER, now_ns))
        elif deed == "release":
            self.take(self.selecting.release("ben", name, bool(number % 2), now_ns))
        elif deed == "speed":
            self.plant.set_speed((0.0, 0.5, 1.0, 2.0)[number % 4])
        for index in range(STAY + 4 if deed == "point" else 1 + number % 20):
            self.step(name if deed == "point" and index < STAY else "")

    def empty(self) -> None:
        self.plant.set_speed(1.0)
        for _ in range(25 * 60):
            if not self.plant.size:
                break
            self.step()
        self.step()


def deeds(*others: str) -> st.SearchStrategy[list[tuple[str, int]]]:
    kinds = st.sampled_from(["add", "point", "point", "point", *others])
    return st.lists(st.tuples(kinds, st.integers(0, 40)), min_size=6, max_size=25)


def check(hall: Hall) -> None:
    """Fail unless every package left by the bay that its selection says, and the records agree."""
    assert hall.bays.keys() == {*hall.names}
    assert all((bay == "1") == was_selected for bay, was_selected in hall.bays.values()), hall.bays
    assert not hall.owners
    gone = {event.object_id: event for event in hall.events if event.event == "dispatched"}
    closed = {record.object_id: record for record in hall.records if record.event == "left"}
    assert closed.keys() == {name for name, (bay, _) in hall.bays.items() if bay == "1"}
    assert all(record.stamp_ns == gone[name].stamp_ns for name, record in closed.items())
    assert {record.reason for record in closed.values()} <= {"left at bay 1"}


@settings(deadline=None, max_examples=25)
@given(delay=st.integers(0, SLOWEST), script=deeds("undo", "clear", "release"))
@pytest.mark.slow
def test_nothing_is_accepted_for_which_it_is_too_late(delay: int, script: list[tuple[str, int]]) -> None:
    hall = Hall(delay)
    for deed, number in script:
        hall.do(deed, number)
    hall.empty()
    check(hall)
    assert not [event for event in hall.events if event.takes_back]


@settings(deadline=None, max_examples=25)
@given(delay=st.integers(0, 20), script=deeds("undo", "clear", "release", "speed"))
def test_selection_that_comes_too_late_is_corrected(delay: int, script: list[tuple[str, int]]) -> None:
    """Belts that change their speed and slow links break what the conveyor has told; it has the last word."""
    hall = Hall(delay)
    for deed, number in script:
        hall.do(deed, number)
    hall.empty()
    check(hall)
