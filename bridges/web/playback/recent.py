"""The last minutes of the running site in memory, with the lanes of their timeline."""

import bisect
import functools
import math
import zlib
from array import array
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

from pointit.bridges.web.wire import LaneKind, Timeline, TimelineLane
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
    "interaction",
    "robot",
    "hover",
    "selections",
    "refusals",
    "wrong",
    "misses",
    "warnings",
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
        row = self.row
        body = decode(row.message, self.payload) if isinstance(row, Topic) else bool(self.payload)
        return Entry(self.time_ns, row.at(self.name), row, self.name, body)


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
    if isinstance(entry.body, Message):
        payload = encode(entry.body)
    else:
        payload = b"1" if entry.body else b""
    return Moment(entry.time_ns, entry.row, entry.name, payload)


@functools.lru_cache(maxsize=4096)
def is_shown(key: str) -> bool:
    """Return True if `key` belongs to a row that pages need."""
    for row in SHOWN_ROWS:
        if row.placeholder:
            if row.name_in(key):
                return True
        elif row.key == key:
            return True
    return False


def in_order(moments: dict[Key, Moment], newer: dict[Key, Entry]) -> list[Entry]:
    """Return the entries of both, of each key the newer, in order of time."""
    entries = [moment.entry() for key, moment in moments.items() if key not in newer]
    entries.extend(newer.values())
    return sorted(entries, key=lambda entry: entry.time_ns)


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
        self._show_missing_services(at_ns)
        if isinstance(body, Interaction):
            self._set_interval("interaction", name, "", "" if body.state == "idle" else body.state, at_ns)
        elif isinstance(body, RobotState):
            state = (body.user, body.phase, bool(body.reason))
            self._set_interval(
                "robot", name, instance_of(ROBOT, name), _robot_text(body), at_ns, identity=state
            )
        elif isinstance(body, Hover):
            if body.object_id or ("hover", name, "") in self._open:
                self._set_interval("hover", name, "", self._object_name(body.object_id), at_ns)
        elif isinstance(body, SelectionEvent | ActOutcome):
            self._on_event(self._act_results.event_to_show(body), at_ns)
        elif isinstance(body, Health):
            self._on_health(body, name, at_ns)
        elif isinstance(body, TrackedObjects):
            self._objects[name] = body
        elif isinstance(body, Deployment):
            self._wanted[name] = body.believed(name).target_kinds
        elif isinstance(row, Presence):
            self._on_presence(at_ns, row, name, present=bool(body))

    def forget(self, before_ns: int) -> None:
        """Remove the items that ended before `before_ns`, and the people who left before it."""
        self._until_ns = {user: left_ns for user, left_ns in self._until_ns.items() if left_ns >= before_ns}
        for name, objects in list(self._objects.items()):
            if objects.stamp_ns < before_ns:
                del self._objects[name]

        # Lanes without items, but for those of people who may still be shown
        for (kind, user), items in list(self._items.items()):
            while items and items[0][1] < before_ns:
                items.popleft()
            has_person = kind == "interaction" and user in self._until_ns
            if not items and not has_person:
                del self._items[kind, user]

    def lanes(self, began_ns: int, until_ns: int) -> tuple[TimelineLane, ...]:
        """Return the lanes with items between `began_ns` and `until_ns`, those of people first."""
        # Intervals that have not ended are shown until the end
        items_by_lane = {lane_key: list(items) for lane_key, items in self._items.items()}
        for (kind, user, _), (start_ns, text, _identity) in self._open.items():
            items_by_lane.setdefault((kind, user), []).append((start_ns, until_ns, text))

        def from_start_s(at_ns: int) -> float:
            passed_ns = max(at_ns - began_ns, 0)
            return math.ceil(passed_ns / NS_PER_MS) / 1000.0  # rounded up: a seek to it shows its effect

        lanes: list[TimelineLane] = []
        for kind, user in sorted(items_by_lane, key=_lane_order):
            shown_items: list[tuple[float, float, str]] = []
            for start_ns, end_ns, text in sorted(items_by_lane[kind, user]):
                if end_ns >= began_ns:
                    shown_items.append((from_start_s(start_ns), from_start_s(end_ns), text))
            lanes.append(TimelineLane(kind=kind, user=user, items=tuple(shown_items)))
        return tuple(lanes)

    def _show_missing_services(self, at_ns: int) -> None:
        """Show the services that have left and are still missing after a while."""
        while self._gone and at_ns - self._gone[0][0] > GRACE_NS:
            gone_ns, instance = self._gone.popleft()
            user = person_of(instance)
            self._append_item("warnings", user, (gone_ns, gone_ns, f"{instance} has gone"))

    def _on_presence(self, at_ns: int, row: Presence, name: str, *, present: bool) -> None:
        if row is USER_ALIVE:
            self._until_ns[name] = math.inf if present else at_ns
            if present:
                self._append_item("interaction", name, None)
            else:
                self._end_intervals(name, "", at_ns)
        elif row is SERVICE_ALIVE and not present:
            self._end_intervals("", name, at_ns)
            self._gone.append((at_ns, name))

    def _on_health(self, health: Health, instance: str, at_ns: int) -> None:
        problems = [problem for problem in health.all_problems if problem.severity == "warning"]
        text = ""
        if problems:
            sentences = "; ".join(problem.sentence for problem in problems)
            text = f"{instance}: {sentences}"
        identities = [problem.identity for problem in problems]
        self._set_interval("warnings", health.user, instance, text, at_ns, identity=identities)

    def _on_event(self, event: SelectionEvent | None, at_ns: int) -> None:
        if event is None:
            return
        thing = self._object_name(event.object_id, event.kind)

        # Without wanted kinds, or a kind, nothing is wrong
        wanted: set[str] = set()
        for kinds in self._wanted.values():
            wanted.update(kinds)
        is_wanted = not event.kind or not wanted or event.kind in wanted

        if event.event in ("selected", "deselected"):
            action = "started" if event.status == "pending" else event.event
            self._append_item("selections", event.user, (at_ns, at_ns, f"{action} {thing}"))
            if event.event == "selected" and not is_wanted:
                self._append_item("wrong", event.user, (at_ns, at_ns, f"not wanted: {thing}"))
        elif event.event == "refused":
            reason = f": {event.reason}" if event.reason else ""
            self._append_item("refusals", event.user, (at_ns, at_ns, f"refused {thing}{reason}"))
        elif event.event in ("left", "dispatched") and not event.user:
            if wanted and is_wanted:
                self._append_item("misses", "", (at_ns, at_ns, f"{thing} left without being selected"))

    def _object_name(self, object_id: str, kind: str = "") -> str:
        """Return the name of an object in the page, such as `red 24`, or `""` without an object."""
        if object_id and not kind:
            kind = self._kind_of(object_id)
        if kind == object_id:
            return kind
        number = object_id.rpartition("-")[2]
        return f"{kind} {number}".strip()

    def _kind_of(self, object_id: str) -> str:
        """Return the kind of a tracked object, or `""` if no tracker reports it."""
        for message in self._objects.values():
            for tracked_object in message.objects:
                if tracked_object.id == object_id:
                    return tracked_object.kind
        return ""

    def _set_interval(
        self, kind: LaneKind, user: str, instance: str, text: str, at_ns: int, *, identity: object = None
    ) -> None:
        """End the interval that is open, and begin another one if `text` is not empty.

        `identity` stays the same while only figures of `text` change. None: it is `text`.
        """
        key = (kind, user, instance)
        identity = identity or text
        interval = self._open.get(key)
        if interval is not None:
            begin_ns, open_text, open_identity = interval
            if open_identity == identity:
                return
            del self._open[key]
            self._append_item(kind, user, (begin_ns, at_ns, open_text))
        if text:
            if len(self._open) >= MAX_LANES:
                del self._open[next(iter(self._open))]
            self._open[key] = (at_ns, text[:MAX_TEXT], identity)

    def _end_intervals(self, user: str, instance: str, at_ns: int) -> None:
        """End the open intervals of an instance that has left, or if it is `""` of a person."""
        for kind, open_user, open_instance in list(self._open):
            if open_instance == instance and (instance or open_user == user):
                self._set_interval(kind, open_user, instance, "", at_ns)

    def _append_item(self, kind: LaneKind, user: str, item: Item | None) -> None:
        """Add `item` to its lane, or only create the lane if it is None."""
        if (kind, user) in self._items or len(self._items) < MAX_LANES:
            items = self._items.setdefault((kind, user), deque(maxlen=MAX_ITEMS))
            if item is not None:
                items.append((item[0], item[1], item[2][:MAX_TEXT]))


def _robot_text(state: RobotState) -> str:
    """Return the phase of a robot, its owner and its reason, or `""` while it stands and nobody steers it."""
    is_at_rest = state.phase in ("idle", "landed")
    if is_at_rest and not state.user and not state.reason:
        return ""
    text = state.phase.replace("_", " ")
    if state.user:
        text += f", steered by {state.user}"
    if state.reason:
        text += f": {state.reason}"
    return text


def _lane_order(lane_key: LaneKey) -> tuple[bool, str, int]:
    """Return the place of a lane: those of the site after those of people, in the order of `KINDS`."""
    kind, user = lane_key
    return (not user, user, KINDS.index(kind))


class _Chunk:
    """Consecutive messages, compressed, and the newest of every key before them."""

    def __init__(self, states: dict[Key, Moment], moments: list[Moment]) -> None:
        self.states = states
        self.began_ns = moments[0].time_ns

        # Each key once; the messages have its index, so that they need few bytes besides their payloads
        newest = {(moment.row.key, moment.name): moment for moment in moments}
        indices = {key: index for index, key in enumerate(newest)}
        self._keys = [(moment.row, moment.name) for moment in newest.values()]
        self._times = array("q", [moment.time_ns for moment in moments])
        self._indices = array("H", [indices[moment.row.key, moment.name] for moment in moments])
        self._lengths = array("I", [len(moment.payload) for moment in moments])
        self._packed = zlib.compress(b"".join(moment.payload for moment in moments), 1)

        newest_bytes = sum(len(moment.payload) for moment in newest.values())
        keys = len(states) + len(newest)
        index_bytes = NUMBERS_BYTES * len(moments) + STATE_BYTES * keys
        self.bytes = len(self._packed) + newest_bytes + index_bytes
        """Memory of the chunk, and of its messages in the states of the next one."""

    def moments(self) -> Iterator[Moment]:
        """Yield the messages."""
        data = unpack_zlib(self._packed, sum(self._lengths))
        offset = 0
        for time_ns, index, length in zip(self._times, self._indices, self._lengths, strict=True):
            row, name = self._keys[index]
            yield Moment(time_ns, row, name, data[offset : offset + length])
            offset += length


class Recent:
    """Keeps the messages that pages were shown in the last `window_s`."""

    def __init__(self, site: str, window_s: float = RECENT_WINDOW_S) -> None:
        self._site = site
        self._window_ns = round(window_s * NS_PER_S)
        self._newest: dict[Key, Moment] = {}
        """By key, as far as it is valid now."""
        self._restart(0)

    def _restart(self, at_ns: int) -> None:
        """Begin with the states that are valid, as of `at_ns`."""
        self._last_ns = at_ns
        for key, state in self._newest.items():
            self._newest[key] = state._replace(time_ns=at_ns)

        # All that was kept before is dropped
        self._before: dict[Key, Moment] = {}
        """By key, as far as it was valid before the messages in `_open`."""
        self._chunks: deque[_Chunk] = deque()
        self._open: list[Moment] = []
        """Messages of the chunk that is not closed yet."""
        self._open_bytes = 0
        self._bytes = 0

        # The lanes begin with the states: events happened before
        self._lanes = Lanes()
        for state in self._newest.values():
            is_event = isinstance(state.row, Topic) and state.row.delivery is Delivery.EVENT
            if not is_event:
                self._lanes.add(at_ns, state.row, state.name, state.entry().body)

    def add(self, at_ns: int, row: Row, name: str, body: Message | bool, payload: bytes) -> None:
        """Add a message or a change of presence that came at `at_ns`, site time.

        `payload` is the message as on the bus; of a presence, it is not empty if that has begun.
        """
        # A clock that is set back a little stands until it is there again
        if at_ns < self._last_ns - STEP_NS:
            self._restart(at_ns)
        at_ns = max(at_ns, self._last_ns)
        self._last_ns = at_ns

        key = (row.key, name)
        if key not in self._newest and len(self._newest) >= MAX_KEYS:
            return
        self._lanes.add(at_ns, row, name, body)

        # A chunk begins with the states of before its first message
        if self._open:
            is_long = at_ns - self._open[0].time_ns >= CHUNK_NS
            if is_long or self._open_bytes > MAX_CHUNK_BYTES:
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
        oldest_ns = self._chunks[0].began_ns if self._chunks else ended_ns
        began_ns = max(oldest_ns, ended_ns - self._window_ns)
        length_s = (ended_ns - began_ns) / NS_PER_S
        self._lanes.forget(began_ns)
        timeline = Timeline(
            began_ns=began_ns,
            length_s=length_s,
            read_s=length_s,
            lanes=self._lanes.lanes(began_ns, ended_ns),
        )
        return RecentPast(self._site, list(self._chunks), timeline, ended_ns)

    def _close_chunk(self, now_ns: int) -> None:
        chunk = _Chunk(self._before, self._open)
        self._open = []
        self._open_bytes = 0
        self._chunks.append(chunk)
        self._bytes += chunk.bytes

        # The oldest chunk goes when the next one reaches back to the window's beginning, or beyond
        oldest_ns = now_ns - self._window_ns
        while len(self._chunks) > 1:
            is_needed = self._chunks[1].began_ns > oldest_ns
            if is_needed and self._bytes <= MAX_BYTES:
                break
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
        chunk = self._chunks[self._index_at(at_ns)]
        newest = dict(chunk.states)
        for moment in chunk.moments():
            if moment.time_ns <= at_ns:
                newest[moment.row.key, moment.name] = moment
        moments = sorted(newest.values(), key=lambda moment: moment.time_ns)
        return [moment.entry() for moment in moments]

    def entries(self, after_ns: int) -> Iterator[Entry]:
        """Return the entries later than `after_ns`, in order of time."""
        for chunk in self._chunks[self._index_at(after_ns) :]:
            for moment in chunk.moments():
                if moment.time_ns > after_ns:
                    yield moment.entry()

    def _index_at(self, at_ns: int) -> int:
        """Return the index of the chunk that holds `at_ns`, of the first one if it is earlier."""
        return max(bisect.bisect_right(self._times, at_ns) - 1, 0)

    def timeline(self) -> Timeline:
        """Return the lanes."""
        return self._timeline
