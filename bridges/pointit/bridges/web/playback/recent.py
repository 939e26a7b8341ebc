"""The last minutes of the running site in memory, compressed, for playback in pages and for download."""

import bisect
import zlib
from array import array
from collections import deque
from collections.abc import Iterator
from typing import Any

from pointit.bridges.web.playback.lanes import Lanes
from pointit.bridges.web.playback.past import Key, Moment
from pointit.bridges.web.wire import Timeline
from pointit.recording.entries import Entry
from pointit.schemas import NS_PER_S, Message
from pointit.schemas.topics import Delivery, Presence, Topic

WINDOW_S = 600.0
"""Time that is kept, s."""

CHUNK_NS = 2 * NS_PER_S
"""Length of a chunk, ns. A seek unpacks one chunk."""

MAX_CHUNK_BYTES = 512 * 1024
"""Length of a chunk in bytes, at which it is closed early: it is compressed between two batches of pages."""

MAX_BYTES = 64 * 1024 * 1024
"""Maximum memory of all chunks. Beyond it, the oldest are dropped."""

MAX_KEYS = 4096
"""Maximum number of keys that are valid at once; messages of more are not kept."""

STEP_NS = NS_PER_S
"""All but the valid states is dropped if the clock is set back by more than this, ns."""

NUMBERS_BYTES = 14
"""Memory of a message besides its payload."""

STATE_BYTES = 64
"""Memory of a key in the states of a chunk."""

Row = Topic[Any] | Presence


class _Chunk:
    """Consecutive messages, compressed, and the newest of every key before them."""

    def __init__(self, states: dict[Key, Moment], moments: list[Moment]) -> None:
        self.states = states
        self.began_ns = moments[0].time_ns
        newest = {(each.row.key, each.name): each for each in moments}
        places = {key: place for place, key in enumerate(newest)}
        self._keys = [(each.row, each.name) for each in newest.values()]
        self._times = array("q", [each.time_ns for each in moments])
        self._places = array("H", [places[each.row.key, each.name] for each in moments])
        self._lengths = array("I", [len(each.payload) for each in moments])
        self._packed = zlib.compress(b"".join(each.payload for each in moments), 1)
        payloads = sum(len(each.payload) for each in newest.values())
        keys = len(states) + len(newest)
        self.bytes = len(self._packed) + payloads + NUMBERS_BYTES * len(moments) + STATE_BYTES * keys
        """Memory of the chunk, and of its messages in the states of the next one."""

    def moments(self) -> Iterator[Moment]:
        """Yield the messages."""
        data, offset = zlib.decompress(self._packed), 0
        for time_ns, place, length in zip(self._times, self._places, self._lengths, strict=True):
            yield Moment(time_ns, *self._keys[place], data[offset : offset + length])
            offset += length


class Recent:
    """Keeps the messages that pages were shown in the last `window_s`."""

    def __init__(self, site: str, window_s: float = WINDOW_S) -> None:
        self._site = site
        self._window_ns = round(window_s * NS_PER_S)
        self._newest: dict[Key, Moment] = {}
        """By key, as far as it is valid now."""
        self._begin(0)

    def _begin(self, at_ns: int) -> None:
        """Begin with the states that are valid, as of `at_ns`."""
        self._last_ns = at_ns
        self._newest = {key: each._replace(time_ns=at_ns) for key, each in self._newest.items()}
        self._before: dict[Key, Moment] = {}
        """By key, as far as it was valid before the messages in `_open`."""
        self._chunks: deque[_Chunk] = deque()
        self._open: list[Moment] = []
        """Messages of the chunk that is not closed yet."""
        self._open_bytes = 0
        self._bytes = 0
        self._lanes = Lanes()
        for each in self._newest.values():
            if not isinstance(each.row, Topic) or each.row.delivery is not Delivery.EVENT:
                self._lanes.add(at_ns, each.row, each.name, each.entry().body)

    def add(self, at_ns: int, row: Row, name: str, body: Message | bool, payload: bytes) -> None:  # noqa: FBT001
        """Add a message or a change of presence that came at `at_ns`, site time.

        `payload` is the message as on the bus; of a presence, it is not empty if that has begun.
        """
        if at_ns < self._last_ns - STEP_NS:
            self._begin(at_ns)
        at_ns = self._last_ns = max(at_ns, self._last_ns)
        key = (row.key, name)
        if key not in self._newest and len(self._newest) >= MAX_KEYS:
            return
        self._lanes.add(at_ns, row, name, body)
        if self._open and (at_ns - self._open[0].time_ns >= CHUNK_NS or self._open_bytes > MAX_CHUNK_BYTES):
            self._close_chunk(at_ns)
        if not self._open:
            self._before = dict(self._newest)
        moment = Moment(at_ns, row, name, payload)
        self._open.append(moment)
        self._open_bytes += NUMBERS_BYTES + len(payload)
        if body is False:
            self._newest.pop(key, None)
        else:
            self._newest[key] = moment

    def forget(self, topic: Topic[Any], name: str) -> None:
        """Remove a state that is no longer valid."""
        self._newest.pop((topic.key, name), None)

    def past(self, now_ns: int) -> "RecentPast":
        """Return the source of a playback of the window until `now_ns`."""
        if self._open:
            self._close_chunk(now_ns)
        ended_ns = max(now_ns, self._last_ns)
        began_ns = max(self._chunks[0].began_ns if self._chunks else ended_ns, ended_ns - self._window_ns)
        self._lanes.forget(began_ns)
        timeline = Timeline(
            began_ns=began_ns,
            length_s=(ended_ns - began_ns) / NS_PER_S,
            read_s=(ended_ns - began_ns) / NS_PER_S,
            lanes=self._lanes.lanes(began_ns, ended_ns),
        )
        return RecentPast(self._site, list(self._chunks), timeline, ended_ns)

    def _close_chunk(self, now_ns: int) -> None:
        chunk = _Chunk(self._before, self._open)
        self._open, self._open_bytes = [], 0
        self._chunks.append(chunk)
        self._bytes += chunk.bytes
        oldest_ns = now_ns - self._window_ns
        while len(self._chunks) > 1 and (self._chunks[1].began_ns <= oldest_ns or self._bytes > MAX_BYTES):
            self._bytes -= self._chunks.popleft().bytes
        self._lanes.forget(oldest_ns)


class RecentPast:
    """Snapshot of the last minutes as the source of playbacks."""

    def __init__(self, site: str, chunks: list[_Chunk], timeline: Timeline, ended_ns: int) -> None:
        self.site = site
        self.began_ns, self.ended_ns, self.read_ns = timeline.began_ns, ended_ns, ended_ns
        self._chunks = chunks
        self._timeline = timeline
        self._times = [chunk.began_ns for chunk in chunks]

    def states_at(self, at_ns: int) -> list[Entry]:
        """Return the newest entry of every key that is not later than `at_ns`, in order of time."""
        if not self._chunks:
            return []
        chunk = self._chunks[max(bisect.bisect_right(self._times, at_ns) - 1, 0)]
        newest = dict(chunk.states)
        for moment in chunk.moments():
            if moment.time_ns <= at_ns:
                newest[moment.row.key, moment.name] = moment
        return [moment.entry() for moment in sorted(newest.values(), key=lambda each: each.time_ns)]

    def entries(self, after_ns: int) -> Iterator[Entry]:
        """Return the entries later than `after_ns`, in order of time."""
        for chunk in self._chunks[max(bisect.bisect_right(self._times, after_ns) - 1, 0) :]:
            for moment in chunk.moments():
                if moment.time_ns > after_ns:
                    yield moment.entry()

    def timeline(self) -> Timeline:
        """Return the lanes."""
        return self._timeline
