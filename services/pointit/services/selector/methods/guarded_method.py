"""A person's selection method whose faults stay with it: it is left out for a while, then replaced."""

import math
from collections.abc import Callable, Collection
from typing import Any

from pointit.schemas import NS_PER_S
from pointit.services.selector.selection_methods import PersonMethod, PointingSample, SelectionProgress

FIRST_WAIT_NS = NS_PER_S
"""Time for which it is left out after its first failure, ns. It doubles with each further one."""
MAX_WAIT_NS = 30 * NS_PER_S
"""Longest such time, ns. After working for as long, it counts as sound again."""


class GuardedMethod:
    """Calls a method of one person. If it raises or returns nonsense, the person selects nothing."""

    def __init__(self, make: Callable[[], PersonMethod]) -> None:
        """Use what `make` returns, from the first cursor on."""
        self._make = make
        self._method: PersonMethod | None = None
        self._latched: Collection[str] = ()
        """Objects to latch when it is made."""
        self._now_ns = self._retry_ns = 0
        self._failures = 0
        self.fault = ""
        """Reason of its last failure, or `""` if it works."""

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

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Return the method's result, or that of an object without progress while it is left out."""
        self._now_ns = pointing.cursor.stamp_ns
        if self._method is None and self._now_ns < self._retry_ns:
            return SelectionProgress(pointing.under)
        try:
            result = (self._method or self._made()).step(pointing)
            check_progress(result)
        except Exception as error:  # noqa: BLE001 - code of others, which may raise anything
            self._on_failure(error)
            return SelectionProgress(pointing.under)
        if self._failures and self._now_ns - self._retry_ns > MAX_WAIT_NS:
            self._failures, self.fault = 0, ""
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

    def _made(self) -> PersonMethod:
        self._method = method = self._make()
        for object_id in self._latched:
            method.latch(object_id)
        return method

    def _on_failure(self, error: Exception) -> None:
        wait_ns = min(FIRST_WAIT_NS * 2 ** min(self._failures, 10), MAX_WAIT_NS)
        self._failures += 1
        self._method, self._latched, self._retry_ns = None, (), self._now_ns + wait_ns
        times = f", {self._failures} times now" if self._failures > 1 else ""
        self.fault = f"{type(error).__name__}: {error}".partition("\n")[0][:200] + times


def check_progress(result: SelectionProgress) -> None:
    """Check what a method returned.

    Raises:
        TypeError: If a value is of another type.
        ValueError: If a number is out of range.
    """
    for name in ("object_id", "fired"):
        value: Any = getattr(result, name)  # of others, whose types nobody has checked
        if not (value is None or isinstance(value, str)):
            raise TypeError(f"{name} {value!r}, expected text or None")
    if not 0.0 <= result.progress <= 1.0:
        raise ValueError(f"progress {result.progress}, expected 0 to 1")
    if result.spent_s is not None and not 0.0 <= result.spent_s < math.inf:
        raise ValueError(f"spent_s {result.spent_s}, expected 0 or more")
