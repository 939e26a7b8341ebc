"""Service beside a scenario that outlasts it, such as a page or a recorder."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import ClassVar

from pointit.runtime.bus.contract import Bus
from pointit.runtime.service.service import Launch


class Beside(ABC):
    """A service beside the scenario, which stays when that changes, and what a run owes it."""

    WHAT: ClassVar[str]
    """Common noun in messages, such as `page`."""
    WAIT_S: ClassVar[float] = 0.0
    """The scenario waits until it is present, at most so long, and ends before it. 0: it is started in the
    background after the scenario."""
    ONE_IS_ENOUGH: ClassVar[bool] = False
    """It is not started on a site that has one."""

    @property
    @abstractmethod
    def instance(self) -> str:
        """Return its instance name."""

    @abstractmethod
    def launch(self) -> Launch:
        """Return its launch. May be slow: it imports the service."""

    def checked(self) -> Sequence[Launch]:
        """Return the launches to check before anything starts."""
        return [self.launch()]

    def joined(self, bus: Bus) -> AbstractContextManager[object]:
        """Return a context that is open while the run is on `bus`."""
        del bus
        return contextlib.nullcontext()

    def greeting(self, *, is_drawn: bool) -> Sequence[str]:
        """Return the sentences to print once it is present. `is_drawn`: the view shows its `address`."""
        del is_drawn
        return ()

    @property
    def address(self) -> str:
        """Return the URL that the view shows, or `""`."""
        return ""

    def afterword(self) -> str:
        """Return the sentence to print after it has ended, or `""`."""
        return ""
