"""Score of a run: objects selected, missed or wrong, bays where they left, and latency from hand to light.

An object that left at a bay counts for the person it was sent there for, whatever was selected before.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from pointit.schemas import NS_PER_S, Cursor, Selection, SelectionEvent, StripsFrame, TrackedObjects

UNKNOWN = "object"
"""Kind of an object that no tracker has listed."""
MAX_OBJECTS = 10_000
"""Objects stored individually. Beyond that, the oldest are only counted."""
MAX_TRACKERS = 64
"""Trackers stored. Beyond that, the one that has been silent longest is dropped."""
RECENT = 64
"""Recent cursors kept to match a frame with its capture."""
STEP = 1.005
"""Ratio of neighbouring histogram bins, which bounds the memory of long runs."""
MIN_S = 1e-6


@dataclass
class RunScore:
    """Counts objects and selections; pure. Other threads may read it."""

    target_kinds: Sequence[str]
    """Kinds to select. If empty, anything may be selected and nothing has to be."""
    kinds: dict[str, str] = field(default_factory=dict[str, str])
    """Kind by object id, of every object seen."""
    selected: set[str] = field(default_factory=set[str])
    left: set[str] = field(default_factory=set[str])
    listed: dict[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Objects now listed, by tracker."""
    corrected: Counter[str] = field(default_factory=Counter[str])
    """Wrong selections that were corrected before the object left, by object id."""
    unknown: set[str] = field(default_factory=set[str])
    """Selected but not listed by any tracker: left over from an earlier run, so not counted as errors."""
    refused: int = 0
    """Selections without effect: too late for the bay, or another person's object."""
    refusal: str = ""
    """Reason of the last refused selection."""
    bays: dict[str, str] = field(default_factory=dict[str, str])
    """Bay where an object left, by object id."""
    past: Counter[str] = field(default_factory=Counter[str])
    """Counts of dropped objects."""
    past_bays: Counter[tuple[str, str]] = field(default_factory=Counter[tuple[str, str]])
    """Counts of dropped objects by bay and kind."""

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Update from the list of `tracker`."""
        self.listed.pop(tracker, None)
        self.listed[tracker] = frozenset(thing.id for thing in message.objects)
        if len(self.listed) > MAX_TRACKERS:
            del self.listed[next(iter(self.listed))]
        for thing in message.objects:
            self._know(thing.id, thing.kind)
            if thing.id in self.unknown:
                self.unknown.discard(thing.id)
                self.selected.add(thing.id)

    def on_event(self, event: SelectionEvent) -> None:
        """Count `event`."""
        self._know(event.object_id, event.kind)
        if event.event in {"selected", "deselected"} and event.object_id in self.bays:
            return  # the bay is final
        if event.event == "selected":
            self.selected.add(event.object_id)
        elif event.event == "deselected":
            self.selected.discard(event.object_id)
            if self.target_kinds and self.kinds.get(event.object_id) not in self.target_kinds:
                self.corrected[event.object_id] += 1
        elif event.event == "refused":
            self.refused += 1
            self.refusal = event.reason
        elif event.event in {"left", "dispatched"}:  # may arrive twice if its publisher was killed meanwhile
            self.left.add(event.object_id)
            if event.user:  # it left for them, whether this or the selection without it arrived first
                self.selected.add(event.object_id)
                del self.corrected[event.object_id]
            elif event.event == "dispatched":  # to the bay for the rest, whatever was selected
                self.selected.discard(event.object_id)
            if event.event == "dispatched":
                self.bays[event.object_id] = event.bay

    def on_selection(self, selection: Selection) -> None:
        """Update from the current selection: a restarted selector publishes no events for it.

        It may contain objects selected in the previous run that have not been seen again yet.
        """
        now = {thing.id for thing in selection.objects}
        known = now & self.kinds.keys()
        self.unknown = now - known
        self.selected = (known - self.bays.keys()) | (self.selected & self.left)

    def _know(self, name: str, kind: str) -> None:
        if self.kinds.get(name, UNKNOWN) == UNKNOWN:
            self.kinds[name] = kind or UNKNOWN
        if len(self.kinds) > MAX_OBJECTS:
            self._forget(next(iter(self.kinds)))

    def _forget(self, name: str) -> None:
        kind = self.kinds.pop(name)
        self.past["corrected"] += self.corrected.pop(name, 0)
        is_target = kind in self.target_kinds or not self.target_kinds
        if name in self.bays:
            self.past_bays[self.bays.pop(name), kind] += 1
        if name in self.selected:
            self.past["selected" if is_target else "wrong"] += 1
        elif name in self.left and self.target_kinds and is_target:
            self.past["missed"] += 1
        self.selected.discard(name)
        self.left.discard(name)

    def counts(self) -> dict[str, int]:
        """Return targets selected, missed (left unselected) and pending, and other objects selected.

        Pending are those still listed. Objects that vanished with their tracker or a reset do not count.
        """
        kinds, selected, left = dict(self.kinds), set(self.selected), set(self.left)  # each at one go
        there = frozenset[str]().union(*list(self.listed.values()))
        targets = {name for name, kind in kinds.items() if kind in self.target_kinds}
        past = self.past
        return {
            "selected": past["selected"] + len(targets & selected if self.target_kinds else selected),
            "missed": past["missed"] + len((targets & left) - selected),
            "pending": len((targets & there) - left - selected),
            "wrong": past["wrong"] + len(selected - targets if self.target_kinds else ()),
            "corrected": past["corrected"] + sum(self.corrected.copy().values()),
        }

    def dispatched(self) -> dict[str, dict[str, int]]:
        """Return the number of objects that left, by bay and kind."""
        kinds, bays = dict(self.kinds), dict(self.bays)
        total = Counter(self.past_bays)
        total.update((bay, kinds.get(name, UNKNOWN)) for name, bay in bays.items())
        found: dict[str, dict[str, int]] = {}
        for (bay, kind), count in sorted(total.items()):
            found.setdefault(bay, {})[kind] = count
        return found


class Latency:
    """Time from capture at the wrist to the light that shows it, wall seconds. Other threads may read it."""

    def __init__(self) -> None:
        self._classes: Counter[int] = Counter()
        self._pending: dict[int, None] = {}

    def on_cursor(self, cursor: Cursor) -> None:
        """Store a capture that waits for its frame."""
        if cursor.surface == "none" and not cursor.solid:
            return
        self._pending[cursor.stamp_ns] = None
        while len(self._pending) > RECENT:
            del self._pending[next(iter(self._pending))]

    def on_frame(self, frame: StripsFrame, now_ns: int, speed: float) -> None:
        """Count the first frame of a stored capture; `now_ns` runs `speed` times as fast as wall time."""
        if frame.stamp_ns in self._pending:
            del self._pending[frame.stamp_ns]
            value_s = (now_ns - frame.stamp_ns) / NS_PER_S / speed + frame.light_s
            self._classes[round(math.log(max(value_s, MIN_S), STEP))] += 1

    @property
    def count(self) -> int:
        """Return the number of captures shown as light."""
        return sum(dict(self._classes).values())

    def quantiles_ms(self) -> dict[str, float | None]:
        """Return median and 99th percentile, ms, exact to 0.3 %; values are None if nothing was measured."""
        classes = sorted(dict(self._classes).items())
        total = sum(number for _, number in classes)
        if not total:
            return {"p50": None, "p99": None}

        def quantile(share: float) -> float:  # nearest rank
            rank = math.ceil(share * total)
            for exponent, number in classes:
                rank -= number
                if rank <= 0:
                    return round(STEP**exponent * 1e3, 3)
            raise AssertionError("unreachable: the ranks sum up to the total")

        return {"p50": quantile(0.5), "p99": quantile(0.99)}
