"""Context shared by both directions of the bridge.

No core: it holds the bus.
"""

from dataclasses import dataclass

from pointit.bridges.ros2.graph.backend import Backend
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Clock


@dataclass(frozen=True, kw_only=True)
class RosSite:
    """Our bus and time, the ROS graph, and the state of both."""

    bus: ServiceBus
    clock: Clock
    backend: Backend
    state: ConversionState
