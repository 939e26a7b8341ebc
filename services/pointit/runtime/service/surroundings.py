"""Surroundings: the part of a service that its plug-ins may use."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self, TypeVar

from pydantic import BaseModel

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Clock, WallClock
from pointit.runtime.host.state_file import StateFile, state_directory

T = TypeVar("T", bound=BaseModel)


class WarningSink(Protocol):
    """Shows and clears warnings of a part of a service, such as `ServiceBus`."""

    def warn(self, topic: str, sentence: str) -> None:
        """Show `sentence` (what is wrong, what to do) until `clear(topic)`. `""` clears it, too."""
        ...

    def clear(self, topic: str) -> None:
        """Take the warning back."""
        ...


class HealthSink(WarningSink, Protocol):
    """Receiver of a plug-in's warnings and metrics."""

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric, as in `("battery", 82.0, "%")`. None removes it."""
        ...

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data at the moment at which it becomes visible."""
        ...


class PluginHealth:
    """Part of a service's health that is one plug-in's: what others show there, it cannot change."""

    def __init__(self, health: ServiceBus, part: str) -> None:
        """Show what the plug-in `part`, which no other of the service is called, has to say in `health`."""
        self._health = health
        self._part = part

    def warn(self, topic: str, sentence: str) -> None:
        """Show a warning until it is cleared, by `clear` or `""`."""
        self._health.warn(self._topic(topic), str(sentence))

    def clear(self, topic: str) -> None:
        """Take a warning back."""
        self._health.clear(self._topic(topic))

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric, with the plug-in's name if another part of the service has one of this name."""
        self._health.set_metric(name, value, unit, self._part)

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data at the moment at which it becomes visible."""
        self._health.reached(latency_s)

    def _topic(self, topic: str) -> str:
        return warning_topics(self._part) + topic


def warning_topics(part: str) -> str:
    """Return the beginning of the topics of the warnings of the plug-in `part`."""
    return f"plug-in {part}: "


class NullHealth:
    """Health that nobody reads."""

    def warn(self, topic: str, sentence: str) -> None:
        """Discard a warning."""

    def clear(self, topic: str) -> None:
        """Discard the end of a warning."""

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Discard a metric."""

    def reached(self, latency_s: float) -> None:
        """Discard a latency."""


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """The part of a service that its plug-in may use: time, health, stored state. It has no bus."""

    clock: Clock
    """Time of all stamps. A plug-in never asks the operating system."""
    health: HealthSink
    """Its problems and metrics, shown by `pointit doctor`."""
    folder: Path
    """Its own folder for what it stores between runs. It need not exist yet."""
    user: str = ""
    """The person whose part it is, or `""` if it is shared by all people of the site."""
    sensor_from_arm: Quaternion = rotation.IDENTITY
    """IMU sources: the configured mounting of the sensor."""

    def state_file(self, model: type[T]) -> StateFile[T]:
        """Return the one stored value of the plug-in, a `model` in the file `state.json` of its folder."""
        return StateFile[T].at(self.folder / "state.json", model)

    @classmethod
    def detached(cls, user: str = "") -> Self:
        """Return surroundings outside a site: wall time, and health that nobody reads."""
        folder = state_directory() / "detached" / user
        return cls(clock=WallClock(), health=NullHealth(), folder=folder, user=user)
