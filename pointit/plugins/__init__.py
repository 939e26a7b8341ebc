"""Names for authors of plug-ins: parts that any installed package can add to PointIt.

A plug-in is one object and one line in the `pyproject.toml` of its package. The line gives it a name:

    [project.entry-points."pointit.imu_sources"]
    waving = "my_package:WAVING"

The object says what it is, in one line, which parameters it has, and how it is made from their values:

    class WavingConfig(Config):
        rate_hz: float = Field(50, gt=0, le=200, description="samples per second")

    class Waving:
        def __init__(self, config: WavingConfig, surroundings: Surroundings) -> None:
            self._config, self._clock = config, surroundings.clock

        async def run(self, deliver: Deliver) -> None:
            async for now_ns in ticks(self._clock, self._config.rate_hz):
                azimuth_rad = 0.5 * math.sin(now_ns / NS_PER_S)
                deliver(Reading(now_ns, rotation.from_azimuth_elevation(azimuth_rad, 0.0)))

    WAVING = ImuSource(summary="an arm that waves", config=WavingConfig, make=Waving)

Then `pointit run --imu waving` uses it, `--set imu-bridge.waving.rate_hz=100` sets its parameter, and
`pointit plugin list` shows it. The kinds, with the group of their entry points:

- `ImuSource` (`pointit.imu_sources`): a device that gives the orientation of a person's arm.
- `LedOutput` (`pointit.led_outputs`): a controller of strips (`Output`), of single lamps (`LampOutput`), or
  of a beam (`BeamOutput`). `UdpOutput` and `SerialOutput` do all of it but the bytes of the protocol.
- `SelectionMethod` (`pointit.selection_methods`): decides when pointing at an object selects it.
- `RobotPlugin` (`pointit.robots`): a connection to a robot that people steer (`RobotDriver`).
- `ServicePlugin` (`pointit.services`): a process with a bus, and topics and requests of its own.
- `RecogniserPlugin` (`pointit.recognisers`): turns what a microphone hears into words (`Recogniser`).

A service that shows a site keeps a `SiteState`: its newest messages, without those that are no longer valid.
One that moves a machine to where people point keeps `PointingPeople`: their rays, and whose turn it is. A
simulated person with a behaviour of your own is a `UserSim`.

A plug-in gets the values of its parameters, already validated, and its `Surroundings`: the clock of all
stamps, health, in which it reports problems and metrics, and a folder for what it stores. It has no bus. Only
a service has one: `make` is its class, and its `Context` holds the bus and the clock.

The field `discover` of a source or an output, if it has one, is a function that finds such devices within
reach, for `pointit devices`.

Its code runs in the event loop of a service, beside that of others, so it must not block: blocking calls go
to a thread (`asyncio.to_thread`). `run` ends when it is cancelled, within a second, and at no other time:
a plug-in waits and connects again by itself if its device is gone.
"""

import importlib
from typing import TYPE_CHECKING, Any

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.runtime.address_config import AddressConfig, format_address
from pointit.runtime.bus.contract import Subscription
from pointit.runtime.clock import Clock, Timer, sleep, ticks
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, Discover, FoundDevice, Plugin, PluginGroup
from pointit.runtime.errors import ConfigError, ListenError, RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.person_messages import PersonMessages
from pointit.runtime.service.plugin_guard import HealthSink, Surroundings
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Feedback,
    Message,
    Query,
    Reply,
    SelectionEvent,
    Speech,
    Strip,
    StripFrame,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    Word,
    topics,
)
from pointit.schemas.topics import Delivery, Request, Topic
from pointit.services.imu_bridge.sources import (
    SOURCES,
    Battery,
    CueSource,
    Deliver,
    Disconnected,
    ImuSource,
    Item,
    Press,
    RawReading,
    Reading,
    Reconnected,
    Signal,
    Source,
    StepGesture,
)
from pointit.services.led_driver.outputs import (
    OUTPUTS,
    AnyOutput,
    BeamOutput,
    LampOutput,
    LedOutput,
    Output,
    OutputConfig,
    Segment,
)
from pointit.services.robot.robot_driver import (
    ROBOTS,
    Command,
    Follow,
    FollowPath,
    Land,
    LinkLost,
    OrderStatus,
    Report,
    ReportItem,
    RobotDriver,
    RobotPlugin,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)
from pointit.services.selector.seen_objects import View
from pointit.services.selector.selection_methods import (
    METHODS,
    MethodConfig,
    PersonMethod,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
)
from pointit.services.service_plugin import SERVICES, ServicePlugin
from pointit.site.following import follow_site, follow_topics
from pointit.site.pointing_people import PersonRay, PointingPeople
from pointit.site.site_state import Change, SiteState
from pointit.speech.grammar import Vocabulary
from pointit.speech.recogniser import RECOGNISERS, Audio, Recogniser, RecogniserPlugin

if TYPE_CHECKING:
    from pointit.services.led_driver.output.pixel_output import PixelOutput
    from pointit.services.led_driver.output.serial_output import SerialOutput, SerialOutputConfig
    from pointit.services.led_driver.output.udp_output import Datagram, UdpOutput, UdpOutputConfig
    from pointit.services.user_sim.config import UserSimConfig
    from pointit.services.user_sim.goal import PersonGoal
    from pointit.services.user_sim.service import UserSim

_LED_OUTPUT = "pointit.services.led_driver.output"
_HOMES = {
    "Datagram": f"{_LED_OUTPUT}.udp_output",
    "PersonGoal": "pointit.services.user_sim.goal",
    "PixelOutput": f"{_LED_OUTPUT}.pixel_output",
    "SerialOutput": f"{_LED_OUTPUT}.serial_output",
    "SerialOutputConfig": f"{_LED_OUTPUT}.serial_output",
    "UdpOutput": f"{_LED_OUTPUT}.udp_output",
    "UdpOutputConfig": f"{_LED_OUTPUT}.udp_output",
    "UserSim": "pointit.services.user_sim.service",
    "UserSimConfig": "pointit.services.user_sim.config",
}
"""Modules that are loaded at the first use of a name: they take long, and few plug-ins need them."""

__all__ = [
    "GROUPS",
    "NS_PER_S",
    "AddressConfig",
    "AnyOutput",
    "Audio",
    "Battery",
    "BeamOutput",
    "Change",
    "Clock",
    "Command",
    "Config",
    "ConfigError",
    "Context",
    "CueSource",
    "Cursor",
    "Datagram",
    "Deliver",
    "Delivery",
    "DevicePlugin",
    "Disconnected",
    "Discover",
    "Feedback",
    "Follow",
    "FollowPath",
    "FoundDevice",
    "HealthSink",
    "ImuSource",
    "Item",
    "LampOutput",
    "Land",
    "LedOutput",
    "LinkLost",
    "ListenError",
    "Message",
    "MethodConfig",
    "OrderStatus",
    "Output",
    "OutputConfig",
    "PersonGoal",
    "PersonMessages",
    "PersonMethod",
    "PersonRay",
    "PixelOutput",
    "Plugin",
    "PluginGroup",
    "PointingPeople",
    "PointingSample",
    "Press",
    "Quaternion",
    "Query",
    "RawReading",
    "Reading",
    "Recogniser",
    "RecogniserPlugin",
    "Reconnected",
    "RefusedError",
    "Reply",
    "Report",
    "ReportItem",
    "Request",
    "RobotDriver",
    "RobotPlugin",
    "RobotReport",
    "RobotSpec",
    "Scope",
    "Segment",
    "SelectionEvent",
    "SelectionMethod",
    "SelectionProgress",
    "SerialOutput",
    "SerialOutputConfig",
    "Service",
    "ServicePlugin",
    "Signal",
    "SiteState",
    "Source",
    "Speech",
    "StateFile",
    "StepGesture",
    "Stop",
    "Strip",
    "StripFrame",
    "StripsFrame",
    "Subscription",
    "Surroundings",
    "TakeOff",
    "Timer",
    "Topic",
    "TrackedObject",
    "TrackedObjects",
    "UdpOutput",
    "UdpOutputConfig",
    "UserSim",
    "UserSimConfig",
    "View",
    "Vocabulary",
    "Word",
    "follow_site",
    "follow_topics",
    "format_address",
    "rotation",
    "sleep",
    "ticks",
    "topics",
    "vector",
]
GROUPS: dict[str, PluginGroup[Any]] = {
    "imu-source": SOURCES,
    "led-output": OUTPUTS,
    "recogniser": RECOGNISERS,
    "robot": ROBOTS,
    "selection-method": METHODS,
    "service": SERVICES,
}
"""Installed plug-ins by kind, of those that `pointit plugin check` can check."""


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
