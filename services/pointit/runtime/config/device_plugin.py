"""Plug-ins that are devices, and the search for those that are within reach."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field

from pointit.runtime.config.plugins import Plugin


@dataclass(frozen=True)
class FoundDevice:
    """A device that a search has found."""

    address: str
    """Text behind `--imu NAME:` or `--leds NAME:` that chooses it, or `""` if the name alone does."""
    label: str
    """Description for people, such as model, name, battery and signal."""
    details: Mapping[str, str | float] = field(default_factory=dict[str, str | float])
    """Values for programs by name, with the unit in the name, such as `rssi_dbm`."""


Discover = Callable[[float], Awaitable[Sequence[FoundDevice]]]
"""Search for devices for a number of seconds.

It returns all that it found, none if nothing is there, and ends when it is cancelled. It must not block the
event loop. It raises ConfigError, with what to do, if it cannot search: an extra or an adapter is missing.
"""


@dataclass(frozen=True, kw_only=True)
class DevicePlugin(Plugin):
    """A kind of device."""

    discover: Discover | None = None
    """Finds devices of this kind that are within reach. None if there is no way to find them."""
