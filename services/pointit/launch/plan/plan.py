"""Everything a run needs to know, decided before it starts."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeAlias

from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment, RunScenario

OnEvent: TypeAlias = Callable[[str, str], object]
"""Takes an event line and the person whom it is about, `""` for nobody."""


class Watcher(Protocol):
    """Observes one scenario, from its start to its end."""

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`, and tell `on_event`. Return the subscriptions."""
        ...

    def on_map(self, environment: Environment) -> None:
        """Handle the map."""
        ...

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Handle a change of a service's presence."""
        ...

    def summary(self) -> Mapping[str, Any]:
        """Return its entries in the summary of the run, by names that no other watcher has."""
        ...


MakeWatcher: TypeAlias = Callable[[Sequence[Launch]], Watcher]
"""Returns the watcher of the scenario that runs these services."""


class Beside(ABC):
    """A service beside the scenario, which keeps running when that changes."""

    WHAT: ClassVar[str]
    """Common noun in messages, such as `page`."""
    WAIT_S: ClassVar[float] = 0.0
    """The scenario waits until it is present, at most for this time, and ends before it. 0: it is started in
    the background after the scenario."""
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

    def closing_note(self) -> str:
        """Return the sentence to print after it has ended, or `""`."""
        return ""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run needs to know."""

    name: str
    launches: Sequence[Launch]
    """Services of the scenario or the person, without those beside it."""
    link: Link
    target_kinds: Sequence[str] = ()
    seed: int = 0
    duration_s: float | None = None
    is_limited: bool = False
    """The duration was requested: the run ends then, even with viewers."""
    speed: float = 1.0
    processes: bool = False
    may_move: bool = False
    """The listen address is only the default: use the next port if it is in use."""
    scored: bool = True
    """A whole scenario: print a summary at the end, and fail if there was no cursor."""
    view: bool = True
    person: str = ""
    """The only person whose activity is reported and drawn, or `""` for all."""
    notes: Sequence[str] = ()
    """Messages to print at the start."""
    closing_note: str = ""
    """Message to print below the summary."""
    summary: Path | None = None
    as_json: bool = False
    beside: Sequence[Beside] = ()
    """Services that stay when the scenario changes, such as a page and a recorder."""
    watchers: Sequence[MakeWatcher] = ()
    """Factories of further observers of each scenario, beside those of optional packages."""
    scenario: str = ""
    """Name of the running scenario, or `""` for one person's part."""
    scenarios: Sequence[str] = ()
    """Names of the scenarios that can be requested instead."""
    localizes: bool = False
    """People are localized by pointing at lamps."""
    another: "Callable[[RunScenario, Plan], Plan] | None" = None
    """Makes the plan that replaces the running one on request; raises ConfigError. Thread-safe."""

    @property
    def users(self) -> list[str]:
        """Return the users whose services it starts, in order."""
        return list(dict.fromkeys(launch.user for launch in self.launches if launch.user))

    @property
    def instances(self) -> list[str]:
        """Return the instance names of all that it starts."""
        return [launch.instance for launch in self.launches] + [each.instance for each in self.beside]
