"""A person's selection method whose faults stay with it: it is left out for a while, then made anew."""

from collections.abc import Callable, Collection
from typing import TypeVar

from pointit.schemas import NS_PER_S
from pointit.services.selector.selection_methods import PersonMethod, Pointing, Progress

T = TypeVar("T")

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
        return self._latched if self._method is None else self._call(lambda method: method.latched, ())

    def step(self, pointing: Pointing) -> Progress:
        """Return the method's result, or that of an object without progress while it is left out."""
        self._now_ns = pointing.cursor.stamp_ns
        if self._method is None and self._now_ns < self._retry_ns:
            return Progress(pointing.under)
        result = self._call(lambda method: _checked(method.step(pointing)), Progress(pointing.under))
        if self._failures and self._now_ns - self._retry_ns > MAX_WAIT_NS:
            self._failures, self.fault = 0, ""
        return result

    def latch(self, object_id: str) -> None:
        """Ignore `object_id` until it is left."""
        if self._method is None:
            self._latched = {*self._latched, object_id}
        else:
            self._call(lambda method: method.latch(object_id), None)

    def _call(self, function: Callable[[PersonMethod], T], otherwise: T) -> T:
        try:
            if self._method is None:
                self._method = self._make()
                for object_id in self._latched:
                    self._method.latch(object_id)
            return function(self._method)
        except Exception as error:  # noqa: BLE001 - code of others, which may raise anything
            wait_ns = min(FIRST_WAIT_NS * 2 ** min(self._failures, 10), MAX_WAIT_NS)
            self._failures += 1
            self._method, self._latched, self._retry_ns = None, (), self._now_ns + wait_ns
            times = f", {self._failures} times now" if self._failures > 1 else ""
            self.fault = f"{type(error).__name__}: {error}".partition("\n")[0][:200] + times
            return otherwise


def _checked(result: Progress) -> Progress:
    if not 0.0 <= result.progress <= 1.0:
        raise ValueError(f"progress {result.progress}, expected 0 to 1")
    return result
