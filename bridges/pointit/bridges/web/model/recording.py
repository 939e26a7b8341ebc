"""The last minute of the site as a recording that Foxglove and Lichtblick open: MCAP with JSON messages."""

import itertools
import json
from collections import deque
from dataclasses import dataclass
from typing import IO, Any, NamedTuple

from mcap.writer import CompressionType, Writer

from pointit.schemas import NS_PER_S, Message, decode
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name
from pointit.schemas.topics import Delivery, Topic

MOST = 60_000
"""Messages that are kept at most, and their bytes; beyond either the oldest give way."""
MOST_BYTES = 64 * 1024 * 1024


class _Entry(NamedTuple):
    """A message as it came."""

    came_ns: int
    topic: Topic[Any]
    name: str
    stamp_ns: int
    seq: int
    payload: bytes


@dataclass(frozen=True)
class Recording:
    """What is to be written, taken out of what goes on."""

    entries: tuple[_Entry, ...]
    """In order of coming; first those that were true when the window began."""
    began_ns: int
    site: str

    def write(self, output: IO[bytes]) -> int:
        """Write it as MCAP, compressed; return how many messages that were. Takes its time: in a thread."""
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
    """Keeps what came in the last while; of states also the newest that came before, which still hold."""

    def __init__(self, window_s: float, *, most: int = MOST, most_bytes: int = MOST_BYTES) -> None:
        """Begin with nothing; a window of 0 keeps states only."""
        self._window_ns = round(window_s * NS_PER_S)
        self._most, self._most_bytes = most, most_bytes
        self._entries: deque[_Entry] = deque()
        self._before: dict[tuple[str, str], _Entry] = {}
        self.bytes = 0
        """Of the messages in the window."""

    def __len__(self) -> int:
        """Return how many messages the window has."""
        return len(self._entries)

    def add(self, topic: Topic[Any], name: str, message: Message, payload: bytes, now_ns: int) -> None:
        """Take what came at `now_ns`: `message`, and the same as on the bus."""
        self._entries.append(_Entry(now_ns, topic, name, message.stamp_ns, message.seq, payload))
        self.bytes += len(payload)
        oldest_ns = now_ns - self._window_ns
        entries = self._entries
        while entries and (
            entries[0].came_ns < oldest_ns or len(entries) > self._most or self.bytes > self._most_bytes
        ):
            self._pass(entries.popleft())

    def forget(self, topic: Topic[Any], name: str) -> None:
        """Take that a state holds no more: who wrote it is gone."""
        self._before.pop((topic.key, name), None)

    def recording(self, site: str, now_ns: int) -> Recording:
        """Return what is to be written now."""
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
    """Return what the file is called."""
    return f"pointit-{site}-{now_ns // NS_PER_S}.mcap"
