"""The channels of a recording: the row of the topic table of each, and how its messages are read."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from pointit.recording.container import DamagedError, parse
from pointit.recording.entries import AnyRow, Entry, PresenceChange, body_kind, find_row, schema_name
from pointit.recording.library import Channel as McapChannel
from pointit.recording.library import Opcode, Schema
from pointit.recording.writer import MAX_CHANNELS

MAX_SCHEMAS = 1000
"""Most schemas in a recording: one for each row of the topic table."""

MAX_DESCRIBED_BYTES = 32 * 1024 * 1024
"""Most bytes of all descriptions of channels and schemas."""


class Channel:
    """A channel whose row of the topic table is known."""

    def __init__(self, key: str, row: AnyRow, name: str, written: str) -> None:
        self.key = key
        self.kind: Any = body_kind(row)
        self.is_newer = _is_newer(written, schema_name(row))
        self._row = row
        self._name = name

    def entry(self, time_ns: int, body: Any) -> Entry:
        """Return the entry with `body`, which is of `kind`."""
        if isinstance(body, PresenceChange):
            body = body.present
        return Entry(time_ns, self.key, self._row, self._name, body)


class Channels:
    """The channels by their number in the file."""

    def __init__(self) -> None:
        self._texts: dict[tuple[int, int], bytes] = {}
        """By opcode and number: the record, which may be repeated but not changed."""
        self._bytes = 0
        self._schemas: dict[int, str] = {0: ""}
        self._known: dict[int, Channel] = {}
        self._names: dict[int, str] = {}
        self._counts: Counter[int] = Counter()

    def __getitem__(self, number: int) -> Channel:
        return self._known[number]

    def add(self, opcode: int, content: bytes) -> None:
        """Note what a record in a chunk describes; others than channels and schemas are ignored.

        Raises:
            DamagedError: It is damaged, contradicts an earlier one, or there are too many.
        """
        if opcode not in (Opcode.CHANNEL, Opcode.SCHEMA):
            return
        number = int.from_bytes(content[:2], "little")
        text = self._texts.get((opcode, number))
        if text == content:
            return
        if text is not None:
            raise DamagedError("it gives one number to two channels or schemas")
        self._bytes += len(content)
        if len(self._texts) >= MAX_CHANNELS + MAX_SCHEMAS or self._bytes > MAX_DESCRIBED_BYTES:
            raise DamagedError(
                f"it has more than {MAX_CHANNELS} channels, or {MAX_DESCRIBED_BYTES} bytes about them"
            )
        self._texts[opcode, number] = content
        if opcode == Opcode.SCHEMA:
            self._schemas[number] = parse(content, Schema).name
        else:
            self._add_channel(number, parse(content, McapChannel))

    def count(self, counts: Mapping[int, int]) -> None:
        """Add numbers of messages by the channel's number."""
        self._counts.update(counts)

    def counts(self, *, known: bool) -> dict[str, int]:
        """Return the numbers of messages by key, or by the names of channels that are not known."""
        found: dict[str, int] = {}
        for number, count in self._counts.items():
            if (number in self._known) is known:
                name = self._known[number].key if known else self._names.get(number, f"channel {number}")
                found[name] = found.get(name, 0) + count
        return dict(sorted(found.items()))

    def wanted(self, keys: Callable[[str], bool] | None) -> set[int]:
        """Return the numbers of the known channels whose key `keys` wants."""
        return {number for number, each in self._known.items() if keys is None or keys(each.key)}

    def _add_channel(self, number: int, channel: McapChannel) -> None:
        self._names[number] = channel.topic[:200]
        key = channel.metadata.get("key", "")
        found = find_row(channel.metadata.get("row", ""), key)
        if found is not None and channel.message_encoding == "json":
            written = self._schemas.get(channel.schema_id, "")
            self._known[number] = Channel(key, *found, written)


def _is_newer(written: str, known: str) -> bool:
    """Return True if the schema's name `written` has a higher version than `known` in one of its parts."""
    ours = dict(part.rsplit(".v", 1) for part in known.split("+"))
    for part in written[:300].split("+"):
        name, _, version = part.rpartition(".v")
        # nine digits at most: int() refuses thousands of them, and the writer may be anybody
        if name in ours and version.isdecimal() and len(version) < 10 and int(version) > int(ours[name]):
            return True
    return False
