"""Drivers of robots: commands, reports and their frames, and the installed drivers by name.

No core: its drivers wait for robots.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

from pointit.geometry import vector
from pointit.geometry.rotation import inverse, rotate
from pointit.geometry.vector import Vec3
from pointit.maps.frames import point_in_world, yaw_in_world
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import FARTHEST, RobotKind
from pointit.schemas.environment import Frame

END_NS = 2**62
"""End of the times that are accepted, ns; 146 years."""


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
    """A connection to one robot that people steer by pointing: reports where it is, and carries out commands.

    The robot's service decides where a robot may go, who steers it and when it must stop; the driver only
    speaks the robot's protocol. The robot moves by commands only. If commands of `Follow` cease, it stays at
    the last place: silence is never a reason to go on.
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


def report_in_world(report: RobotReport, frame: Frame) -> RobotReport:
    """Return a report of a pose in {W}."""
    return replace(
        report,
        position_m=point_in_world(report.position_m, frame),
        velocity_mps=rotate(frame.orientation_xyzw, report.velocity_mps),
        yaw_rad=yaw_in_world(report.yaw_rad, frame),
    )


def in_frame(command: Command, frame: Frame) -> Command:
    """Return a command that is in {W} as the driver gets it."""
    match command:
        case Follow():
            place = _point(command.position_m, frame)
            yaw_rad = _yaw(command.yaw_rad, frame)
            return replace(command, position_m=place, yaw_rad=yaw_rad)
        case FollowPath():
            points = tuple(_point(point_m, frame) for point_m in command.points_m)
            yaw_rad = _yaw(command.yaw_rad, frame)
            return replace(command, points_m=points, yaw_rad=yaw_rad)
        case Land(position_m=place) if place is not None:
            return replace(command, position_m=_point(place, frame))
        case _:
            return command


def _point(point_m: Vec3, frame: Frame) -> Vec3:
    frame_from_world = inverse(frame.orientation_xyzw)
    offset = vector.subtract(point_m, frame.position_m)
    return rotate(frame_from_world, offset)


def _yaw(yaw_rad: float | None, frame: Frame) -> float | None:
    if yaw_rad is None:
        return None
    frame_from_world = inverse(frame.orientation_xyzw)
    front = vector.direction(yaw_rad, 0.0)
    return vector.azimuth(rotate(frame_from_world, front))


def _is_usable(number: float) -> bool:
    return math.isfinite(number) and abs(number) <= FARTHEST


def report_fault(report: RobotReport) -> str:
    """Return the reason not to use `report`, or `""`."""
    numbers = (*report.position_m, *report.velocity_mps, report.yaw_rad)
    if len(numbers) != 7 or not all(map(_is_usable, numbers)):
        return (
            "the robot reports a pose or velocity that is no number or too large; it is not used: look at "
            "its localization"
        )
    sigma_m = report.position_sigma_m
    if sigma_m is not None and not 0.0 <= sigma_m <= FARTHEST:
        return (
            f"the robot reports an uncertainty of {sigma_m:g} m; its report is not used: look at its driver"
        )
    if report.battery is not None and not 0.0 <= report.battery <= 1.0:
        return f"the robot reports a charge of {report.battery:g}; its report is not used: look at its driver"
    if not 0 <= report.stamp_ns < END_NS:
        return f"the robot reports the time {report.stamp_ns} ns; its report is not used: look at its clock"
    return ""
