"""What a run comes to: which objects were selected, missed or wrong, and how fast the light followed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pointit.schemas import Cursor, SelectionEvent, StripsFrame, TrackedObjects

NS_PER_S = 1_000_000_000
RECENT = 64
"""Cursors remembered to find out which capture a frame shows."""


@dataclass
class Score:
    """Follows objects and selections; pure."""

    target_kinds: Sequence[str]
    kinds: dict[str, str] = field(default_factory=dict[str, str])
    """Kind by object id, of every object seen."""
    selected: set[str] = field(default_factory=set[str])
    left: set[str] = field(default_factory=set[str])
    corrected: int = 0
    """Wrong selections that were taken back."""

    def on_objects(self, message: TrackedObjects) -> None:
        """Take note of what there is."""
        for thing in message.objects:
            self.kinds.setdefault(thing.id, thing.kind)

    def on_event(self, event: SelectionEvent) -> None:
        """Take note of what happened."""
        if event.kind:
            self.kinds.setdefault(event.object_id, event.kind)
        if event.event == "selected":
            self.selected.add(event.object_id)
        elif event.event == "deselected":
            self.selected.discard(event.object_id)
            if not self._is_target(event.object_id):
                self.corrected += 1
        elif event.event == "left":
            self.left.add(event.object_id)

    def counts(self) -> dict[str, int]:
        """Return targets selected, missed (left unselected) and pending, and other objects selected."""
        targets = {name for name in self.kinds if self._is_target(name)}
        return {
            "selected": len(targets & self.selected),
            "missed": len((targets & self.left) - self.selected),
            "pending": len(targets - self.left - self.selected),
            "wrong": len(self.selected - targets),
            "corrected": self.corrected,
        }

    def _is_target(self, object_id: str) -> bool:
        return self.kinds.get(object_id) in self.target_kinds


class Latency:
    """Time from capture at the wrist to the frame that shows it, wall seconds."""

    def __init__(self) -> None:
        self.values_s: list[float] = []
        self._pending: dict[int, None] = {}

    def on_cursor(self, cursor: Cursor) -> None:
        """Remember a capture whose frame is to come."""
        if cursor.surface == "none":
            return
        self._pending[cursor.stamp_ns] = None
        while len(self._pending) > RECENT:
            del self._pending[next(iter(self._pending))]

    def on_frame(self, frame: StripsFrame, now_ns: int, speed: float) -> None:
        """Take the first frame that shows a remembered capture."""
        if frame.stamp_ns in self._pending:
            del self._pending[frame.stamp_ns]
            self.values_s.append((now_ns - frame.stamp_ns) / NS_PER_S / speed)

    def quantiles_ms(self) -> dict[str, float | None]:
        """Return median and 99th percentile in milliseconds, none where nothing was measured."""
        values = sorted(self.values_s)
        if not values:
            return {"p50": None, "p99": None}
        last = len(values) - 1
        return {
            "p50": round(values[last // 2] * 1e3, 3),
            "p99": round(values[int(last * 0.99)] * 1e3, 3),
        }


def summary_lines(summary: dict[str, Any]) -> list[str]:
    """Return the summary as lines for a person."""
    latency = summary["latency_ms"]
    shown = (
        "not measured"
        if latency["p50"] is None
        else f"p50 {latency['p50']:.1f} ms, p99 {latency['p99']:.1f} ms"
    )
    lines = [
        f"{summary['scenario']} ran {summary['duration_s']:.0f} s with {', '.join(summary['services'])}."
    ]
    if summary["target_kinds"]:
        lines.append(
            f"Selected {summary['selected']} of the {'/'.join(summary['target_kinds'])} objects, "
            f"missed {summary['missed']}, still to do {summary['pending']}, "
            f"wrong {summary['wrong']} (taken back {summary['corrected']})."
        )
    lines.append(f"Wrist to light: {shown}; {summary['cursors']} cursors, {summary['frames']} frames.")
    return lines
