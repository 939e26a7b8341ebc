"""Surroundings: the interface of a service to its plug-ins."""

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
        """Show `sentence` (problem and remedy) until `clear(topic)`. `""` also clears it."""
        ...

    def clear(self, topic: str) -> None:
        """Clear the warning."""
        ...


class HealthSink(WarningSink, Protocol):
    """Receiver of a plug-in's warnings and metrics."""

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric, as in `("battery", 82.0, "%")`. None removes it."""
        ...

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data when its effect becomes visible."""
        ...


class PluginHealth:
    """One plug-in's part of a service's health. It cannot change the entries of others."""

    def __init__(self, health: ServiceBus, part: str) -> None:
        """Show warnings and metrics of the plug-in `part` in `health`. `part` is unique in the service."""
        self._health = health
        self._part = part

    def warn(self, topic: str, sentence: str) -> None:
        """Show a warning until it is cleared, by `clear` or `""`."""
        self._health.warn(self._topic(topic), str(sentence))

    def clear(self, topic: str) -> None:
        """Clear a warning."""
        self._health.clear(self._topic(topic))

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric, with the plug-in's name if another part of the service has one of this name."""
        self._health.set_metric(name, value, unit, self._part)

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data when its effect becomes visible."""
        self._health.reached(latency_s)

    def _topic(self, topic: str) -> str:
        return warning_topics(self._part) + topic


def warning_topics(part: str) -> str:
    """Return the prefix of the warning topics of the plug-in `part`."""
    return f"plug-in {part}: "


class NullHealth:
    """Health sink that discards all entries."""

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
    """Clock of all stamps. A plug-in never reads the operating system's clock."""
    health: HealthSink
    """Receiver of its warnings and metrics, which `pointit doctor` shows."""
    folder: Path
    """Folder for data that it stores between runs. It may not exist yet."""
    user: str = ""
    """User that owns it, or `""` if all users of the site share it."""
    sensor_from_arm: Quaternion = rotation.IDENTITY
    """IMU sources: the configured mounting of the sensor."""

    def state_file(self, model: type[T]) -> StateFile[T]:
        """Return the plug-in's stored value: a `model` in the file `state.json` of its folder."""
        return StateFile[T].at(self.folder / "state.json", model)

    @classmethod
    def detached(cls, user: str = "") -> Self:
        """Return surroundings outside a site, with wall time and a health sink that discards all entries."""
        folder = state_directory() / "detached" / user
        return cls(clock=WallClock(), health=NullHealth(), folder=folder, user=user)
