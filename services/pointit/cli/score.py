"""What a run comes to: which objects were selected, missed or wrong, and how fast the light followed."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pointit.schemas import NS_PER_S, Cursor, Selection, SelectionEvent, StripsFrame, TrackedObjects

RECENT = 64
"""Cursors remembered to find out which capture a frame shows."""
STEP = 1.005
"""Latencies are counted in classes this much apart, so that a run of weeks takes no more memory."""
LEAST_S = 1e-6

UNKNOWN = "object"
"""Kind of what nobody has listed."""
MAX_OBJECTS = 10_000
"""Remembered one by one; of more, the oldest are counted and forgotten."""
MAX_TRACKERS = 64
"""Of more, the one longest unheard is forgotten."""


@dataclass
class Score:
    """Follows objects and selections; pure. Another thread may read it."""

    target_kinds: Sequence[str]
    """Kinds to select; empty: anything may be selected and nothing need be."""
    kinds: dict[str, str] = field(default_factory=dict[str, str])
    """Kind by object id, of every object seen."""
    selected: set[str] = field(default_factory=set[str])
    left: set[str] = field(default_factory=set[str])
    listed: dict[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """By tracker, the objects that are there now."""
    corrected: int = 0
    """Wrong selections that were taken back."""
    bays: dict[str, str] = field(default_factory=dict[str, str])
    """Where objects came out, by object id."""
    past: Counter[str] = field(default_factory=Counter[str])
    """What came of objects that are forgotten."""
    past_bays: Counter[tuple[str, str]] = field(default_factory=Counter[tuple[str, str]])
    """Where forgotten objects came out: bay and kind."""

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Take note of what `tracker` lists."""
        self.listed.pop(tracker, None)
        self.listed[tracker] = frozenset(thing.id for thing in message.objects)
        if len(self.listed) > MAX_TRACKERS:
            del self.listed[next(iter(self.listed))]
        for thing in message.objects:
            self._know(thing.id, thing.kind)

    def on_event(self, event: SelectionEvent) -> None:
        """Take note of what happened."""
        self._know(event.object_id, event.kind)
        if event.event == "selected":
            self.selected.add(event.object_id)
        elif event.event == "deselected":
            self.selected.discard(event.object_id)
            if self.target_kinds and self.kinds.get(event.object_id) not in self.target_kinds:
                self.corrected += 1
        elif event.event in {"left", "dispatched"}:  # may be told twice, when its teller was killed meanwhile
            self.left.add(event.object_id)
            if event.event == "dispatched":
                self.bays[event.object_id] = event.bay
            if event.user:  # they had it, whichever came first: this, or the selection without it
                self.selected.add(event.object_id)

    def on_selection(self, state: Selection) -> None:
        """Take what is selected now: a selector that was restarted begins anew, and tells no event of it."""
        now = {thing.id for thing in state.objects}
        for name in now:
            self._know(name, "")
        self.selected = now | (self.selected & self.left)

    def _know(self, name: str, kind: str) -> None:
        if self.kinds.get(name, UNKNOWN) == UNKNOWN:
            self.kinds[name] = kind or UNKNOWN
        if len(self.kinds) > MAX_OBJECTS:
            self._forget(next(iter(self.kinds)))

    def _forget(self, name: str) -> None:
        kind = self.kinds.pop(name)
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

        Pending are those still there; what vanished with its tracker or a reset is nobody's fault.
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
            "corrected": self.corrected,
        }

    def dispatched(self) -> dict[str, dict[str, int]]:
        """Return how many objects came out, by bay and kind."""
        kinds, bays = dict(self.kinds), dict(self.bays)
        total = Counter(self.past_bays)
        total.update((bay, kinds.get(name, UNKNOWN)) for name, bay in bays.items())
        found: dict[str, dict[str, int]] = {}
        for (bay, kind), count in sorted(total.items()):
            found.setdefault(bay, {})[kind] = count
        return found


class Latency:
    """Time from capture at the wrist to the frame that shows it, wall seconds; another thread may read it."""

    def __init__(self) -> None:
        self._classes: Counter[int] = Counter()
        self._pending: dict[int, None] = {}

    def on_cursor(self, cursor: Cursor) -> None:
        """Remember a capture whose frame is to come."""
        if cursor.surface == "none" and not cursor.solid:
            return
        self._pending[cursor.stamp_ns] = None
        while len(self._pending) > RECENT:
            del self._pending[next(iter(self._pending))]

    def on_frame(self, frame: StripsFrame, now_ns: int, speed: float) -> None:
        """Take the first frame that shows a remembered capture; `now_ns` runs `speed` times as fast."""
        if frame.stamp_ns in self._pending:
            del self._pending[frame.stamp_ns]
            value_s = (now_ns - frame.stamp_ns) / NS_PER_S / speed
            self._classes[round(math.log(max(value_s, LEAST_S), STEP))] += 1

    @property
    def count(self) -> int:
        """Return how many captures were seen as light."""
        return sum(dict(self._classes).values())

    def quantiles_ms(self) -> dict[str, float | None]:
        """Return median and 99th percentile in milliseconds, exact to 0.3 %; none if nothing was measured."""
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


def summary_lines(summary: dict[str, Any]) -> list[str]:
    """Return the summary as lines for a person."""
    latency = summary["latency_ms"]
    shown = (
        "not measured"
        if latency["p50"] is None
        else f"p50 {latency['p50']:.1f} ms, p99 {latency['p99']:.1f} ms"
    )
    speed = "" if summary["speed"] == 1.0 else f" at {summary['speed']:g} times the speed"
    services = f"{len(summary['services'])} services"
    lines = [f"{summary['scenario']} ran {summary['duration_s']:.0f} s{speed} with {services}."]
    if summary["target_kinds"]:
        total = summary["selected"] + summary["missed"] + summary["pending"]
        lines.append(
            f"Selected {summary['selected']} of {total} {'/'.join(summary['target_kinds'])} objects, "
            f"missed {summary['missed']}, still to do {summary['pending']}, "
            f"wrong {summary['wrong']} (taken back {summary['corrected']})."
        )
    for bay, kinds in summary.get("dispatched", {}).items():
        came = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        lines.append(f"Bay {bay}: {came}.")
    for user, found in summary.get("people", {}).items():
        x_m, y_m = found["position_m"]
        off_m = found["position_error_m"]
        off_deg = found.get("yaw_error_deg")
        truly = "" if off_m is None else f", {off_m:.2f} m from the true place"
        truly += "" if off_deg is None else f", yaw {off_deg:.1f}° off"
        lines.append(
            f"{user} was found at {x_m:.2f}, {y_m:.2f} m ±{found['position_sigma_m']:.2f} m, "
            f"yaw ±{found['yaw_sigma_deg']:.1f}°{truly}."
        )
    lines.append(f"Wrist to light: {shown}; {summary['cursors']} cursors, {summary['frames']} frames.")
    return lines
