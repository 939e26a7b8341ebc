"""Readings of a source of orientations, which of them are refused, and the sources by name.

No core: its sources wait for devices.
"""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import NS_PER_S, Feedback
from pointit.schemas.base import NORM_TOLERANCE

MAX_ITEMS_PER_S = 1000
"""Items per second of the clock beyond which the rest of that second is refused."""
MAX_RATE_RADPS = 100.0
"""Largest angular velocity of a raw reading, rad/s; gyroscopes reach 70."""
MAX_ACCELERATION_MPS2 = 1000.0
"""Largest acceleration of a raw reading, m/s²; accelerometers of wrists reach 314."""
END_NS = 2**62
"""End of the times that are accepted, ns; 146 years."""
SHOWN_NS = 5 * NS_PER_S
"""Time for which a problem is reported, ns."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One orientation of the sensor."""

    stamp_ns: int
    """Host time of arrival, or of capture if the source knows it."""
    world_from_sensor: Quaternion
    """Rotates vectors of the sensor into a frame with z up and a yaw origin of its own; x, y, z, w."""
    device_time_ns: int | None = None
    """The device's own clock at capture, if it states one. imu-bridge converts it to host time."""


@dataclass(frozen=True, slots=True)
class RawReading:
    """Angular velocity and acceleration; imu-bridge computes the orientation (extra `fusion`)."""

    stamp_ns: int
    """Host time of arrival."""
    angular_velocity_radps: Vec3
    """In the sensor's frame, rad/s."""
    acceleration_mps2: Vec3
    """In the sensor's frame, with gravity: (0, 0, +9.81) at rest with z up, m/s²."""
    device_time_ns: int | None = None
    """The device's own clock at capture, if it states one. It makes the orientation more accurate."""


@dataclass(frozen=True, slots=True)
class Battery:
    """Charge of the device, delivered when it is read or changes."""

    level: float
    """0 (empty) to 1 (full)."""
    volts: float | None = None


@dataclass(frozen=True, slots=True)
class Signal:
    """Strength of the radio signal (RSSI)."""

    dbm: float


@dataclass(frozen=True, slots=True)
class Press:
    """A gesture on the device's button."""

    stamp_ns: int
    gesture: Literal["press", "double", "hold"] = "press"


@dataclass(frozen=True, slots=True)
class StepGesture:
    """A step of the device's crown, or a swipe on it."""

    stamp_ns: int
    by: Literal[-1, 1]
    """1: to the right, -1: to the left."""


@dataclass(frozen=True, slots=True)
class Reconnected:
    """The device was connected, perhaps again: it may have been restarted, or be another one."""

    keeps_yaw: bool = False
    """True if its yaw origin is certainly the same: its clock or packet counter shows that it ran on."""


@dataclass(frozen=True, slots=True)
class Disconnected:
    """The device was lost."""

    reason: str
    """A sentence for health: what, where, what to do."""


Item = Reading | RawReading | Press | StepGesture | Battery | Signal | Reconnected | Disconnected
Deliver = Callable[[Item], None]
"""Callback for readings and events of the device, called in the event loop."""


class Source(Protocol):
    """A source of orientations."""

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        ...


@runtime_checkable
class CueSource(Source, Protocol):
    """A source whose device can vibrate or light up."""

    def cue(self, cue: Feedback) -> None:
        """Play `cue` (`haptic_ms`, `color`) on the device at once, without blocking.

        Without a connection it is dropped. Called in the event loop, also before `run`.
        """
        ...


class ReadingCheck:
    """Refuses readings that would harm the person's other services, with the reason."""

    def __init__(self) -> None:
        self.is_refused = False
        """True if the last item must not be used."""
        self._second = 0
        self._count = 0
        self._problem = ""
        self._problem_ns = 0

    def problem(self, item: Item, now_ns: int) -> str:
        """Check `item`, delivered at `now_ns`. Return the problem of the last seconds, or `""`."""
        second = now_ns // NS_PER_S
        if second != self._second:
            self._second = second
            self._count = 0
        self._count += 1
        if self._count > MAX_ITEMS_PER_S:
            new_problem = f"delivers more than {MAX_ITEMS_PER_S} readings a second; the rest is dropped"
        else:
            new_problem = fault(item)
        self.is_refused = bool(new_problem)
        if new_problem:
            self._problem = new_problem
            self._problem_ns = now_ns
        elif self._problem and not 0 <= now_ns - self._problem_ns < SHOWN_NS:
            self._problem = ""
        return self._problem


def fault(item: Item) -> str:
    """Return an error message if the values of `item` cannot be used, else `""`."""
    if isinstance(item, Reading):
        norm = math.hypot(*item.world_from_sensor)
        if not abs(norm - 1.0) <= NORM_TOLERANCE:  # also if it is not a number
            return f"delivers orientations of norm {norm:.3g}; they are dropped: it must be 1"
        return time_fault(item.stamp_ns, item.device_time_ns)
    if isinstance(item, RawReading):
        rate_radps = math.hypot(*item.angular_velocity_radps)
        acceleration_mps2 = math.hypot(*item.acceleration_mps2)
        if not (rate_radps <= MAX_RATE_RADPS and acceleration_mps2 <= MAX_ACCELERATION_MPS2):
            return (
                f"delivers {rate_radps:.3g} rad/s and {acceleration_mps2:.3g} m/s²; such readings are "
                "dropped: check its units"
            )
        return time_fault(item.stamp_ns, item.device_time_ns)
    if isinstance(item, Press | StepGesture):
        return time_fault(item.stamp_ns, None)
    if isinstance(item, Battery) and not 0.0 <= item.level <= 1.0:
        return f"delivers a battery level of {item.level:.7g}; it is dropped: it must be 0 to 1"
    if isinstance(item, Signal) and not math.isfinite(item.dbm):
        return f"delivers a signal of {item.dbm:.3g} dBm; it is dropped"
    return ""


def time_fault(stamp_ns: int, device_ns: int | None) -> str:
    """Return an error message if a time does not fit messages, else `""`."""
    is_device_time_valid = device_ns is None or 0 <= device_ns < END_NS
    if 0 <= stamp_ns < END_NS and is_device_time_valid:
        return ""
    device_time = "" if device_ns is None else f" and {device_ns} ns of its own clock"
    return f"delivers the time {stamp_ns} ns{device_time}; such items are dropped: times are 0 to 2^62 ns"


def _accept(_config: Any) -> None:
    """Accept any parameters."""


@dataclass(frozen=True, kw_only=True)
class ImuSource(DevicePlugin):
    """A kind of device that gives the orientation of a person's arm: a watch, an IMU on a cable, a recording.

    It is a plug-in: one object that says what the device is, which parameters it has, and how a `Source` is
    made from their values. The source then delivers `Reading`s, each an orientation of the sensor in the
    world with the time of its capture; everything after that (the arm's frame, refused readings, health) is
    done for it. `pointit.plugins` has a complete example, and `pointit plugin new imu-source` writes one with
    its test.
    """

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
