"""Sources of orientations by name: ours, and those of installed packages."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup
from pointit.runtime.service.surroundings import Surroundings
from pointit.services.imu_bridge.reading import Deliver, Source


def _accept(_config: Any) -> None:
    """Accept any parameters."""


@dataclass(frozen=True, kw_only=True)
class ImuSource(DevicePlugin):
    """A kind of device that gives the arm's orientation."""

    make: Callable[[Any, Surroundings], Source]
    """Makes a source with parameters of the class `config`; raises ConfigError if they cannot work."""
    check: Callable[[Any], None] = _accept
    """Raises ConfigError if parameters cannot work, as far as can be said without the device."""


SOURCES = PluginGroup("pointit.imu_sources", ImuSource, "IMU source")


class NoDevice:
    """A source without readings, used if only a page or ROS moves the wrist."""

    async def run(self, deliver: Deliver) -> None:  # noqa: ARG002 - the protocol's signature
        """Wait until cancelled."""
        await asyncio.Event().wait()


PAGE = ImuSource(
    summary="only a page's mouse or phone, or ROS; every source accepts them too",
    config=Config,
    make=lambda _config, _surroundings: NoDevice(),
)
