"""What running services share: bus, clock, configuration, logs, health, life and end."""

from pointit.runtime.bus import Bus, Closable, Publisher, Subscription, Traffic
from pointit.runtime.clock import (
    Clock,
    SimulatedClock,
    SiteClock,
    WallClock,
    keep_time,
    sleep,
    ticks,
)
from pointit.runtime.config import Config
from pointit.runtime.errors import (
    BusClosedError,
    BusError,
    ConfigError,
    ConnectError,
    ListenError,
    NoAnswerError,
    PointItError,
    RefusedError,
    RequestError,
)
from pointit.runtime.exchange import Exchange
from pointit.runtime.memory_bus import MemoryBus
from pointit.runtime.presence import present
from pointit.runtime.service import (
    AnyService,
    Context,
    Launch,
    Service,
    check_launches,
    run_service,
    run_services,
)

__all__ = [
    "AnyService",
    "Bus",
    "BusClosedError",
    "BusError",
    "Clock",
    "Closable",
    "Config",
    "ConfigError",
    "ConnectError",
    "Context",
    "Exchange",
    "Launch",
    "ListenError",
    "MemoryBus",
    "NoAnswerError",
    "PointItError",
    "Publisher",
    "RefusedError",
    "RequestError",
    "Service",
    "SimulatedClock",
    "SiteClock",
    "Subscription",
    "Traffic",
    "WallClock",
    "check_launches",
    "keep_time",
    "present",
    "run_service",
    "run_services",
    "sleep",
    "ticks",
]
