"""The edge of a replay: recorded messages, presences, requests and results of acts, at their times."""

import asyncio
import contextlib
import functools
from collections.abc import Callable
from typing import Any

from pointit.recording.entries import Entry, Exchange
from pointit.replay.replayed_services import CALLED_BY_SERVICES, RecordingClock
from pointit.runtime.bus.contract import AnyTopic, Bus, Closable
from pointit.runtime.errors import RequestError
from pointit.schemas import NS_PER_S, ActResult, BeginAct, Message, Query, SelectionEvent, ThingStates
from pointit.schemas.topics import CLOCK, Presence, Request, Topic

GRACE_NS = NS_PER_S // 20
"""Time after a recorded request in which a replayed service may send it itself, ns."""

NEAR_NS = NS_PER_S
"""Largest difference of the times at which a service sent a request then and now, ns."""


class ReplayEdge:
    """Writes messages and announces presences on a bus."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._publisher = functools.cache(bus.publisher)
        self._tokens: dict[str, Closable] = {}
        """By key: who is present."""

    def put(self, topic: AnyTopic, name: str, message: Message) -> None:
        """Write `message`."""
        self._publisher(topic, name).put(message)

    def repeat(self, entry: Entry) -> None:
        """Write the message of `entry`, or announce or end the presence that it says.

        Nothing is done for a request, and for the clock: the replay has a time of its own.
        """
        row = entry.row
        body = entry.body
        if isinstance(row, Topic) and isinstance(body, Message):
            if row is not CLOCK:
                self.put(row, entry.name, body)
        elif isinstance(row, Presence):
            token = self._tokens.pop(entry.key, None)
            if body is True:
                self._tokens[entry.key] = token or self._bus.announce(row, entry.name)
            elif token is not None:
                token.close()


class RecordedRequests:
    """Repeats the requests of pages, commands and other systems.

    A recording does not name the callers. The supervisor sends its own requests again by itself: such a
    request is repeated only if the replayed supervisor has not sent the same one about that time.
    """

    def __init__(self, bus: Bus, clock: RecordingClock, group: asyncio.TaskGroup) -> None:
        self._bus = bus
        self._clock = clock
        self._group = group
        self._mine: list[tuple[str, Query]] = []
        """Keys and queries of this object's requests that are not answered yet."""
        self._seen: list[tuple[int, str, Query]] = []
        """Times, keys and queries of requests of services that stand for no recorded one yet."""

    def on_answered(self, entry: Entry) -> None:
        """Store a request that a replayed service has answered."""
        if entry.row not in CALLED_BY_SERVICES or not isinstance(entry.body, Exchange):
            return
        request = (entry.key, entry.body.query)
        if request in self._mine:
            self._mine.remove(request)
        else:
            self._seen.append((entry.time_ns, *request))

    def repeat(self, entry: Entry) -> asyncio.Task[None] | None:
        """Ask the recorded request of `entry`, unless a service does. Return the task that waits for it."""
        row = entry.row
        body = entry.body
        if not isinstance(row, Request) or not isinstance(body, Exchange):
            return None
        work = self._repeat(entry, row, body.query)
        return self._group.create_task(work, name=f"replayed {entry.key}")

    async def _repeat(self, entry: Entry, row: Request[Any, Any], query: Query) -> None:
        # A service may send it a little later than when it was recorded
        if row in CALLED_BY_SERVICES:
            await self._clock.wait_until(entry.time_ns + GRACE_NS)
            for seen in self._seen:
                seen_ns, seen_key, seen_query = seen
                is_same = (seen_key, seen_query) == (entry.key, query)
                if is_same and abs(seen_ns - entry.time_ns) <= NEAR_NS:
                    self._seen.remove(seen)
                    return
            self._mine.append((entry.key, query))
        with contextlib.suppress(RequestError):  # a refusal is published like a reply
            await self._bus.call(row, query, entry.name)


class RecordedResults:
    """Publishes the results of acts, each after the event that now stands for the recorded one.

    Before it begins an act, a carrier asks the selector. That question, too, waits for the event, and a
    result waits for the answer.

    Two events stand for each other if they are the first, second, … with carriers on their object.
    """

    def __init__(self, edge: ReplayEdge, ask: Callable[[Entry], asyncio.Task[None] | None]) -> None:
        """Create without events. `ask` sends a recorded request. Its task ends with the answer."""
        self._edge = edge
        self._ask = ask
        self._recorded: dict[str, list[int]] = {}
        """By object, stamps of the recorded events that services publish again, ns."""
        self._again: dict[str, list[int]] = {}
        """The same of the events that they publish now."""
        self._waiting: list[Entry] = []
        self._asked: set[tuple[str, int]] = set()
        """Object and event of the acts whose carrier has no answer yet whether it may begin."""

    def on_recorded(self, entry: Entry) -> None:
        """Store an event of the recording, and pass on what waited for it."""
        if _note_act(self._recorded, entry.body):
            self._repeat_waiting()

    def on_replayed(self, entry: Entry) -> None:
        """Store an event of the replay, and pass on what waited for it."""
        if _note_act(self._again, entry.body):
            self._repeat_waiting()

    def _repeat_waiting(self) -> None:
        waiting = self._waiting
        self._waiting = []
        for entry in waiting:
            self.repeat(entry)

    def repeat(self, entry: Entry) -> None:
        """Publish the result, or ask the question, of `entry`, once its event is published again.

        States of things have the last results, so they wait for the answers to questions, too.
        """
        body = entry.body
        if isinstance(body, ThingStates):
            if self._asked or self._has_question_at(entry.time_ns):
                self._waiting.append(entry)
            else:
                self._edge.repeat(entry)
            return
        act = body.query if isinstance(body, Exchange) else body
        if not isinstance(act, ActResult | BeginAct):
            return
        recorded = self._recorded.get(act.object_id, [])
        again = self._again.get(act.object_id, [])
        if act.event_ns not in recorded:
            if isinstance(body, Exchange):  # its event may be recorded at the same time, and follow
                self._waiting.append(entry)
            else:  # of an event before the beginning, or of the edge
                self._edge.repeat(entry)
            return
        number = recorded.index(act.event_ns)
        if number >= len(again) or (act.object_id, again[number]) in self._asked:
            self._waiting.append(entry)
            return
        act_again = act.model_copy(update={"event_ns": again[number]})
        if isinstance(body, Exchange):
            self._repeat_question(
                entry._replace(body=body.model_copy(update={"query": act_again})), act_again
            )
        elif isinstance(act_again, ActResult):
            self._edge.repeat(entry._replace(body=act_again))

    def _has_question_at(self, time_ns: int) -> bool:
        """Return True if a question of this instant waits for its event."""
        return any(isinstance(other.body, Exchange) and other.time_ns == time_ns for other in self._waiting)

    def _repeat_question(self, entry: Entry, act: ActResult | BeginAct) -> None:
        question = self._ask(entry)
        if question is None:
            return
        key = (act.object_id, act.event_ns)
        self._asked.add(key)
        question.add_done_callback(lambda _: self._on_answered(key))

    def _on_answered(self, act: tuple[str, int]) -> None:
        self._asked.discard(act)
        self._repeat_waiting()


def _note_act(events: dict[str, list[int]], body: object) -> bool:
    """Store the event of an act. Return True if it is new: an event may be published again."""
    if not isinstance(body, SelectionEvent) or not body.carriers:
        return False
    stamps = events.setdefault(body.object_id, [])
    if body.stamp_ns in stamps:
        return False
    stamps.append(body.stamp_ns)
    return True
