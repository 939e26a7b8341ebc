"""Reading a recording, whole or cut off, own or hostile, in bounded memory."""

import functools
import operator
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

from pointit.recording import container
from pointit.recording.container import Channel as McapChannel
from pointit.recording.container import Chunk, DamagedError, Metadata, Opcode, RecordLocation, Schema, parse
from pointit.recording.entries import (
    AnyRow,
    Entry,
    PresenceChange,
    RecordingError,
    body_kind,
    find_row,
    schema_name,
)
from pointit.recording.head import FORMAT, METADATA, Head
from pointit.recording.writer import MAX_CHANNELS
from pointit.schemas import NS_PER_S, DecodeError
from pointit.schemas.catalogue.json_channel import from_json
from pointit.schemas.text import first_problem, system_reason

MAX_SCHEMAS = 1000
"""Maximum number of schemas in a recording: one for each row of the topic table."""

MAX_DESCRIBED_BYTES = 32 * 1024 * 1024
"""Maximum bytes of all descriptions of channels and schemas."""

MAX_CHUNKS = 1_000_000
"""Maximum number of chunks that are read of a recording: more than five days."""

MAX_DAMAGED = 1000
"""Maximum number of damaged chunks before a file counts as no recording."""


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
        """Store the channel or schema that a record in a chunk describes; other records are ignored.

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
        is_full = len(self._texts) >= MAX_CHANNELS + MAX_SCHEMAS
        if is_full or self._bytes > MAX_DESCRIBED_BYTES:
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
        totals: dict[str, int] = {}
        for number, count in self._counts.items():
            if (number in self._known) is not known:
                continue
            if known:
                name = self._known[number].key
            else:
                name = self._names.get(number, f"channel {number}")
            totals[name] = totals.get(name, 0) + count
        return dict(sorted(totals.items()))

    def wanted(self, keys: Callable[[str], bool] | None) -> set[int]:
        """Return the numbers of the known channels whose key `keys` wants."""
        if keys is None:
            return set(self._known)
        return {number for number, channel in self._known.items() if keys(channel.key)}

    def _add_channel(self, number: int, channel: McapChannel) -> None:
        self._names[number] = channel.topic[:200]
        key = channel.metadata.get("key", "")
        match = find_row(channel.metadata.get("row", ""), key)
        if match is not None and channel.message_encoding == "json":
            row, name = match
            written = self._schemas.get(channel.schema_id, "")
            self._known[number] = Channel(key, row, name, written)


def _is_newer(written: str, known: str) -> bool:
    """Return True if the schema's name `written` has a higher version than `known` in one of its parts."""
    ours = dict(part.rsplit(".v", 1) for part in known.split("+"))
    for part in written[:300].split("+"):
        name, _, version = part.rpartition(".v")
        # nine digits at most: int() refuses thousands of them, and the writer may be anybody
        is_number = version.isdecimal() and len(version) < 10
        if name not in ours or not is_number:
            continue
        if int(version) > int(ours[name]):
            return True
    return False


class _ChunkPlace(NamedTuple):
    place: RecordLocation
    began_ns: int
    ended_ns: int


class Recording:
    """A recording on disk. Opening it scans the file once, and so does each call of `entries`."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self._path = path
        self._file = file
        self._channels = Channels()
        self._chunks: list[_ChunkPlace] = []
        self.problem = ""
        """Sentence about missing or damaged parts, else `""`."""
        self.invalid = 0
        """Number of entries that the last call of `entries` left out so far, as they are not valid."""
        self.first_error = ""
        """Error message about the first of them, or `""`."""
        # All chunks, with damaged ones between them. The head comes first: its format says how to read them
        head: Head | None = None
        damaged: list[DamagedError] = []
        try:
            for place in container.data_blocks(container.records(file)):
                if place.opcode == Opcode.METADATA and head is None:
                    head = self._read_head(place)
                elif place.opcode in (Opcode.CHUNK, container.UNCHUNKED):
                    if head is None:
                        break
                    self._try_search(place, damaged)
                elif place.opcode == container.DAMAGED:
                    damaged.append(DamagedError("it is damaged between two chunks"))
                elif damaged:  # the channels may have been described in what is damaged
                    self._channels.add(place.opcode, container.content(file, place))
        except DamagedError as error:
            damaged.append(error)
        if head is None:
            reason = f" ({damaged[0]})" if damaged else ""
            raise RecordingError(
                f"{path} is no recording of PointIt{reason}: give a file of `pointit record`; of a ROS 2 "
                "bag, `pointit import` makes one"
            )

        # Its time, by the chunks: the head says when it was begun, not what is left of it
        self.head = head
        self.began_ns = min((chunk.began_ns for chunk in self._chunks), default=head.began_ns)
        """Site time of the first entry, ns."""
        self.ended_ns = max((chunk.ended_ns for chunk in self._chunks), default=head.began_ns)
        """Site time of the last entry, ns."""
        self.lost = sum(self.unknown.values()) if damaged else 0
        """Number of messages of which nothing is known, as the description of their keys is damaged."""
        if damaged:
            length_s = (self.ended_ns - self.began_ns) / NS_PER_S
            lost = f"; messages that have lost their description: {self.lost}" if self.lost else ""
            damage = first_problem([str(error) for error in damaged])
            rest = f"What is intact of its {length_s:.1f} s can be used{lost}"
            self.problem = f"{path} is not whole: {damage}. {rest}"

    @classmethod
    def open(cls, path: Path) -> "Recording":
        """Return the recording in the file `path`.

        Raises:
            RecordingError: There is no such file, or it is none of PointIt, or of a newer format.
        """
        try:
            file = path.open("rb")
            try:
                if not container.is_container(file):
                    kind = "MCAP" if path.stat().st_size else "it is empty"
                    raise RecordingError(  # noqa: TRY301
                        f"{path} is no recording ({kind}): give a file that PointIt recorded"
                    )
                return cls(path, file)
            except BaseException:
                file.close()
                raise
        except OSError as error:
            problem = system_reason(error)
            raise RecordingError(f"{path} cannot be read: {problem}") from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @functools.cached_property
    def counts(self) -> Mapping[str, int]:
        """Number of entries by key."""
        return self._channels.counts(known=True)

    @functools.cached_property
    def unknown(self) -> Mapping[str, int]:
        """Number of entries by the name of a channel that belongs to no row of the topic table."""
        return self._channels.counts(known=False)

    def gap(self, longer_ns: int) -> tuple[int, int] | None:
        """Return start and end of the first time without entries longer than `longer_ns`; site time, ns."""
        last_ns = self.began_ns
        for chunk in sorted(self._chunks, key=lambda chunk: chunk.began_ns):
            for time_ns in (chunk.began_ns, chunk.ended_ns):  # a recorder's chunk spans half a second
                if time_ns - last_ns > longer_ns:
                    return last_ns, time_ns
                last_ns = max(last_ns, time_ns)
        return None

    def entries(
        self,
        keys: Callable[[str], bool] | None = None,
        since_ns: int | None = None,
        until_ns: int | None = None,
    ) -> Iterator[Entry]:
        """Yield the entries in order of time, those of one time in order of the file.

        Args:
            keys: returns True for the keys that are wanted; all by default.
            since_ns: site time of the first, ns.
            until_ns: site time before which they are, ns.

        Entries that are not valid are left out and counted in `invalid`.
        """
        self.invalid = 0
        self.first_error = ""
        wanted = self._channels.wanted(keys)
        since_ns = self.began_ns if since_ns is None else since_ns
        until_ns = self.ended_ns + 1 if until_ns is None else until_ns
        for chunk in self._chunks:
            if chunk.ended_ns < since_ns or chunk.began_ns >= until_ns:
                continue

            # Times first: contents are decoded only of entries that are wanted
            try:
                data, records = self._unpack(chunk.place)
                times: list[tuple[int, RecordLocation, int]] = []
                for place in records:
                    if place.opcode == Opcode.MESSAGE:
                        channel, time_ns = container.message_times(data, place)
                        if channel in wanted and since_ns <= time_ns < until_ns:
                            times.append((time_ns, place, channel))
            except DamagedError as error:  # it was changed since it was opened
                self._reject(str(error))
                continue

            # The sort is stable: entries of one time stay in order
            times.sort(key=operator.itemgetter(0))
            for time_ns, place, channel in times:
                content = container.message_content(data, place)
                entry = self._entry(channel, time_ns, content)
                if entry is not None:
                    yield entry

    def _entry(self, number: int, time_ns: int, content: bytes) -> Entry | None:
        channel = self._channels[number]
        try:
            body: Any = from_json(channel.kind, content, newer=channel.is_newer)
        except DecodeError as error:
            self._reject(f"{channel.key}: {error}")
            return None
        return channel.entry(time_ns, body)

    def _reject(self, error_message: str) -> None:
        self.invalid += 1
        self.first_error = self.first_error or error_message

    def _read_head(self, place: RecordLocation) -> Head | None:
        """Return the head if the metadata at `place` are those of PointIt.

        Raises:
            RecordingError: They are of a newer format, or are no head.
        """
        metadata = container.read(self._file, place, Metadata)
        if metadata.name != METADATA:
            return None
        try:
            text = metadata.metadata.get("head", "")
            head = from_json(Head, text.encode(), newer=True)
        except DecodeError as error:
            raise RecordingError(f"{self._path} is no recording of PointIt: {error}") from error
        if head.format > FORMAT:
            version = head.version[:32]
            raise RecordingError(
                f"{self._path} was written by a newer PointIt ({version}): update yours to read it"
            )
        return head

    def _unpack(self, place: RecordLocation) -> tuple[bytes, Iterator[RecordLocation]]:
        """Return the content of the chunk at `place` and where its records are, which are still to be read.

        Records outside of chunks are their own content.

        Raises:
            DamagedError: It is too large, or is none.
        """
        if place.opcode == container.UNCHUNKED:
            data = container.content(self._file, place)
            return data, container.unchunked_records(data)
        chunk = container.read(self._file, place, Chunk)
        data = container.unpack(chunk)
        return data, container.inner_records(chunk, data)

    def _try_search(self, place: RecordLocation, damaged: list[DamagedError]) -> None:
        """Search the chunk at `place`, or add what is wrong with it to `damaged`.

        Raises:
            DamagedError: There are too many chunks.
            RecordingError: Too many are damaged.
        """
        if len(self._chunks) >= MAX_CHUNKS:
            raise DamagedError(f"it has more than {MAX_CHUNKS} chunks")
        try:
            self._search(place)
        except DamagedError as error:
            damaged.append(error)
            if len(damaged) > MAX_DAMAGED:
                raise RecordingError(f"{self._path} cannot be read: {error}") from error

    def _search(self, place: RecordLocation) -> None:
        data, records = self._unpack(place)
        counts: Counter[int] = Counter()
        began_ns = 2**64
        ended_ns = -1
        for inner in records:
            if inner.opcode == Opcode.MESSAGE:
                channel, time_ns = container.message_times(data, inner)
                if time_ns >= 2**63:
                    raise DamagedError(f"a chunk of it is damaged: the time {time_ns} ns is beyond 64 bits")
                counts[channel] += 1
                began_ns = min(began_ns, time_ns)
                ended_ns = max(ended_ns, time_ns)
            else:
                self._channels.add(inner.opcode, data[inner.offset : inner.offset + inner.length])
        self._channels.count(counts)
        if counts:
            self._chunks.append(_ChunkPlace(place, began_ns, ended_ns))
