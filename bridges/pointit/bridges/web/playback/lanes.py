"""Lanes of a timeline: states, hovers, selections, refusals, misses and warnings of each person; pure."""

import math
import re
from collections import deque

from pointit.bridges.web.wire import Lane, LaneKind
from pointit.recording.entries import AnyRow, Body
from pointit.schemas import (
    NS_PER_S,
    Deployment,
    Health,
    Hover,
    Interaction,
    RobotState,
    SelectionEvent,
    TrackedObjects,
)
from pointit.schemas.system import instance_of
from pointit.schemas.topics import ROBOT_STATE, SERVICE_ALIVE, USER_ALIVE, Presence
from pointit.services.registry import person_of

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

NUMBERS = re.compile(r"\d+([.,]\d+)*")

LaneKey = tuple[LaneKind, str]
Item = tuple[int, int, str]
"""Start and end, ns, and text."""


class Lanes:
    """Collects the items of the lanes from entries."""

    def __init__(self) -> None:
        self._items: dict[LaneKey, deque[Item]] = {}
        self._open: dict[tuple[LaneKind, str, str], tuple[int, str]] = {}
        """Start and text of intervals without an end yet, by kind, user and instance."""
        self._until_ns: dict[str, float] = {}
        """When each person left, or infinity while they are present."""
        self._gone: deque[tuple[int, str]] = deque(maxlen=MAX_ITEMS)
        """Time and name of services that have left lately."""
        self._objects: dict[str, TrackedObjects] = {}
        self._wanted: dict[str, tuple[str, ...]] = {}
        """Kinds of objects to select, by deployment."""

    def add(self, at_ns: int, row: AnyRow, name: str, body: Body) -> None:
        """Update the lanes from the fields of an entry; entries come in order of time."""
        self._settle(at_ns)
        if isinstance(body, Interaction):
            self._set("interaction", name, "", "" if body.state == "idle" else body.state, at_ns)
        elif isinstance(body, RobotState):
            self._set("robot", name, instance_of(ROBOT, name), _robot(body), at_ns)
        elif isinstance(body, Hover):
            if body.object_id or ("hover", name, "") in self._open:
                self._set("hover", name, "", self._called(body.object_id), at_ns)
        elif isinstance(body, SelectionEvent):
            self._on_event(body, at_ns)
        elif isinstance(body, Health):
            text = f"{name}: {'; '.join(body.warnings)}" if body.warnings else ""
            self._set("warnings", body.user, name, text, at_ns)
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
        for (kind, user, _), (start_ns, text) in self._open.items():
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
            self._put("warnings", user, (gone_ns, gone_ns, f"{instance} has gone"))

    def _on_presence(self, at_ns: int, row: Presence, name: str, *, present: bool) -> None:
        if row is USER_ALIVE:
            self._until_ns[name] = math.inf if present else at_ns
        if row is USER_ALIVE and present:
            self._put("interaction", name, None)
        elif row is USER_ALIVE:
            self._close(name, "", at_ns)
        elif row is SERVICE_ALIVE and not present:
            self._close("", name, at_ns)
            self._gone.append((at_ns, name))

    def _on_event(self, event: SelectionEvent, at_ns: int) -> None:
        what = self._called(event.object_id, event.kind)
        wanted = {kind for kinds in self._wanted.values() for kind in kinds}
        is_wanted = not event.kind or not wanted or event.kind in wanted
        if event.event in ("selected", "deselected"):
            self._put("selections", event.user, (at_ns, at_ns, f"{event.event} {what}"))
            if event.event == "selected" and not is_wanted:
                self._put("wrong", event.user, (at_ns, at_ns, f"not wanted: {what}"))
        elif event.event == "refused":
            reason = f": {event.reason}" if event.reason else ""
            self._put("refusals", event.user, (at_ns, at_ns, f"refused {what}{reason}"))
        elif event.event in ("left", "dispatched") and not event.user and is_wanted and wanted:
            self._put("misses", "", (at_ns, at_ns, f"{what} left without being selected"))

    def _called(self, object_id: str, kind: str = "") -> str:
        """Return the name of an object in the page, such as `red 24`, or `""` without an object."""
        if object_id and not kind:
            every = (each for message in self._objects.values() for each in message.objects)
            kind = next((each.kind for each in every if each.id == object_id), "")
        return kind if kind == object_id else f"{kind} {object_id.rpartition('-')[2]}".strip()

    def _set(self, kind: LaneKind, user: str, instance: str, text: str, at_ns: int) -> None:
        """End the interval that is open, and begin another one if `text` is not empty."""
        key = (kind, user, instance)
        before = self._open.get(key)
        if before is not None:
            if kind in ("robot", "warnings") and NUMBERS.sub("", before[1]) == NUMBERS.sub("", text):
                return  # the same with other figures
            if before[1] == text:
                return
            del self._open[key]
            self._put(kind, user, (before[0], at_ns, before[1]))
        if text:
            if len(self._open) >= MAX_LANES:
                del self._open[next(iter(self._open))]
            self._open[key] = (at_ns, text[:MAX_TEXT])

    def _close(self, user: str, instance: str, at_ns: int) -> None:
        """End the open intervals of a service that has gone, or without one those of a person who has."""
        for kind, its_user, its_instance in list(self._open):
            if its_instance == instance and (instance or its_user == user):
                self._set(kind, its_user, instance, "", at_ns)

    def _put(self, kind: LaneKind, user: str, item: Item | None) -> None:
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
