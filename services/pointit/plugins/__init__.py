"""Names for authors of plug-ins: parts that any installed package can add to PointIt.

A plug-in is one object and one line in the `pyproject.toml` of its package. The line gives it a name:

    [project.entry-points."pointit.imu_sources"]
    waving = "my_package:WAVING"

The object says what it is, in one line, which parameters it has, and how it is made from their values:

    class WavingConfig(Config):
        rate_hz: float = Field(default=50, gt=0, le=200, description="samples per second")

    class Waving:
        def __init__(self, config: WavingConfig, surroundings: Surroundings) -> None:
            self._config, self._clock = config, surroundings.clock

        async def run(self, deliver: Deliver) -> None:
            async for now_ns in ticks(self._clock, self._config.rate_hz):
                azimuth_rad = 0.5 * math.sin(now_ns / NS_PER_S)
                deliver(Reading(now_ns, rotation.from_azimuth_elevation(azimuth_rad, 0.0)))

    WAVING = ImuSource(summary="an arm that waves", config=WavingConfig, make=Waving)

Then `pointit run --imu waving` uses it, `--set imu-bridge.waving.rate_hz=100` sets its parameter, and
`pointit list plugins` shows it. The kinds, with the group of their entry points:

- `ImuSource` (`pointit.imu_sources`): a device that gives the orientation of a person's arm.
- `LedOutput` (`pointit.led_outputs`): a controller that shows frames on strips.
- `SelectionMethod` (`pointit.selection_methods`): decides when pointing at an object selects it.
- `ServicePlugin` (`pointit.services`): a process with a bus, and topics and requests of its own.

A plug-in gets the values of its parameters, already validated, and its `Surroundings`: the clock of all
stamps, health, in which it reports problems and metrics, and a folder for what it stores. It has no bus. Only
a service has one: `make` is its class, and its `Context` holds the bus and the clock.

Its code runs in the event loop of a service, beside that of others, so it must not block: blocking calls go
to a thread (`asyncio.to_thread`). `run` ends when it is cancelled, within a second, and at no other time:
a plug-in waits and connects again by itself if its device is gone.
"""

from typing import Any

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import Clock, sleep, ticks
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.health.surroundings import HealthSink, Surroundings
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Context, Service
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Message,
    Query,
    Reply,
    SelectionEvent,
    Strip,
    StripFrame,
    StripsFrame,
    topics,
)
from pointit.schemas.topics import Delivery, Request, Topic
from pointit.services.imu_bridge.reading import Deliver, Item, Press, Reading, Reconnected, Source
from pointit.services.imu_bridge.sources import SOURCES, ImuSource
from pointit.services.led_driver.outputs import OUTPUTS, LedOutput, Output, OutputConfig
from pointit.services.selector.objects.view import View
from pointit.services.selector.selection_methods import (
    METHODS,
    MethodConfig,
    PersonMethod,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
)
from pointit.services.service_plugin import SERVICES, ServicePlugin

__all__ = [
    "GROUPS",
    "NS_PER_S",
    "Clock",
    "Config",
    "ConfigError",
    "Context",
    "Cursor",
    "Deliver",
    "Delivery",
    "HealthSink",
    "ImuSource",
    "Item",
    "LedOutput",
    "Message",
    "MethodConfig",
    "Output",
    "OutputConfig",
    "PersonMethod",
    "Plugin",
    "PluginGroup",
    "PointingSample",
    "Press",
    "Quaternion",
    "Query",
    "Reading",
    "Reconnected",
    "RefusedError",
    "Reply",
    "Request",
    "SelectionEvent",
    "SelectionMethod",
    "SelectionProgress",
    "Service",
    "ServicePlugin",
    "Source",
    "StateFile",
    "Strip",
    "StripFrame",
    "StripsFrame",
    "Surroundings",
    "Topic",
    "View",
    "rotation",
    "sleep",
    "ticks",
    "topics",
]

GROUPS: dict[str, PluginGroup[Any]] = {
    "imu-source": SOURCES,
    "led-output": OUTPUTS,
    "selection-method": METHODS,
    "service": SERVICES,
}
"""Installed plug-ins by kind."""
