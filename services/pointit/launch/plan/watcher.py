"""Observation and score of a run beside those of people and objects."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment

OnEvent: TypeAlias = Callable[[str, str], object]
"""Takes an event line and the person whom it is about, `""` for nobody."""


class Watcher(Protocol):
    """Observes one scenario, from its start to its end."""

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`, and tell `on_event`. Return the subscriptions."""
        ...

    def on_map(self, environment: Environment) -> None:
        """Take the map."""
        ...

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Take the presence of a service."""
        ...

    def summary(self) -> Mapping[str, Any]:
        """Return its entries in the summary of the run, by names that no other watcher has."""
        ...


MakeWatcher: TypeAlias = Callable[[Sequence[Launch]], Watcher]
"""Returns the watcher of the scenario that runs these services."""
