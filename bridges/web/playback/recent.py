"""The last minutes of the running site in memory, with the lanes of their timeline."""

import bisect
import functools
import math
import zlib
from array import array
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

from pointit.bridges.web.wire import Lane, LaneKind, Timeline
from pointit.recording.entries import AnyRow, Body, Entry
from pointit.runtime.host.unpacking import unpack_zlib
from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    Deployment,
    Health,
    Hover,
    Interaction,
    Message,
    RobotState,
    SelectionEvent,
    TrackedObjects,
    decode,
    encode,
)
from pointit.schemas.system import instance_of
from pointit.schemas.topics import ROBOT_STATE, SERVICE_ALIVE, USER_ALIVE, Delivery, Presence, Topic
from pointit.services.registry import SHOWN, person_of
from pointit.site.site_state import ActResults

Key = tuple[str, str]
"""Key pattern, and what stands for its placeholder."""
LaneKey = tuple[LaneKind, str]
Item = tuple[int, int, str]
"""Start and end, ns, and text."""
Row = Topic[Any] | Presence

SHOWN_ROWS: tuple[Topic[Any] | Presence, ...] = (*SHOWN, SERVICE_ALIVE, USER_ALIVE)
"""Rows of the topic table that pages need."""
NS_PER_MS = 1_000_000

GRACE_NS = 2 * NS_PER_S
"""A service that leaves so shortly before the end is not missing: everything ends, ns."""

MAX_ITEMS = 5000
"""Maximum number of items in a lane; the oldest are dropped."""

MAX_LANES = 256
"""Maximum number of lanes; those of further people are not shown."""

MAX_TEXT = 200
"""Maximum length of an item's text."""

KINDS: tuple[LaneKind, ...] = (
    *("interaction", "robot", "hover", "selections", "refusals", "wrong", "misses", "warnings"),
)
"""In the order in which they are shown."""

ROBOT = ROBOT_STATE.writers[0]
"""Service of a robot, one instance each."""
RECENT_WINDOW_S = 600.0
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


class Moment(NamedTuple):
    """An entry, encoded: a fraction of the size of its message in memory."""

    time_ns: int
    row: Topic[Any] | Presence
    name: str
    payload: bytes
    """The message as on the bus. Of a presence: not empty if it begins."""

    def entry(self) -> Entry:
        """Return it decoded."""
        body = decode(self.row.message, self.payload) if isinstance(self.row, Topic) else bool(self.payload)
        return Entry(self.time_ns, self.row.at(self.name), self.row, self.name, body)


class Past(Protocol):
    """Source of a playback. Times are the site's, ns."""

    site: str
    began_ns: int
    ended_ns: int
    read_ns: int
    """Seeks are possible until then."""

    def states_at(self, at_ns: int) -> list[Entry]:
        """Return the newest entry of every key that is not later than `at_ns`, in order of time."""
        ...

    def entries(self, after_ns: int) -> Iterator[Entry]:
        """Return the entries later than `after_ns`, in order of time."""
        ...

    def timeline(self) -> Timeline:
        """Return the lanes as far as they are read."""
        ...


def moment(entry: Entry) -> Moment:
    """Return `entry`, whose row is in `SHOWN_ROWS`, encoded."""
    assert isinstance(entry.row, (Topic, Presence))  # noqa: S101 - requests are not shown
    payload = encode(entry.body) if isinstance(entry.body, Message) else b"1" if entry.body else b""
    return Moment(entry.time_ns, entry.row, entry.name, payload)


@functools.lru_cache(maxsize=4096)
def is_shown(key: str) -> bool:
    """Return True if `key` belongs to a row that pages need."""
    return any(row.name_in(key) if row.placeholder else row.key == key for row in SHOWN_ROWS)


def in_order(moments: dict[Key, Moment], newer: dict[Key, Entry]) -> list[Entry]:
    """Return the entries of both, of each key the newer, in order of time."""
    kept = [each.entry() for key, each in moments.items() if key not in newer]
    return sorted([*kept, *newer.values()], key=lambda entry: entry.time_ns)


class Lanes:
    """Collects the items of the lanes from entries."""

    def __init__(self) -> None:
        self._items: dict[LaneKey, deque[Item]] = {}
        self._open: dict[tuple[LaneKind, str, str], tuple[int, str, object]] = {}
        """Start, text and identity of intervals without an end yet, by kind, user and instance."""
        self._until_ns: dict[str, float] = {}
        """When each person left, or infinity while they are present."""
        self._gone: deque[tuple[int, str]] = deque(maxlen=MAX_ITEMS)
        """Time and name of services that have left lately."""
        self._act_results = ActResults()
        self._objects: dict[str, TrackedObjects] = {}
        self._wanted: dict[str, tuple[str, ...]] = {}
        """Kinds of objects to select, by deployment."""

    def add(self, at_ns: int, row: AnyRow, name: str, body: Body) -> None:
        """Update the lanes from the fields of an entry; entries come in order of time."""
        self._settle(at_ns)
        if isinstance(body, Interaction):
            self._set("interaction", name, "", "" if body.state == "idle" else body.state, at_ns)
        elif isinstance(body, RobotState):
            state = (body.user, body.phase, bool(body.reason))
            self._set("robot", name, instance_of(ROBOT, name), _robot(body), at_ns, identity=state)
        elif isinstance(body, Hover):
            if body.object_id or ("hover", name, "") in self._open:
                self._set("hover", name, "", self._called(body.object_id), at_ns)
        elif isinstance(body, SelectionEvent | ActOutcome):
            self._on_event(self._act_results.event_to_show(body), at_ns)
        elif isinstance(body, Health):
            problems = [each for each in body.all_problems if each.severity == "warning"]
            text = f"{name}: {'; '.join(each.sentence for each in problems)}" if problems else ""
            self._set("warnings", body.user, name, text, at_ns, identity=[each.identity for each in problems])
        elif isinstance(body, TrackedObjects):
            self._objects[name] = body
        elif isinstance(body, Deployment):
            self._wanted[name] = body.believed(name).target_kinds
        elif isinstance(row, Presence):
            self._on_presence(at_ns, row, name, present=bool(body))

    def forget(self, before_ns: int) -> None:
        """Remove the items that ended before `before_ns`, and the people who left before it."""
        self._until_ns = {user: left_ns for user, left_ns in self._until_ns.items() if left_ns >= before_ns}
        self._objects = {name: each for name, each in self._objects.items() if each.stamp_ns >= before_ns}
        for (kind, user), items in list(self._items.items()):
            while items and items[0][1] < before_ns:
                items.popleft()
            if not items and not (kind == "interaction" and user in self._until_ns):
                del self._items[kind, user]

    def lanes(self, began_ns: int, until_ns: int) -> tuple[Lane, ...]:
        """Return the lanes with items between `began_ns` and `until_ns`, those of people first."""
        items = {key: list(each) for key, each in self._items.items()}
        for (kind, user, _), (start_ns, text, _identity) in self._open.items():
            items.setdefault((kind, user), []).append((start_ns, until_ns, text))

        def from_start(at_ns: int) -> float:
            return math.ceil(max(at_ns - began_ns, 0) / NS_PER_MS) / 1000.0  # who goes there sees its effect

        return tuple(
            Lane(
                kind=kind,
                user=user,
                items=tuple(
                    (from_start(start), from_start(end), text)
                    for start, end, text in sorted(items[kind, user])
                    if end >= began_ns
                ),
            )
            for kind, user in sorted(items, key=lambda key: (not key[1], key[1], KINDS.index(key[0])))
        )

    def _settle(self, at_ns: int) -> None:
        while self._gone and at_ns - self._gone[0][0] > GRACE_NS:
            gone_ns, instance = self._gone.popleft()
            user = person_of(instance)
            self._append_item("warnings", user, (gone_ns, gone_ns, f"{instance} has gone"))

    def _on_presence(self, at_ns: int, row: Presence, name: str, *, present: bool) -> None:
        if row is USER_ALIVE:
            self._until_ns[name] = math.inf if present else at_ns
        if row is USER_ALIVE and present:
            self._append_item("interaction", name, None)
        elif row is USER_ALIVE:
            self._close(name, "", at_ns)
        elif row is SERVICE_ALIVE and not present:
            self._close("", name, at_ns)
            self._gone.append((at_ns, name))

    def _on_event(self, event: SelectionEvent | None, at_ns: int) -> None:
        if event is None:
            return
        what = self._called(event.object_id, event.kind)
        wanted = {kind for kinds in self._wanted.values() for kind in kinds}
        is_wanted = not event.kind or not wanted or event.kind in wanted
        if event.event in ("selected", "deselected"):
            self._append_item("selections", event.user, (at_ns, at_ns, f"{event.event} {what}"))
            if event.event == "selected" and not is_wanted:
                self._append_item("wrong", event.user, (at_ns, at_ns, f"not wanted: {what}"))
        elif event.event == "refused":
            reason = f": {event.reason}" if event.reason else ""
            self._append_item("refusals", event.user, (at_ns, at_ns, f"refused {what}{reason}"))
        elif event.event in ("left", "dispatched") and not event.user and is_wanted and wanted:
            self._append_item("misses", "", (at_ns, at_ns, f"{what} left without being selected"))

    def _called(self, object_id: str, kind: str = "") -> str:
        """Return the name of an object in the page, such as `red 24`, or `""` without an object."""
        if object_id and not kind:
            every = (each for message in self._objects.values() for each in message.objects)
            kind = next((each.kind for each in every if each.id == object_id), "")
        return kind if kind == object_id else f"{kind} {object_id.rpartition('-')[2]}".strip()

    def _set(
        self, kind: LaneKind, user: str, instance: str, text: str, at_ns: int, *, identity: object = None
    ) -> None:
        """End the interval that is open, and begin another one if `text` is not empty.

        `identity` stays the same while only figures of `text` change. None: it is `text`.
        """
        key = (kind, user, instance)
        identity = identity or text
        before = self._open.get(key)
        if before is not None:
            if before[2] == identity:
                return
            del self._open[key]
            self._append_item(kind, user, (before[0], at_ns, before[1]))
        if text:
            if len(self._open) >= MAX_LANES:
                del self._open[next(iter(self._open))]
            self._open[key] = (at_ns, text[:MAX_TEXT], identity)

    def _close(self, user: str, instance: str, at_ns: int) -> None:
        """End the open intervals of a service that has gone, or without one those of a person who has."""
        for kind, its_user, its_instance in list(self._open):
            if its_instance == instance and (instance or its_user == user):
                self._set(kind, its_user, instance, "", at_ns)

    def _append_item(self, kind: LaneKind, user: str, item: Item | None) -> None:
        """Add `item` to its lane, or only create the lane if it is None."""
        if (kind, user) in self._items or len(self._items) < MAX_LANES:
            items = self._items.setdefault((kind, user), deque(maxlen=MAX_ITEMS))
            if item is not None:
                items.append((item[0], item[1], item[2][:MAX_TEXT]))


def _robot(state: RobotState) -> str:
    """Return the phase of a robot, its owner and its reason, or `""` while it stands and nobody steers it."""
    if not state.user and not state.reason and state.phase in ("idle", "landed"):
        return ""
    does = state.phase.replace("_", " ")
    return ": ".join(filter(None, (f"{does}, steered by {state.user}" if state.user else does, state.reason)))


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
        data = unpack_zlib(self._packed, sum(self._lengths))
        offset = 0
        for time_ns, place, length in zip(self._times, self._places, self._lengths, strict=True):
            yield Moment(time_ns, *self._keys[place], data[offset : offset + length])
            offset += length


class Recent:
    """Keeps the messages that pages were shown in the last `window_s`."""

    def __init__(self, site: str, window_s: float = RECENT_WINDOW_S) -> None:
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

    def add(self, at_ns: int, row: Row, name: str, body: Message | bool, payload: bytes) -> None:
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
        self._open = []
        self._open_bytes = 0
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
        self.began_ns = timeline.began_ns
        self.ended_ns = ended_ns
        self.read_ns = ended_ns
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
