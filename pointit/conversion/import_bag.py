"""A ROS 2 bag (SQLite or MCAP) of the ROS toolkit as entries of a recording."""

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.outbound.person import STATES
from pointit.bridges.ros2.routing.conversion_state import KINDS, lane_name
from pointit.bridges.ros2.routing.names import frame_name
from pointit.conversion.bag_file import OpenBag, is_bag, open_bag, unpack_message
from pointit.geometry import rotation, vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.recording.entries import Entry, entry
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Cursor,
    Environment,
    Hover,
    ImuSample,
    Interaction,
    Message,
    PointingRay,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
    UserPose,
    summarize_validation_error,
    topics,
)
from pointit.schemas.base import KeyNameError
from pointit.schemas.pointing import SurfaceKind
from pointit.schemas.text import system_reason
from pointit.schemas.topics import MAP, check_name

Taken = Iterator[Entry]
Stamps = Literal["header", "bag"]
"""Source of the times of capture."""
LinePlace = tuple[int, str, float]
"""Time, ns, line and arc length, m, of a package."""

TRACKER = "conveyor"
WORLD = "world"
PERSON = "/human_footprint"
"""End of the name of a person's frame."""
AHEAD: Vec3 = (1.0, 0.0, 0.0)
FASTEST_MPS = 20.0
"""A package that would be faster was put elsewhere."""
ROUNDED = 1e-3
"""Tolerance of a place's share of its line."""
STATE_OF = {theirs: ours for ours, theirs in STATES.items()}
MAX_BYTES = 1_000_000
"""Longer messages are left out unread."""

__all__ = ["Bag", "is_bag"]


class UnusableError(Exception):
    """A message cannot be taken; in a sentence, why."""


@dataclass(frozen=True)
class BagRoute:
    """A topic of the ROS toolkit."""

    name: str
    """With `{user}` for the person's name."""
    type: str
    take: Callable[["BagMessages", Any, str, int], Taken]
    needs_map: bool = False


class BagMessages:
    """Converts message after message; knows those before."""

    def __init__(self, room: Environment | None, stamps: Stamps) -> None:
        self._stamps = stamps
        self._lines: dict[str, tuple[SurfaceKind, str, Polyline]] = {}
        self._counts: dict[tuple[str, str], int] = {}
        self._down: set[str] = set()
        self._selected: set[int] = set()
        self._last_places: dict[int, LinePlace] = {}
        """Places of the packages in the last list, by uid."""
        if room is not None:
            for belt in room.belts:
                self._add_line("belt", belt.id, belt.line_m)
            for strip in room.strips:
                self._add_line("strip", strip.id, strip.line_m)

    def _add_line(self, kind: SurfaceKind, name: str, line_m: tuple[Vec3, ...]) -> None:
        """Remember a belt or strip by its name in ROS."""
        with contextlib.suppress(ValueError):  # without a length: `map check` reports it
            self._lines[lane_name(kind, name)] = (kind, name, Polyline(line_m))

    def rotation(self, value: Any, user: str, time_ns: int) -> Taken:
        """Convert a geometry_msgs/QuaternionStamped of an arm."""
        orientation = _sound(checks.quaternion(value.quaternion, f"the arm of {user}"))
        stamp_ns = self._stamp_ns(value.header, time_ns)
        sample = ImuSample(stamp_ns=stamp_ns, orientation_xyzw=orientation)
        yield self._numbered_entry(time_ns, topics.IMU, user, sample)

    def button(self, value: Any, user: str, time_ns: int) -> Taken:
        """Convert a std_msgs/Bool: pressed when it becomes true."""
        if not value.data:
            self._down.discard(user)
            return
        if user not in self._down:
            press = ButtonEvent(stamp_ns=time_ns, source="ros2")
            yield self._numbered_entry(time_ns, topics.BUTTON, user, press)
        self._down.add(user)

    def ray(self, value: Any, user: str, time_ns: int) -> Taken:
        """Convert a geometry_msgs/PoseStamped of a ray, from the eyes along x."""
        what = f"the ray of {user}"
        _check_frame(value.header.frame_id, f"{user}{PERSON}", what)
        origin_m = _sound(checks.place(value.pose.position, what))
        orientation = _sound(checks.quaternion(value.pose.orientation, what))
        direction = vector.normalized(rotation.rotate(orientation, AHEAD))
        stamp_ns = self._stamp_ns(value.header, time_ns)
        message = PointingRay(stamp_ns=stamp_ns, origin_m=origin_m, direction=direction)
        yield self._numbered_entry(time_ns, topics.RAY, user, message)

    def mocap(self, value: Any, user: str, time_ns: int) -> Taken:
        """Convert a geometry_msgs/PoseStamped of motion capture: the truth."""
        _check_frame(value.header.frame_id, WORLD, f"the pose of {user}")
        pose = value.pose
        yield self._pose(pose.position, pose.orientation, value.header, user, time_ns, method="external")

    def tf(self, value: Any, _: str, time_ns: int) -> Taken:
        """Convert a tf2_msgs/TFMessage: the frames of people, by whatever they were found."""
        problems: list[UnusableError] = []
        for stamped in value.transforms:
            frame = frame_name(stamped.child_frame_id)
            if not frame.endswith(PERSON):
                continue
            user = frame.removesuffix(PERSON)
            header = stamped.header
            transform = stamped.transform
            try:
                _check_frame(header.frame_id, WORLD, f"the pose of {user}")
                yield self._pose(
                    transform.translation, transform.rotation, header, user, time_ns, method="fixed"
                )
            except UnusableError as error:
                problems.append(error)  # the other transforms count
        if problems:
            raise problems[0]

    def state(self, value: Any, user: str, time_ns: int) -> Taken:
        """Convert a conveyor_msgs/State of the supervisor."""
        state = STATE_OF.get(value.state)
        if state is None:
            raise UnusableError(f"the state {checks.named(value.state)} is unknown")
        message = Interaction.model_validate({"stamp_ns": time_ns, "state": state})
        yield self._numbered_entry(time_ns, topics.INTERACTION, user, message)

    def packages(self, value: Any, _: str, time_ns: int) -> Taken:
        """Convert a conveyor_msgs/PackageList."""
        stamp_ns = self._stamp_ns(value.header, time_ns)
        objects: list[TrackedObject] = []
        previous_places = self._last_places
        self._last_places = {}
        for package in value.packages:
            surface, surface_id, line, along_m = self._along(package.position)
            uid = int(package.uid)
            place = (stamp_ns, package.position.name, along_m)
            self._last_places[uid] = place
            speed_mps = _speed_mps(previous_places.get(uid, place), place)
            kind = int(package.type)
            objects.append(
                TrackedObject(
                    id=str(uid),
                    kind=KINDS[kind] if kind < len(KINDS) else str(kind),
                    position_m=line.point_at(along_m),
                    velocity_mps=vector.scale(line.tangent_at(along_m), speed_mps),
                    length_m=max(0.0, float(package.length)),
                    surface=surface,
                    surface_id=surface_id,
                    surface_position_m=along_m,
                    surface_speed_mps=speed_mps,
                )
            )
        message = TrackedObjects(stamp_ns=stamp_ns, objects=tuple(objects))
        yield self._numbered_entry(time_ns, topics.OBJECTS, TRACKER, message)

    def selected(self, value: Any, _: str, time_ns: int) -> Taken:
        """Convert a conveyor_msgs/PackageUIDList: what changed. It does not say who selected."""
        selected = {int(uid) for uid in value.uids}
        for uid in sorted(selected ^ self._selected):
            event = SelectionEvent(
                stamp_ns=time_ns,
                event="selected" if uid in selected else "deselected",
                object_id=str(uid),
            )
            yield self._numbered_entry(time_ns, topics.SELECTION_EVENTS, "", event)
        self._selected = selected

    def pointers(self, value: Any, _: str, time_ns: int) -> Taken:
        """Convert a conveyor_msgs/PointerList: cursors, and what they are on."""
        for pointer in value.pointers:
            user = pointer.user_name
            overlaid = [str(int(uid)) for uid in pointer.overlay.uids]
            cursor = Cursor(stamp_ns=time_ns)
            if pointer.position.name:
                surface, surface_id, line, along_m = self._along(pointer.position)
                cursor = Cursor(
                    stamp_ns=time_ns,
                    surface=surface,
                    surface_id=surface_id,
                    point_m=line.point_at(along_m),
                    position_m=along_m,
                    miss_m=max(0.0, float(pointer.distance)),
                )
            yield self._numbered_entry(time_ns, topics.CURSOR, user, cursor)
            hover = Hover(stamp_ns=time_ns, object_id=overlaid[0] if overlaid else "")
            yield self._numbered_entry(time_ns, topics.HOVER, user, hover)

    def _pose(
        self,
        position: Any,
        orientation: Any,
        header: Any,
        user: str,
        time_ns: int,
        *,
        method: Literal["external", "fixed"],
    ) -> Entry:
        what = f"the pose of {user}"
        position_m = _sound(checks.place(position, what))
        orientation_xyzw = _sound(checks.quaternion(orientation, what))
        yaw_rad = _sound(checks.heading(orientation_xyzw, what))
        stamp_ns = self._stamp_ns(header, time_ns)
        pose = UserPose(stamp_ns=stamp_ns, position_m=position_m, yaw_rad=yaw_rad, method=method)
        return self._numbered_entry(time_ns, topics.POSE, user, pose)

    def _along(self, place: Any) -> tuple[SurfaceKind, str, Polyline, float]:
        """Return kind, name and course of the line of a place, and the place's arc length, m."""
        known_line = self._lines.get(place.name)
        if known_line is None:
            raise UnusableError(f"the map has no line {checks.named(place.name)}; give the room's by --map")
        kind, name, line = known_line
        share = float(place.position)
        if not abs(share - 0.5) <= 0.5 + ROUNDED:  # also if it is not a number
            raise UnusableError(f"the place {share:g} on {place.name} is not between 0 and 1")
        share = min(max(share, 0.0), 1.0)
        return kind, name, line, share * line.length_m

    def _stamp_ns(self, header: Any, time_ns: int) -> int:
        """Return the time of capture: that of the header, or that of the bag if it states none.

        Raises:
            UnusableError: If both are too far apart to be of one clock.
        """
        stamp_ns = int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)
        if self._stamps == "bag" or stamp_ns == 0:
            return time_ns
        if abs(stamp_ns - time_ns) > checks.LATE_NS:
            apart_s = abs(stamp_ns - time_ns) / NS_PER_S
            raise UnusableError(
                f"the stamp {stamp_ns / NS_PER_S:.1f} s is {apart_s:.1f} s from "
                f"the bag's time, limit {checks.LATE_NS / NS_PER_S:g} s; give --stamps bag if it is of "
                "another clock"
            )
        return stamp_ns

    def _numbered_entry(self, time_ns: int, row: topics.Topic[Any], name: str, message: Message) -> Entry:
        key = (row.key, name)
        count = self._counts[key] = self._counts.get(key, 0) + 1
        return entry(time_ns, row, name, message.model_copy(update={"seq": count}))


ROUTES = (
    BagRoute("/{user}/metawear_ros/rotation", "geometry_msgs/msg/QuaternionStamped", BagMessages.rotation),
    BagRoute("/{user}/metawear_ros/button", "std_msgs/msg/Bool", BagMessages.button),
    BagRoute("/{user}/pointing_ray", "geometry_msgs/msg/PoseStamped", BagMessages.ray),
    BagRoute("/{user}/mocap_pose", "geometry_msgs/msg/PoseStamped", BagMessages.mocap),
    BagRoute("/{user}/state_transition", "conveyor_msgs/msg/State", BagMessages.state),
    BagRoute("/tf", "tf2_msgs/msg/TFMessage", BagMessages.tf),
    BagRoute("/tf_static", "tf2_msgs/msg/TFMessage", BagMessages.tf),
    BagRoute("/packages", "conveyor_msgs/msg/PackageList", BagMessages.packages, needs_map=True),
    BagRoute("/pointers", "conveyor_msgs/msg/PointerList", BagMessages.pointers, needs_map=True),
    BagRoute("/selected_packages", "conveyor_msgs/msg/PackageUIDList", BagMessages.selected),
)
"""Topics of the ROS toolkit that a recording has a place for."""


def _speed_mps(previous: LinePlace, place: LinePlace) -> float:
    """Return the speed along a line, m/s. 0 on another line, or if it is no speed of a package."""
    previous_ns, previous_line, previous_m = previous
    time_ns, line, along_m = place
    step_s = (time_ns - previous_ns) / NS_PER_S
    if line != previous_line or step_s <= 0.0:
        return 0.0
    speed_mps = (along_m - previous_m) / step_s
    return speed_mps if abs(speed_mps) <= FASTEST_MPS else 0.0


def _check_frame(name: str, wanted: str, what: str) -> None:
    """Check that a message is in the frame `wanted`, or names none.

    Raises:
        UnusableError: If it names another one.
    """
    if frame_name(name) not in ("", wanted):
        raise UnusableError(f"{what} is in the frame {checks.named(name)}: transform it to {wanted!r} first")


def _sound(value: Any) -> Any:
    """Return a checked value.

    Raises:
        UnusableError: If it is the reason of a rejection.
    """
    if isinstance(value, str):
        raise UnusableError(value)
    return value


try:
    from pointit.bridges.ros2.types.types import Types
except ImportError as error:
    raise ConfigError(f"ROS 2 bags need {remedy('ros2')}") from error


@dataclass
class Bag:
    """A bag that is read once."""

    path: Path
    room: Environment | None = None
    """Map by which places on belts and strips become positions; without one they are left out."""
    stamps: Stamps = "header"
    taken: Counter[str] = field(default_factory=Counter[str])
    """Messages that were taken, by topic."""
    left_out: dict[str, str] = field(default_factory=dict[str, str])
    """Reasons why topics, or the first of their messages that were, are left out: by topic."""
    left_out_messages: Counter[str] = field(default_factory=Counter[str])
    """Messages that were left out, by topic."""

    def entries(self) -> Iterator[Entry]:
        """Yield the entries in the order of the bag.

        Raises:
            ConfigError: If it cannot be read.
        """
        try:
            with open_bag(self.path) as bag:
                if self.room is not None:
                    began_ns = bag.began_ns
                    yield entry(began_ns, MAP, "", self.room.model_copy(update={"stamp_ns": began_ns}))
                yield from self._read(bag)
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be read ({system_reason(error)})") from error

    def _read(self, bag: OpenBag) -> Iterator[Entry]:
        types = Types("jazzy")
        messages = BagMessages(self.room, self.stamps)
        routes: dict[int, tuple[BagRoute, str]] = {}
        for connection in bag.connections:
            reason, route, user = self._route(types, connection)
            if route is None:
                self.left_out[connection.topic] = reason
                self.left_out_messages[connection.topic] += connection.messages
            else:
                routes[connection.id] = route, user

        # What is left out of a topic is counted, and its first reason is kept.
        usable = [connection for connection in bag.connections if connection.id in routes]
        if not usable:
            return
        for connection, time_ns, data in bag.messages(usable):
            route, user = routes[connection.id]
            try:
                value = types.decode(route.type, unpack_message(data), max_bytes=MAX_BYTES)
                yield from route.take(messages, value, user, max(0, time_ns))
            except ValidationError as error:
                self.left_out.setdefault(connection.topic, summarize_validation_error(error))
                self.left_out_messages[connection.topic] += 1
            except (UnusableError, KeyNameError, ValueError, OverflowError) as error:
                self.left_out.setdefault(connection.topic, str(error))
                self.left_out_messages[connection.topic] += 1
            else:
                self.taken[connection.topic] += 1

    def _route(self, types: Types, connection: Any) -> tuple[str, BagRoute | None, str]:
        """Return the route of a topic and the person's name, or the reason why it is left out."""
        for route in ROUTES:
            user = _user_in(connection.topic, route.name)
            if user is None:
                continue
            if connection.msgtype != route.type:
                return f"its type is {connection.msgtype}, not {route.type}", None, ""
            has_hash = connection.digest.startswith("RIHS01_")
            if has_hash and connection.digest != types.kind(route.type).hash:
                return f"its definition of {route.type} is another one", None, ""
            if route.needs_map and self.room is None:
                return "its places need the room; give it by --map", None, ""
            try:
                return "", route, check_name(user) if user else ""
            except KeyNameError as error:
                return str(error), None, ""
        return "a recording has no place for it", None, ""


def _user_in(topic: str, pattern: str) -> str | None:
    """Return the name in place of `{user}`, `""` if the pattern has none, or None if it does not match."""
    head, placeholder, tail = pattern.partition("{user}")
    if not placeholder:
        return "" if topic == pattern else None
    user = topic[len(head) : len(topic) - len(tail)]
    if f"{head}{user}{tail}" != topic:
        return None
    return user if user and "/" not in user else None
