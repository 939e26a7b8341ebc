"""Pointing of one person: hovered object, steadiness and firing, by the method in use."""

import math
from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Literal, NamedTuple, TypeGuard

from pointit.schemas import NS_PER_S, Cursor
from pointit.services.selector.config import TIMESTEP_S, SelectorConfig
from pointit.services.selector.seen_objects import View
from pointit.services.selector.selection_methods import (
    MAX_DWELL_S,
    METHODS,
    NO_PROGRESS,
    MethodConfig,
    NameAnnouncer,
    NameAwareMethod,
    PersonMethod,
    PointingSample,
    SelectionProgress,
    detached,
)

MakeMethod = Callable[[SelectorConfig, str], PersonMethod]
"""Makes the configured method for a user."""

CLOCK_STEP_NS = 2 * NS_PER_S
"""A stamp earlier by more than this means that the wrist's clock was set back. One by less is late."""

HISTORY_NS = 3 * NS_PER_S
"""Time for which hovered objects are remembered, ns: presses of headsets come up to 2 s late."""

LOOK_BACK_NS = 150_000_000
"""A press selects what was hovered this long before it, ns: pressing moves the arm."""

SHOW_AFTER_S = 0.15
"""Time of filling before progress is shown and the object is reserved, s."""

MAX_PRESSES = 8
"""Number of presses that are remembered, to ignore those that come again."""

FIRST_WAIT_NS = NS_PER_S
"""Time for which a method is left out after its first failure, ns. It doubles with each further one."""

MAX_WAIT_NS = 30 * NS_PER_S
"""Longest such time, ns. After working for as long, it counts as sound again."""


def make_method(config: SelectorConfig, user: str) -> PersonMethod:
    """Return the configured method for `user`, outside a site."""
    return METHODS.get(config.method).make(config.section(config.method), detached(user))


def is_ours(method: str) -> TypeGuard[Literal["hold", "fraction", "gauge"]]:
    """Return True if `method` is one of this project."""
    return method in ("hold", "fraction", "gauge")


def is_by_angle(config: SelectorConfig) -> bool:
    """Return True if the configured method finds objects by their angle from the ray."""
    return METHODS.get(config.method).by_angle


def apply_method(
    configured: SelectorConfig, in_use: SelectorConfig, method: str | None, dwell_s: float | None
) -> SelectorConfig:
    """Return the configuration to use from now on.

    Args:
        configured: configuration at the start, with the times of each method and the ratio of those of the
            gauge.
        in_use: current configuration.
        method: new method. None: unchanged.
        dwell_s: time on an object that selects it. None: unchanged, or the method's own if `method` is given.

    Raises:
        ValueError: If it is impossible. The message gives the reason.
        ConfigError: If the method is not installed or cannot be imported.
    """
    if method is not None:
        METHODS.get(method)  # raises if it cannot be used
    if method is None and dwell_s is None:
        return in_use
    new_method = in_use.method if method is None else method
    config = configured.model_copy(update={"method": new_method})
    return config if dwell_s is None else _with_dwell(config, dwell_s)


def _with_dwell(config: SelectorConfig, dwell_s: float) -> SelectorConfig:
    """Return `config` with another time on an object. Raises ValueError as `apply_method`."""
    section = config.section(config.method)
    if isinstance(section, MethodConfig):
        return config.model_copy(update={config.method: section.with_dwell(dwell_s)})

    # The gauge: the time of an isolated object keeps its ratio
    if config.method == "gauge":
        sparse_s = dwell_s * config.gauge.sparse_full_s / config.gauge.full_s
        if not 0.0 < sparse_s <= MAX_DWELL_S:
            raise ValueError(
                f"with {dwell_s:g} s the gauge of an isolated object would take "
                f"{sparse_s:.9g} s, limit {MAX_DWELL_S:g} s: choose a shorter time"
            )
        gauge = config.gauge.model_copy(update={"full_s": dwell_s, "sparse_full_s": sparse_s})
        return config.model_copy(update={"gauge": gauge})

    # The methods of the paper count timesteps
    if dwell_s < TIMESTEP_S:
        raise ValueError(
            f"{dwell_s:.9g} s is less than the timestep of {TIMESTEP_S:g} s of method "
            f"{config.method}: choose a longer time, or the gauge"
        )
    return config.model_copy(update={"window_s": dwell_s})


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
    confidence: float | None = None
    """Probability that the object is meant, if the method tells."""
    rival: str | None = None
    """Another object that is as probable, of which the person is notified now, or None."""


NOTHING = PointerResult(None, None, 0.0, False)


class PersonPointer:
    """Applies the configured method to one person's cursors."""

    def __init__(self, config: SelectorConfig, user: str, make: MakeMethod = make_method) -> None:
        self._user = user
        self._make = make
        self._gap_ns = round(config.longest_gap_s * NS_PER_S)
        self._set_method(config)
        self.announcer: NameAnnouncer | None = None
        """Names that are spoken to the person. None: they see lights."""
        make_announcer = METHODS.get(config.method).announcer
        if make_announcer is not None:
            self.announcer = make_announcer(config.section(config.method), user)
        self.hovered: str | None = None
        """Object hovered with the last cursor, or None."""
        self.is_new = True
        """True until the person's first object is handled. What happened before is not known here."""
        self._ready: str | None = None
        self._stamp_ns: int | None = None
        self._presses_ns: deque[int] = deque(maxlen=MAX_PRESSES)
        """Stamps of the last presses, ns. One that comes again is the same press."""
        self._history: deque[tuple[int, str | None]] = deque()
        """Hovered objects with the time since which each was hovered, ns."""

    @property
    def fault(self) -> str:
        """Return the reason for the method's last failure, or `""` if it works."""
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
        self,
        cursor: Cursor,
        view: View | None,
        under: str | None,
        acts: Callable[[str], bool],
        presses: Callable[[str], bool] = lambda _object_id: False,
    ) -> PointerResult:
        """Process a timely cursor.

        Args:
            cursor: cursor, identified by its stamp.
            view: objects along its ray. None without a ray, without objects, or for methods by metres.
            under: object under it by metres, for the methods of the paper and cursors without a ray.
            acts: returns True if staying on an object has an effect.
            presses: returns True if an object is selected by a press only.
        """
        stamp_ns = cursor.stamp_ns
        self._stamp_ns = stamp_ns

        # By the method, unless the person has stepped to an object
        sample = PointingSample(cursor, under, view, acts)
        if self.announcer is None:
            progress = self._method.step(sample)
        else:
            progress = self._method.step(sample, self.announcer.spoken)
            progress = self.announcer.apply_focus(progress, cursor, acts)
        pointed = self._result(progress)
        self.hovered = pointed.object_id

        # What would fire, but needs a press, stays ready until it is left
        fired = pointed.fired
        if fired is not None and (self.is_confirmed_by_press or presses(fired)):
            self._ready = fired
        if self.hovered != self._ready:
            self._ready = None
        elif self._ready is not None:
            pointed = pointed._replace(fired=None, progress=1.0, is_shown=True)
        self._remember(stamp_ns, self.hovered)
        return pointed

    @property
    def is_confirmed_by_press(self) -> bool:
        """Return True if the person selects by their button, not by staying."""
        if self.announcer is not None:
            return self.announcer.is_pressed
        return self._config.confirm == "press"

    def press(self, stamp_ns: int) -> str | None:
        """Return the object hovered shortly before the press of `stamp_ns`, or None if unknown.

        With an announcer: the one that was announced then, or `""`.
        """
        if stamp_ns in self._presses_ns:
            return None
        self._presses_ns.append(stamp_ns)
        target_ns = stamp_ns - LOOK_BACK_NS
        if self._stamp_ns is None or target_ns - self._stamp_ns > self._gap_ns:
            return None  # the last cursor is too old
        if self.announcer is not None:
            return self.announcer.confirmed(stamp_ns)
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

    def _result(self, method_result: SelectionProgress) -> PointerResult:
        """Return the result of a method, without a progress that is too little to show."""
        if method_result is NO_PROGRESS:
            return NOTHING
        object_id, progress, fired, spent_s, confidence, rival = method_result
        has_object = object_id is not None or fired is not None or rival is not None
        if not has_object and confidence is None:
            return NOTHING
        if spent_s is None and progress > 0.0:
            spent_s = progress * self._dwell_s
        if object_id is None or spent_s is None or spent_s < SHOW_AFTER_S:
            return PointerResult(object_id, fired, 0.0, False, confidence, rival)
        return PointerResult(object_id, fired, progress, True, confidence, rival)

    def _forget(self) -> None:
        self._set_method(self._config)
        self._history.clear()
        self._presses_ns.clear()
        self.hovered = None
        self._ready = None
        self._stamp_ns = None
        if self.announcer is not None:
            self.announcer.forget()
        self.is_new = True

    def _remember(self, stamp_ns: int, object_id: str | None) -> None:
        """Append to the history what is hovered since `stamp_ns`, and drop what no press can mean."""
        history = self._history
        if not history or history[-1][1] != object_id:
            history.append((stamp_ns, object_id))
        # the second entry tells until when the first was hovered
        while len(history) > 1 and history[1][0] < stamp_ns - HISTORY_NS:
            history.popleft()


class GuardedMethod:
    """Calls a method of one person. If it raises or returns nonsense, the person selects nothing."""

    def __init__(self, make: Callable[[], PersonMethod]) -> None:
        """Use what `make` returns, from the first cursor on."""
        self._make = make
        self._method: PersonMethod | None = None
        self._latched: Collection[str] = ()
        """Objects to latch when it is made."""
        self._now_ns = 0
        self._retry_ns = 0
        self._failures = 0
        self.fault = ""
        """Reason for its last failure, or `""` if it works."""

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        if self._method is None:
            return self._latched
        try:
            return frozenset(self._method.latched)
        except Exception as error:  # noqa: BLE001 - code of others, which may raise anything
            self._on_failure(error)
            return ()

    def step(self, pointing: PointingSample, spoken: tuple[str, int] | None = None) -> SelectionProgress:
        """Return the method's result, or that of an object without progress while it is left out."""
        self._now_ns = pointing.cursor.stamp_ns
        if self._method is None and self._now_ns < self._retry_ns:
            return SelectionProgress(pointing.under)
        try:
            method = self._method or self._make_method()
            if spoken is not None and isinstance(method, NameAwareMethod):
                method.set_spoken(*spoken)
            result = method.step(pointing)
            if result is not NO_PROGRESS:
                check_progress(result)
        except Exception as error:  # noqa: BLE001 - code of others, which may raise anything
            self._on_failure(error)
            return SelectionProgress(pointing.under)
        if self._failures and self._now_ns - self._retry_ns > MAX_WAIT_NS:
            self._failures = 0
            self.fault = ""
        return result

    def latch(self, object_id: str) -> None:
        """Ignore `object_id` until it is left."""
        if self._method is None:
            self._latched = {*self._latched, object_id}
            return
        try:
            self._method.latch(object_id)
        except Exception as error:  # noqa: BLE001 - code of others, which may raise anything
            self._on_failure(error)

    def _make_method(self) -> PersonMethod:
        method = self._make()
        self._method = method
        for object_id in self._latched:
            method.latch(object_id)
        return method

    def _on_failure(self, error: Exception) -> None:
        """Leave the method out for a time that doubles, and make another one then."""
        doublings = min(self._failures, 10)  # without a limit the power would grow for ever
        wait_ns = min(FIRST_WAIT_NS * 2**doublings, MAX_WAIT_NS)
        self._failures += 1
        self._method = None
        self._latched = ()
        self._retry_ns = self._now_ns + wait_ns
        times = f", {self._failures} times now" if self._failures > 1 else ""
        first_line, _, _ = f"{type(error).__name__}: {error}".partition("\n")
        self.fault = first_line[:200] + times


def check_progress(result: SelectionProgress) -> None:
    """Check what a method returned.

    Raises:
        TypeError: If a value is of another type.
        ValueError: If a number is out of range.
    """
    object_id, progress, fired, spent_s, confidence, rival = result
    has_object = object_id is not None or fired is not None or rival is not None
    if has_object:
        # of methods of other packages, whose types nobody has checked
        texts: dict[str, Any] = {"object_id": object_id, "fired": fired, "rival": rival}
        for name, value in texts.items():
            if value is not None and not isinstance(value, str):
                raise TypeError(f"{name} {value!r}, expected text or None")
    if not 0.0 <= progress <= 1.0:
        raise ValueError(f"progress {progress}, expected 0 to 1")
    if confidence is not None and not 0.0 <= confidence <= 1.0:
        raise ValueError(f"confidence {confidence}, expected 0 to 1")
    if spent_s is not None and not 0.0 <= spent_s < math.inf:  # NaN, too
        raise ValueError(f"spent_s {spent_s}, expected 0 or more")
