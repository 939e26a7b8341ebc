"""Pointing of one person: hovered object, steadiness and firing."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from pointit.schemas import NS_PER_S, Cursor
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.guarded_method import GuardedMethod
from pointit.services.selector.methods.method import MakeMethod, make_method
from pointit.services.selector.objects.view import View
from pointit.services.selector.selection_methods import PointingSample, SelectionProgress

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

    def __init__(self, config: SelectorConfig, user: str, make: MakeMethod = make_method) -> None:
        self._user = user
        self._make = make
        self._gap_ns = round(config.longest_gap_s * NS_PER_S)
        self._set_method(config)
        self.hovered: str | None = None
        """Object hovered with the last cursor, or None."""
        self.is_new = True
        """True until the person's first object is handled. Of what happened before nothing is known here."""
        self._ready: str | None = None
        self._stamp_ns: int | None = None
        self._press_ns: int | None = None
        self._history: deque[tuple[int, str | None]] = deque()
        """Hovered objects with the time since which each was hovered, ns."""

    @property
    def fault(self) -> str:
        """Return the reason of the method's last failure, or `""` if it works."""
        return self._method.fault

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times, and reset progress.

        Objects that were toggled and not left since stay latched.
        """
        latched = set(self._method.latched)
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
        self._stamp_ns = cursor.stamp_ns
        pointed = self._result(self._method.step(PointingSample(cursor, under, view, acts)))
        self.hovered = pointed.object_id
        if pointed.fired is not None and self._config.confirm == "press":
            self._ready = pointed.fired
        if pointed.object_id != self._ready:
            self._ready = None
        elif self._ready is not None:
            pointed = PointerResult(pointed.object_id, None, 1.0, is_shown=True)
        self._remember(cursor.stamp_ns, pointed.object_id)
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
        self._method.latch(object_id)
        self._ready = None

    def is_latched(self, object_id: str) -> bool:
        """Return True if staying on `object_id` has no effect until it is left."""
        return object_id in self._method.latched

    def _set_method(self, config: SelectorConfig) -> None:
        self._config = config
        self._dwell_s = config.dwell_s
        self._method = GuardedMethod(lambda: self._make(config, self._user))

    def _result(self, made: SelectionProgress) -> PointerResult:
        spent_s = made.spent_s
        if spent_s is None and made.progress > 0.0:
            spent_s = made.progress * self._dwell_s
        if made.object_id is None or spent_s is None or spent_s < self._config.show_after_s:
            return PointerResult(made.object_id, made.fired, 0.0, is_shown=False)
        return PointerResult(made.object_id, made.fired, made.progress, is_shown=True)

    def _forget(self) -> None:
        self._set_method(self._config)
        self._history.clear()
        self.hovered = self._ready = self._stamp_ns = self._press_ns = None
        self.is_new = True

    def _remember(self, stamp_ns: int, object_id: str | None) -> None:
        history = self._history
        if not history or history[-1][1] != object_id:
            history.append((stamp_ns, object_id))
        while len(history) > 1 and history[1][0] < stamp_ns - HISTORY_NS:
            history.popleft()
