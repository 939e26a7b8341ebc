"""The last minute of the site as an MCAP recording with JSON messages, for Foxglove and Lichtblick."""

import itertools
import json
from collections import deque
from dataclasses import dataclass
from typing import IO, Any, NamedTuple

from mcap.writer import CompressionType, Writer

from pointit.schemas import NS_PER_S, Message, decode
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name
from pointit.schemas.topics import Delivery, Topic

MAX_MESSAGES = 60_000
"""Limits of messages and bytes; beyond either the oldest are dropped."""
MAX_BYTES = 64 * 1024 * 1024


class _Entry(NamedTuple):
    """A message as received."""

    came_ns: int
    topic: Topic[Any]
    name: str
    stamp_ns: int
    seq: int
    payload: bytes


@dataclass(frozen=True)
class Recording:
    """A snapshot of messages to write."""

    entries: tuple[_Entry, ...]
    """In order of arrival, beginning with the states that were valid when the window began."""
    began_ns: int
    site: str

    def write(self, output: IO[bytes]) -> int:
        """Write compressed MCAP to `output`, and return the number of messages. Slow: call it in a thread."""
        writer = Writer(output, compression=CompressionType.ZSTD)
        writer.start(profile="", library="pointit")
        writer.add_metadata("pointit", {"site": self.site})
        kinds: dict[type[Message], tuple[JsonChannel, int]] = {}
        channels: dict[str, int] = {}
        for entry in self.entries:
            kind: type[Message] = entry.topic.message
            if kind not in kinds:
                plain = JsonChannel(kind)
                text = json.dumps(plain.schema).encode()
                kinds[kind] = plain, writer.register_schema(kind.schema_name(), "jsonschema", text)
            plain, schema = kinds[kind]
            key = entry.topic.at(entry.name)
            channel = channels.get(key)
            if channel is None:
                channel = channels[key] = writer.register_channel(channel_name(key), "json", schema)
            writer.add_message(
                channel,
                log_time=max(entry.stamp_ns, self.began_ns),
                data=plain.to_json(decode(kind, entry.payload)),
                publish_time=entry.stamp_ns,
                sequence=entry.seq % 2**32,
            )
        writer.finish()  # type: ignore[no-untyped-call]  # its annotation leaves `-> None` out
        return len(self.entries)


class LastMinute:
    """Keeps the messages of the last `window_s`, and the newest state of each key before them."""

    def __init__(self, window_s: float, *, most: int = MAX_MESSAGES, max_bytes: int = MAX_BYTES) -> None:
        """Begin empty; a window of 0 keeps states only."""
        self._window_ns = round(window_s * NS_PER_S)
        self._most, self._most_bytes = most, max_bytes
        self._entries: deque[_Entry] = deque()
        self._before: dict[tuple[str, str], _Entry] = {}
        self.bytes = 0
        """Size of the messages in the window."""

    def __len__(self) -> int:
        """Return the number of messages in the window."""
        return len(self._entries)

    def add(self, topic: Topic[Any], name: str, message: Message, payload: bytes, now_ns: int) -> None:
        """Add `message`, received at `now_ns`, and its payload as on the bus."""
        self._entries.append(_Entry(now_ns, topic, name, message.stamp_ns, message.seq, payload))
        self.bytes += len(payload)
        oldest_ns = now_ns - self._window_ns
        entries = self._entries
        while entries and (
            entries[0].came_ns < oldest_ns or len(entries) > self._most or self.bytes > self._most_bytes
        ):
            self._pass(entries.popleft())

    def forget(self, topic: Topic[Any], name: str) -> None:
        """Remove a state whose writer is gone."""
        self._before.pop((topic.key, name), None)

    def recording(self, site: str, now_ns: int) -> Recording:
        """Return the snapshot to write now."""
        oldest_ns = now_ns - self._window_ns
        while self._entries and self._entries[0].came_ns < oldest_ns:
            self._pass(self._entries.popleft())
        entries = tuple(itertools.chain(self._before.values(), self._entries))
        began_ns = self._entries[0].came_ns if self._entries else now_ns
        return Recording(entries, began_ns, site)

    def _pass(self, entry: _Entry) -> None:
        self.bytes -= len(entry.payload)
        if entry.topic.delivery is Delivery.STATE:
            self._before[entry.topic.key, entry.name] = entry


def file_name(site: str, now_ns: int) -> str:
    """Return the file's name."""
    return f"pointit-{site}-{now_ns // NS_PER_S}.mcap"
