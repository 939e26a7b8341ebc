"""State of the site for conversions: the newest messages, in the form in which they are converted."""

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pointit.bridges.ros2.routing.names import Frames, RosNames
from pointit.bridges.ros2.routing.uids import Kinds, Uids
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Environment,
    Hover,
    ImuSample,
    Interaction,
    Message,
    RobotPlan,
    RobotState,
    Selection,
    Steering,
    TrackedObject,
    TrackedObjects,
    UserPose,
    UserProfile,
    topics,
)
from pointit.schemas.pointing import SurfaceKind
from pointit.schemas.topics import Topic

if TYPE_CHECKING:
    from pointit.forearm.forearm_yaw import ForearmYaw


PersonSays = Cursor | Hover | UserPose | UserProfile | Interaction | ImuSample | Steering

KINDS = ("blue", "red", "green", "yellow", "orange", "purple")
"""Kinds by the ROS toolkit's numbers: 0 and 1 as in its feeders, the others arbitrary."""

DEFAULT_PROFILE = UserProfile(stamp_ns=0)
"""Profile of a person who has not published one."""

POINTS_NS = NS_PER_S // 2
"""A person without a cursor for this long does not point."""
MAX_TRACKER_AGE_NS = NS_PER_S
"""A tracker silent for this long tracks nothing."""
STEEP_RAD = math.radians(60.0)
"""Elevation of an arm, up or down, from which its azimuth does not show where the person faces."""

INPUT_TOPICS: tuple[Topic[Any], ...] = (
    *(topics.CURSOR, topics.HOVER, topics.POSE, topics.PROFILE, topics.INTERACTION, topics.OBJECTS),
    *(topics.SELECTION, topics.MAP, topics.ROBOT_STATE, topics.ROBOT_PLAN, topics.STEERING, topics.IMU),
)
"""Topics that the scene is built from."""


@dataclass(slots=True)
class RosPerson:
    """Last messages of one person."""

    profile: UserProfile = DEFAULT_PROFILE
    pose: UserPose | None = None
    cursor: Cursor | None = None
    cursor_ns: int = 0
    """Arrival of the cursor."""
    hover: Hover | None = None
    steering: Steering | None = None
    is_here: bool = False
    """True if the site announces them."""
    arm: Vec3 | None = None
    """Direction of the arm in {H}, a unit vector."""
    facing_rad: float = 0.0
    """Azimuth in {H} of the arm when it was last raised or lowered less than `STEEP_RAD`."""
    is_pointing: bool = True
    """True until a message says otherwise."""
    tf_until_ns: int = 0
    """Until then another ROS node is expected to publish their frame."""
    forearm_yaw: "ForearmYaw | None" = None
    """Yaw of {H} by a marker body on the forearm, None if no such body is published."""

    def hear(self, message: PersonSays, now_ns: int) -> None:
        """Store a message that came at `now_ns`."""
        match message:
            case Cursor():
                self.cursor = message
                self.cursor_ns = now_ns
            case Hover():
                self.hover = message
            case UserPose():
                self.pose = message
            case UserProfile():
                self.profile = message
            case Steering():
                self.steering = message
            case Interaction():
                self.is_pointing = message.state == "pointing"
            case ImuSample():
                if self.forearm_yaw is not None:
                    stamp_ns = message.stamp_ns
                    epoch = message.yaw_epoch
                    self.forearm_yaw.add_arm(stamp_ns, message.orientation_xyzw, epoch)
                self.arm = rotation.rotate(message.orientation_xyzw, (1.0, 0.0, 0.0))
                if abs(vector.elevation(self.arm)) < STEEP_RAD:
                    self.facing_rad = vector.azimuth(self.arm)


@dataclass(slots=True)
class RosUser:
    """A user with ROS nodes only."""

    has_new_input: bool = False
    """A message about them has come since the last check."""
    is_subscribed: bool = False
    """They want a cursor."""
    is_here: bool = False
    """The site knows of them."""


class ConversionState:
    """The newest of everything; messages are stored here before they are converted."""

    def __init__(self, types: Types, *, world: str = "world") -> None:
        """Create an empty state; `world` is the name of the frame {W}."""
        self.types = types
        self.names = RosNames()
        self.frames = Frames(self.names, world)
        self.kinds = Kinds(KINDS)
        self.uids = Uids()
        """Numbers of objects."""
        self.channels = Uids(255)
        """Numbers of strips."""
        self.now_ns = 0
        """The site's time."""
        self.people: dict[str, RosPerson] = {}
        self.ros_users: dict[str, RosUser] = {}
        """All ROS-only users, present or not, without those who have PointIt services."""
        self.selection: Selection | None = None
        self.room: Environment | None = None
        self.lines: dict[tuple[SurfaceKind, str], Polyline] = {}
        """Belts and strips by kind and id, those that have a length."""
        self._tracked: dict[str, tuple[int, TrackedObjects]] = {}
        self._robots: dict[str, tuple[int, RobotState]] = {}
        self._plans: dict[str, RobotPlan] = {}

    def take(self, name: str, message: Message, now_ns: int) -> None:
        """Store a message that came at `now_ns`; `name` is for the placeholder of its key."""
        self.now_ns = now_ns
        match message:
            case Cursor() | Hover() | UserPose() | UserProfile() | Interaction() | ImuSample() | Steering():
                self.person(name).hear(message, now_ns)
            case TrackedObjects():
                self._tracked[name] = now_ns, message
            case RobotState():
                self._robots[name] = now_ns, message
            case RobotPlan():
                self._plans[name] = message
            case Selection():
                self.selection = message
            case Environment():
                self._set_room(message)
            case _:
                pass

    def end(self, name: str, message: Message) -> None:
        """Forget a message that is no longer valid."""
        person = self.people.get(name, RosPerson())
        match message:
            case Cursor():
                person.cursor = None
            case Hover():
                person.hover = None
            case Steering():
                person.steering = None
            case TrackedObjects():
                self._tracked.pop(name, None)
            case RobotState():
                self._robots.pop(name, None)
            case RobotPlan():
                self._plans.pop(name, None)
            case Selection():
                self.selection = None
            case _:
                pass

    def forget(self, user: str) -> None:
        """Forget a person who has left."""
        self.people.pop(user, None)

    def person(self, user: str) -> RosPerson:
        """Return the state of `user`."""
        if user not in self.people:
            self.people[user] = RosPerson()
        return self.people[user]

    def pointing(self, user: str) -> Cursor | None:
        """Return the cursor of `user` while they point."""
        person = self.people.get(user)
        if person is None or not person.is_pointing:
            return None
        if self.now_ns - person.cursor_ns > POINTS_NS:
            return None
        return person.cursor

    def tracked(self) -> Iterator[TrackedObject]:
        """Yield the objects of all trackers that are not silent, once their numbers are settled."""
        for received_ns, message in self._tracked.values():
            if self.now_ns - received_ns <= MAX_TRACKER_AGE_NS:
                for item in message.objects:
                    if self.uids.is_settled(item.id):
                        yield item

    @property
    def robots(self) -> dict[str, RobotState]:
        """Return the robots whose processes are not silent, by name."""
        states: dict[str, RobotState] = {}
        for name, (received_ns, state) in self._robots.items():
            if self.now_ns - received_ns <= MAX_TRACKER_AGE_NS:
                states[name] = state
        return states

    def plan(self, robot: str) -> RobotPlan | None:
        """Return the plan of `robot`, or None if it has published none."""
        return self._plans.get(robot)

    @property
    def lanes(self) -> tuple[str, ...]:
        """Return the lanes of the conveyor in the map's order: its belts, or its strips if there are none."""
        if self.room is None:
            return ()
        lanes = self.room.belts or self.room.strips
        return tuple(lane.id for lane in lanes)

    def _set_room(self, room: Environment) -> None:
        self.room = room
        self.lines = {}
        for belt in room.belts:
            self._add_line("belt", belt.id, belt.line_m)
        for strip in room.strips:
            self._add_line("strip", strip.id, strip.line_m)

    def _add_line(self, kind: SurfaceKind, name: str, line_m: tuple[Vec3, ...]) -> None:
        # One without a length is left out; pui warns the author of the map
        with contextlib.suppress(ValueError):
            self.lines[kind, name] = Polyline(line_m)


def lane_name(surface: SurfaceKind, surface_id: str) -> str:
    """Return the ROS toolkit's name of a line: a belt by its id, a strip used as a belt `strip_<id>`."""
    return f"strip_{surface_id}" if surface == "strip" else surface_id


def lane_of(name: str, lanes: tuple[str, ...]) -> str | None:
    """Return the lane of `lanes` that `name` means in the ROS toolkit, or None if there is none."""
    if name in lanes:
        return name
    strip = name.removeprefix("strip_")
    return strip if strip in lanes else None
