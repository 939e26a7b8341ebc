"""The edge of a recorded site: writes and asks again what came from devices, pages and other systems."""

import asyncio
import contextlib
import functools
from typing import Any

from pointit.recording.entries import Entry, Exchange
from pointit.replay.clock import RecordingClock
from pointit.replay.levels import CALLED_BY_SERVICES
from pointit.runtime.bus.contract import AnyTopic, Bus, Closable
from pointit.runtime.errors import RequestError
from pointit.schemas import NS_PER_S, Message, Query
from pointit.schemas.topics import CLOCK, Presence, Request, Topic

GRACE_NS = NS_PER_S // 20
"""Time after a recorded request in which a replayed service may send it itself, ns."""

NEAR_NS = NS_PER_S
"""Largest difference of the times at which a service sent a request then and now, ns."""


class Edge:
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
        row, body = entry.row, entry.body
        if isinstance(row, Topic) and isinstance(body, Message) and row is not CLOCK:
            self.put(row, entry.name, body)
        elif isinstance(row, Presence):
            token = self._tokens.pop(entry.key, None)
            if body is True:
                self._tokens[entry.key] = token or self._bus.announce(row, entry.name)
            elif token is not None:
                token.close()


class RecordedRequests:
    """Asks what was asked by pages, commands and other systems.

    A recording does not tell who asked. What the supervisor asks by itself it asks now, too: such a request
    is asked again only if the replayed supervisor has not sent the same one about that time.
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
        """Note a request that a replayed service has answered."""
        if entry.row not in CALLED_BY_SERVICES or not isinstance(entry.body, Exchange):
            return
        mine = (entry.key, entry.body.query)
        if mine in self._mine:
            self._mine.remove(mine)
        else:
            self._seen.append((entry.time_ns, *mine))

    def repeat(self, entry: Entry) -> None:
        """Ask the recorded request of `entry`, unless a service does."""
        row, body = entry.row, entry.body
        if isinstance(row, Request) and isinstance(body, Exchange):
            self._group.create_task(self._repeat(entry, row, body.query), name=f"replayed {entry.key}")

    async def _repeat(self, entry: Entry, row: Request[Any, Any], query: Query) -> None:
        if row in CALLED_BY_SERVICES:
            await self._clock.wait_until(entry.time_ns + GRACE_NS)
            for seen in self._seen:
                if seen[1:] == (entry.key, query) and abs(seen[0] - entry.time_ns) <= NEAR_NS:
                    self._seen.remove(seen)
                    return
            self._mine.append((entry.key, query))
        with contextlib.suppress(RequestError):  # a refusal is published like a reply
            await self._bus.call(row, query, entry.name)
