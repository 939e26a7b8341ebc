"""Broken promises of a run: the first breach of each, with the trace up to it."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.simulation.kernel.timeline import Timeline
from tests.simulation.promises.promise import Promise

MAX_TEXT = 600
PRODUCT_FOLDERS = ("/services/", "/pointit/", "/bridges/", "/schemas/")


@dataclass
class Breach:
    """A broken promise."""

    promise: str
    text: str
    at_s: float
    where: str = ""
    """File and line of the product, if an exception broke it."""
    trace: list[str] = field(default_factory=list[str])


class Breaches:
    """Collects breaches."""

    def __init__(self, timeline: Timeline) -> None:
        self.first: dict[str, Breach] = {}
        """The first breach by promise."""
        self.on_first: list[Callable[[Breach], object]] = []
        """Called with the first breach of each promise."""
        self._timeline = timeline

    def add(self, promise: Promise, text: str, error: BaseException | None = None) -> None:
        """Add a breach, with the exception that broke the promise."""
        text = text[:MAX_TEXT]
        self._timeline.note("BROKEN", f"{promise.name}: {text}")
        if promise.name not in self.first:
            lines = list(self._timeline.trace)
            breach = Breach(promise.name, text, self._timeline.now_s, _product_line(error), lines)
            self.first[promise.name] = breach
            for callback in self.on_first:
                callback(breach)


def _product_line(error: BaseException | None) -> str:
    """Return the innermost line of the product in a traceback, or `""`."""
    if error is None or error.__traceback__ is None:
        return ""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        for folder in PRODUCT_FOLDERS:
            if folder in frame.filename:
                return f"{frame.filename[frame.filename.rindex(folder) + 1 :]}:{frame.lineno}"
    return ""
