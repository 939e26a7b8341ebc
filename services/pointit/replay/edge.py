"""The edge of a recorded site: writes again what came from devices, trackers, pages and other systems."""

from typing import Any

from pointit.recording.entries import Entry
from pointit.runtime.bus.contract import AnyTopic, Bus, Closable, Publisher
from pointit.schemas import Message
from pointit.schemas.topics import CLOCK, Presence, Topic


class Edge:
    """Writes messages and announces presences on a bus."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._publishers: dict[str, Publisher[Any]] = {}
        """By key."""
        self._tokens: dict[str, Closable] = {}
        """By key: who is present."""

    def put(self, topic: AnyTopic, name: str, message: Message) -> None:
        """Write `message`."""
        key = topic.at(name)
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self._bus.publisher(topic, name)
        publisher.put(message)

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
