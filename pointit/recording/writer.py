"""Writing a recording: MCAP, zstd, JSON with JSON Schema, chunks that are closed often."""

import json
from typing import IO

from pointit.recording.container import CompressionType, Writer
from pointit.recording.entries import AnyRow, Entry, PresenceChange, body_kind, row_kind, schema_name
from pointit.recording.head import METADATA, Head
from pointit.schemas import NS_PER_S, Message
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name

CHUNK_NS = NS_PER_S // 2
"""Longest time in one chunk, ns: what is lost at most if the writer is killed."""

MAX_CHANNELS = 20_000
"""Maximum number of keys in a recording. An MCAP file can hold 65535."""

MAX_CHUNKS = 10_000
"""Chunks after which a new file should begin, which are one to two hours: the index of each is in memory."""

MAX_FALL_NS = NS_PER_S
"""Largest fall of time within a file, ns."""


class RecordingWriter:
    """Writes one recording to a binary stream, which the caller closes.

    A chunk is closed when it spans half a second, or by `flush`. Every method raises the `OSError` of the
    stream, after which nothing more can be written; what was flushed before stays readable.
    """

    def __init__(self, output: IO[bytes], head: Head) -> None:
        self._output = output
        self._writer = Writer(output, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=f"pointit {head.version}".strip())
        metadata = {"site": head.site, "head": head.model_dump_json()}
        self._writer.add_metadata(METADATA, metadata)
        self._formats: dict[str, tuple[JsonChannel, int]] = {}
        """By name of the schema: its messages' format and its number in the file."""
        self._channels: dict[tuple[int, str], tuple[JsonChannel, int]] = {}
        self._last_ns = 0
        self._chunk_ns: int | None = None
        self._chunks = 0
        self.entries = 0
        """Number of entries written."""
        self.left_out = 0
        """Number of entries that were not written because there are more than `MAX_CHANNELS` keys."""

    @property
    def size(self) -> int:
        """Return the number of bytes written to the stream."""
        return self._output.tell()

    def takes(self, time_ns: int) -> bool:
        """Return False if an entry of `time_ns` belongs in a new file: this is long, or time was set back."""
        return self._chunks < MAX_CHUNKS and time_ns >= self._last_ns - MAX_FALL_NS

    def add(self, entry: Entry) -> None:
        """Write `entry`. One that is older than the last gets the last one's time: time never falls.

        A caller whose time falls by more than a second begins a new file; see `takes`.
        """
        time_ns, key, row, _, body = entry
        channel = self._channels.get((id(row), key))
        if channel is None:
            if len(self._channels) >= MAX_CHANNELS:
                self.left_out += 1
                return
            channel = self._open(row, key)
        json_channel, number = channel
        time_ns = max(time_ns, self._last_ns)
        self._last_ns = time_ns

        # A chunk is closed by time, which limits what is lost if the writer is killed
        if self._chunk_ns is None:
            self._chunk_ns = time_ns
        elif time_ns - self._chunk_ns >= CHUNK_NS:
            self.flush()
            self._chunk_ns = time_ns

        # A presence has no stamp of its own; the field of the sequence has 32 bits
        if isinstance(body, bool):
            published_ns = time_ns
            content = json_channel.to_json(PresenceChange(present=body))
        else:
            published_ns = body.stamp_ns
            content = json_channel.to_json(body)
        sequence = body.seq % 2**32 if isinstance(body, Message) else 0
        self._writer.add_message(number, time_ns, content, published_ns, sequence)
        self.entries += 1

    def flush(self) -> None:
        """Close the chunk and flush the stream: what was added so far is readable."""
        if self._chunk_ns is not None:
            self._chunks += 1
        self._chunk_ns = None
        self._writer.flush()

    def close(self) -> None:
        """Write the index, without which a reader has to search the file. The stream stays open."""
        self._writer.finish()
        self._output.flush()

    def _open(self, row: AnyRow, key: str) -> tuple[JsonChannel, int]:
        name = schema_name(row)
        if name not in self._formats:
            json_channel = JsonChannel(body_kind(row), name)
            text = json.dumps(json_channel.schema).encode()
            schema = self._writer.register_schema(name, "jsonschema", text)
            self._formats[name] = json_channel, schema
        json_channel, schema = self._formats[name]
        metadata = {"key": key, "row": row_kind(row)}
        number = self._writer.register_channel(channel_name(key), "json", schema, metadata)
        self._channels[id(row), key] = json_channel, number
        return json_channel, number
