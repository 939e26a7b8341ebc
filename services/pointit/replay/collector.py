"""Reader of a bus during a replay: entries of a recording, and messages that services skip."""

import logging
from collections.abc import Callable
from typing import Any

from pointit.recording.entries import Entry, entry_of
from pointit.runtime.bus.contract import AnyTopic, Bus
from pointit.runtime.clock import Clock
from pointit.schemas import Health, Message, ServedRequest
from pointit.schemas.topics import PRESENCES, SERVED, TOPICS, Presence


class Collector:
    """Hands all messages, answered requests and changes of presence on a bus to a function, each of them."""

    def __init__(self, bus: Bus, clock: Clock, take: Callable[[Entry], None]) -> None:
        self._clock = clock
        self._take = take
        self._declared = [
            bus.subscribe(topic, self._reader(topic), every=True) for topic in TOPICS if topic is not SERVED
        ]
        self._declared.append(bus.subscribe(SERVED, self._on_served))
        self._watched = [bus.watch(presence, self._watcher(presence)) for presence in PRESENCES]

    @property
    def dropped(self) -> int:
        """Number of messages that came faster than they were taken, and are missing."""
        return sum(declared.traffic.dropped for declared in self._declared)

    def close(self) -> None:
        """Collect no more."""
        for declared in (*self._declared, *self._watched):
            declared.close()

    def _reader(self, topic: AnyTopic) -> Callable[[Any, str], None]:
        def on_message(message: Message, name: str) -> None:
            self._take(Entry(self._clock.now_ns(), topic.at(name), topic, name, message))

        return on_message

    def _on_served(self, served: ServedRequest, instance: str) -> None:
        found = entry_of(served, instance, self._clock.now_ns())
        if found is not None:
            self._take(found)

    def _watcher(self, presence: Presence) -> Callable[[str, bool], None]:
        def on_change(name: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
            self._take(Entry(self._clock.now_ns(), presence.at(name), presence, name, present))

        return on_change


log = logging.getLogger(__name__)


class Skipped:
    """Numbers of messages that services have not got, or skipped for newer ones, as their health tells."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}
        """By instance and key."""

    def add(self, instance: str, health: Health) -> None:
        """Take a report, whose numbers count from the start of the service."""
        for key in health.keys:
            if key.direction == "in":
                self._counts[instance, key.key] = key.dropped + key.lost

    def log(self) -> None:
        """Log a warning if there are any."""
        if total := sum(self._counts.values()):
            keys = ", ".join(sorted({key for (_, key), count in self._counts.items() if count}))
            log.warning(
                "services skipped %d messages (%s), as this machine is too slow: replay at a lower --speed, "
                "or without --live",
                total,
                keys,
            )
