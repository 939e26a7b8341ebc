"""Pointing of one person: hovered object, steadiness and firing."""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from pointit.schemas import NS_PER_S, Cursor
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.dwell import Dwell
from pointit.services.selector.methods.gauge import Gauges
from pointit.services.selector.methods.ray_speed import RaySpeedEstimator
from pointit.services.selector.objects.view import View

CLOCK_STEP_NS = 2 * NS_PER_S
"""A stamp earlier by more than this means that the wrist's clock was set back. One by less is late."""

HISTORY_NS = NS_PER_S
"""Time for which hovered objects are remembered, ns."""


class PointerResult(NamedTuple):
    """Result of one cursor."""

    object_id: str | None
    """Hovered object, or None."""
    fired: str | None
    """Object on which the person stayed long enough, or None."""
    progress: float
    """Progress towards firing, 0 to 1. 0 while it is too little to show."""
    is_shown: bool
    """True if progress is enough to show. From then on the object is reserved."""


class PersonPointer:
    """Applies the configured method to one person's cursors."""

    def __init__(self, config: SelectorConfig) -> None:
        gauge = config.gauge
        self._snap_rad = math.radians(gauge.snap_deg)
        self._sparse_rad = math.radians(gauge.sparse_deg)
        self._steady_rad_s = math.radians(gauge.steady_deg_per_s)
        self._gap_ns = round(config.longest_gap_s * NS_PER_S)
        self._steadiness = RaySpeedEstimator(gauge.speed_window_s)
        self._set_method(config)
        self.hovered: str | None = None
        """Object hovered with the last cursor, or None."""
        self._ready: str | None = None
        self._stamp_ns: int | None = None
        self._press_ns: int | None = None
        self._history: deque[tuple[int, str | None]] = deque()
        """Hovered objects with the time since which each was hovered, ns."""

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times, and reset progress.

        Objects that were toggled and not left since stay latched.
        """
        latched = set((self._gauges if self._dwell is None else self._dwell).latched)
        self._set_method(config)
        for object_id in latched:
            self.latch(object_id)

    def is_timely(self, stamp_ns: int) -> bool:
        """Return True if a cursor of `stamp_ns` is new. A step back of the wrist's clock resets all state."""
        if self._stamp_ns is None or stamp_ns > self._stamp_ns:
            return True
        if self._stamp_ns - stamp_ns <= CLOCK_STEP_NS:
            return False
        self._forget()
        return True

    def step(
        self, cursor: Cursor, view: View | None, under: str | None, acts: Callable[[str], bool]
    ) -> PointerResult:
        """Process a timely cursor.

        Args:
            cursor: cursor, identified by its stamp.
            view: objects along its ray. None without a ray, without objects, or for methods by metres.
            under: object under it by metres, for the methods of the paper and cursors without a ray.
            acts: returns True if staying on an object has an effect.
        """
        stamp_ns = cursor.stamp_ns
        if self._stamp_ns is not None and stamp_ns - self._stamp_ns > self._gap_ns:
            self._steadiness.clear()
        self._stamp_ns = stamp_ns
        if self._dwell is None:
            pointed = self._fill(cursor, view, under, acts)
        else:
            pointed = self._stay(self._dwell, stamp_ns, under, acts)
        if pointed.fired is not None and self._config.confirm == "press":
            self._ready = pointed.fired
        if pointed.object_id != self._ready:
            self._ready = None
        elif self._ready is not None:
            pointed = PointerResult(pointed.object_id, None, 1.0, is_shown=True)
        self._remember(stamp_ns, pointed.object_id)
        return pointed

    def press(self, stamp_ns: int) -> str | None:
        """Return the object hovered shortly before the press of `stamp_ns`, or None if unknown."""
        if self._press_ns is not None and -CLOCK_STEP_NS <= stamp_ns - self._press_ns <= 0:
            return None
        self._press_ns = stamp_ns
        target_ns = stamp_ns - round(self._config.look_back_s * NS_PER_S)
        if self._stamp_ns is None or target_ns - self._stamp_ns > self._gap_ns:
            return None  # the last cursor is too old
        for since_ns, object_id in reversed(self._history):
            if since_ns <= target_ns:
                return object_id
        return None

    def latch(self, object_id: str) -> None:
        """Disable staying on `object_id` until it is left, since it was changed in another way."""
        (self._gauges if self._dwell is None else self._dwell).latch(object_id)
        self._ready = None

    def is_latched(self, object_id: str) -> bool:
        """Return True if staying on `object_id` has no effect until it is left."""
        return object_id in (self._gauges if self._dwell is None else self._dwell).latched

    def _set_method(self, config: SelectorConfig) -> None:
        self._config = config
        self._gauges = Gauges(
            drain_share=config.gauge.drain_share,
            leave_s=config.gauge.leave_s,
            longest_gap_s=config.longest_gap_s,
            full_s=config.gauge.full_s,
        )
        self._dwell = (
            None
            if config.method == "gauge"
            else Dwell(
                config.method,
                window_s=config.window_s,
                timestep_s=config.timestep_s,
                fraction=config.fraction,
                release_s=config.release_s,
                longest_gap_s=config.longest_gap_s,
            )
        )

    def _forget(self) -> None:
        self._gauges.clear()
        if self._dwell is not None:
            self._dwell.clear()
        self._steadiness.clear()
        self._history.clear()
        self.hovered = self._ready = self._stamp_ns = self._press_ns = None

    def _fill(
        self, cursor: Cursor, view: View | None, under: str | None, acts: Callable[[str], bool]
    ) -> PointerResult:
        gauge = self._config.gauge
        gauges = self._gauges
        hovered, fills, full_s, near = under, True, gauge.full_s, set[str]()
        if cursor.direction is not None:
            self._steadiness.add(cursor.stamp_ns, cursor.direction)
        if view is not None:
            hovered = view.pick(self.hovered, self._snap_rad, gauge.hysteresis)
            latched = gauges.latched
            if latched:
                near = view.near(latched, self._snap_rad, gauge.leave_factor)
        elif under is not None:
            near = {under}
        if hovered is not None and view is not None:
            rate = self._steadiness.rate()
            fills = rate is not None and view.relative_rate(hovered, rate) < self._steady_rad_s
            if gauge.sparse_full_s != full_s and view.is_isolated(self._sparse_rad):
                full_s = gauge.sparse_full_s
        fills = fills and hovered is not None and acts(hovered)
        fired = gauges.step(cursor.stamp_ns, hovered, fills=fills, full_s=full_s, near=near)
        self.hovered = hovered
        if hovered is None:
            return PointerResult(None, fired, 0.0, is_shown=False)
        is_shown = gauges.filled_s(hovered) >= self._config.show_after_s
        return PointerResult(hovered, fired, gauges.fill(hovered) if is_shown else 0.0, is_shown)

    def _stay(
        self, dwell: Dwell, stamp_ns: int, under: str | None, acts: Callable[[str], bool]
    ) -> PointerResult:
        fired = dwell.step(stamp_ns, under)
        self.hovered = under
        if under is None or not acts(under):
            return PointerResult(under, fired, 0.0, is_shown=False)
        progress = dwell.progress(under)
        is_shown = progress > 0.0 and progress * self._config.window_s >= self._config.show_after_s
        return PointerResult(under, fired, progress if is_shown else 0.0, is_shown)

    def _remember(self, stamp_ns: int, object_id: str | None) -> None:
        history = self._history
        if not history or history[-1][1] != object_id:
            history.append((stamp_ns, object_id))
        while len(history) > 1 and history[1][0] < stamp_ns - HISTORY_NS:
            history.popleft()
