"""Drivers of robots: commands, reports, and the installed drivers by name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from pointit.geometry.vector import Vec3
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import RobotKind


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSpec:
    """The robot that a driver is for, as configured for its service."""

    name: str
    """Unique on the site."""
    kind: RobotKind
    start_m: Vec3
    """Place at the start, for drivers that cannot ask the robot."""
    start_yaw_rad: float
    radius_m: float
    hover_m: float
    """Height of a quadrotor's take-off."""
    max_speed_mps: float
    max_acceleration_mps2: float


@dataclass(frozen=True, slots=True)
class RobotReport:
    """Pose of the robot. All places and angles are in the driver's frame, which the service converts."""

    stamp_ns: int
    """Time of the pose by the driver's clock, `Surroundings.clock`."""
    position_m: Vec3
    yaw_rad: float = 0.0
    velocity_mps: Vec3 = (0.0, 0.0, 0.0)
    position_sigma_m: float | None = None
    """1 sigma along the worst direction, if known."""
    is_flying: bool = False
    """True from leaving the ground until it has landed."""
    battery: float | None = None
    """Charge, 0 to 1, if known."""
    has_other_master: bool = False
    """True while it does what somebody else than PointIt has ordered: the driver leaves it alone."""


@dataclass(frozen=True, slots=True)
class OrderStatus:
    """Progress or result of a command."""

    order: int
    """Number of the command."""
    state: Literal["accepted", "active", "done", "cancelled", "refused", "failed"]
    reason: str = ""
    """Reason of a refusal or failure, for the person who steers."""


@dataclass(frozen=True, slots=True)
class LinkLost:
    """The robot is not connected. The next `RobotReport` ends that."""

    reason: str
    """A sentence for health: what, where, what to do."""


ReportItem = RobotReport | OrderStatus | LinkLost

Report = Callable[[ReportItem], None]
"""Callback for reports of the driver, called in the event loop."""


@dataclass(frozen=True, slots=True)
class Follow:
    """Go to a moving position. Up to 50 such commands arrive per second. They need no status."""

    order: int
    position_m: Vec3
    yaw_rad: float | None = None
    """Direction to face, or None for any."""
    max_speed_mps: float | None = None
    """Limit beneath that of the robot, or None."""


@dataclass(frozen=True, slots=True)
class FollowPath:
    """Go along points in order, and stay at the last one. The command is done on arrival there."""

    order: int
    points_m: tuple[Vec3, ...]
    """At least one."""
    yaw_rad: float | None = None
    """Direction to face at the end, or None for any."""
    max_speed_mps: float | None = None
    """Limit beneath that of the robot, or None."""


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Rise from the ground. Done when it hovers."""

    order: int
    height_m: float
    """Above the ground."""


@dataclass(frozen=True, slots=True)
class Land:
    """Come down, and switch the rotors off. Done when it stands."""

    order: int
    position_m: Vec3 | None = None
    """Place on the ground, to fly over first, or None: where it is."""
    max_speed_mps: float | None = None
    """Limit beneath that of the robot, or None."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Come to rest as fast as is safe, forget everything ordered before, and stay: a quadrotor hovers."""

    order: int


Command = Follow | FollowPath | TakeOff | Land | Stop
"""An order. `order` rises with each; the newest replaces all before."""


class RobotDriver(Protocol):
    """A connection to one robot.

    The robot moves by commands only. If commands of `Follow` cease, it stays at the last place.
    """

    async def run(self, report: Report) -> None:
        """Report until cancelled, at 10 Hz or more while connected.

        A driver waits for its robot and connects again by itself; meanwhile it reports `LinkLost`. It carries
        out no command that was given before it was connected, but `Stop` and `Land`.
        """
        ...

    def command(self, command: Command) -> None:
        """Carry out `command`, which replaces those before. Returns at once. Called in the event loop."""
        ...


def _accept(_config: Any) -> None:
    """Accept any parameters."""


@dataclass(frozen=True, kw_only=True)
class RobotPlugin(DevicePlugin):
    """A kind of robot, or of connection to robots. The robot's service restarts a driver that fails."""

    make: Callable[[Any, RobotSpec, Surroundings], RobotDriver]
    """Makes a driver with parameters of the class `config`; opens nothing yet. Raises ConfigError if they
    cannot work."""
    check: Callable[[Any], None] = _accept
    """Raises ConfigError if parameters cannot work, as far as can be said without the robot."""


ROBOTS = PluginGroup("pointit.robots", RobotPlugin, "robot driver")
