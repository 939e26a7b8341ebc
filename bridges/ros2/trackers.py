"""Trackers: positions that ROS nodes publish, as objects of the site in {W}, and their routes. Pure."""

import itertools
import math
from collections.abc import Container, Mapping
from typing import Any, NamedTuple

from pointit.bridges.ros2.config import TF, TrackerConfig
from pointit.bridges.ros2.graph.backend import SENSOR, Qos
from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.names import frame_name, is_fixed
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    InboundRoute,
    Taken,
)
from pointit.bridges.ros2.sightings import (
    AT_ORIGIN,
    PACKAGES,
    READERS,
    Pose,
    Sighting,
    TransformBuffer,
    compose,
    packages,
    yaw,
)
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import FARTHEST, NS_PER_S, TrackedObject, TrackedObjects
from pointit.schemas.message_age import message_age_ns
from pointit.schemas.text import round_beyond
from pointit.schemas.topics import OBJECTS

ROBOT = "robot"
"""Kind of an object for which neither the message nor the configuration states one."""

SMOOTHING_S = 0.2
"""Time constant of the velocity."""

LONGEST_S = 0.5
"""Maximum time between two positions from which a velocity is computed, s."""

STILL: Vec3 = (0.0, 0.0, 0.0)

MAX_BYTES = 64 * 1024
"""Some 600 transforms or packages, or 100 detections; decoding them blocks the loop for 6 ms."""
TF_BYTES_HZ = 1e6
"""A tenth of the loop's time."""
RATE_HZ = 25.0
"""Rate of objects on our bus."""


class RosTracker:
    """Objects of one topic, or of one frame of tf."""

    def __init__(self, name: str, config: TrackerConfig, buffer: TransformBuffer) -> None:
        """Track for `objects/{name}`, with the transforms in `buffer`."""
        self._name = name
        self._config = config
        self._buffer = buffer
        self._motion = Motion()
        self._stamp_ns = 0
        """Stamp of our last message."""
        if config.type == TF:
            buffer.want(config.frame)

    def read(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a message of the topic."""
        config = self._config
        if config.type == PACKAGES:
            stamp, sightings = packages(value, context.state)
        else:
            stamp, sightings = READERS[config.type](value)
        stamp_ns = captured(stamp, context.stamp_ns, f"what {config.topic} tells", config.stale_s)
        if isinstance(stamp_ns, str):
            return (ConversionWarning(stamp_ns),)
        return self._convert(sightings, stamp_ns, context)

    def look(self, context: ConversionContext) -> Taken:
        """Return the object of type tf by the newest transforms, or nothing if none has come."""
        config = self._config
        room_frames = roots(context.state)
        placed = self._buffer.placed(config.frame, room_frames, context.stamp_ns, config.stale_s)
        if isinstance(placed, str):
            return (ConversionWarning(f"tracker {self._name}: {placed}"),)
        stamp_ns = context.stamp_ns if placed.stamp_ns is None else placed.stamp_ns
        sighting = Sighting(context.state.frames.world, placed.pose)
        return self._convert([sighting], stamp_ns, context)

    def _convert(self, sightings: list[Sighting | str], stamp_ns: int, context: ConversionContext) -> Taken:
        """Return the message of all objects in `sightings`, and a warning for each problem."""
        latency_ns = round(self._config.latency_s * NS_PER_S)
        stamp_ns = max(stamp_ns - latency_ns, 0)
        if 0 < self._stamp_ns - stamp_ns < NS_PER_S or stamp_ns == self._stamp_ns:
            return ()  # overtaken, or sent twice

        # Parts that are left out come before objects that are, in the order of the message
        objects: dict[str, TrackedObject] = {}
        notes: list[str] = []
        rejections: list[str] = []
        for sighting in sightings:
            result = sighting
            if not isinstance(sighting, str):
                result = self._object(sighting, stamp_ns, context, notes)
            if isinstance(result, TrackedObject):
                objects[result.id] = result
            elif isinstance(result, str):
                rejections.append(result)
        problems = tuple(map(ConversionWarning, dict.fromkeys(notes + rejections)))
        if problems and not objects:
            return problems

        self._motion.keep(objects)
        self._stamp_ns = stamp_ns
        message = TrackedObjects(
            stamp_ns=stamp_ns, objects=tuple(objects.values()), latency_sigma_s=self._config.latency_sigma_s
        )
        return (BusOutput(OBJECTS, self._name, message), *problems)

    def _object(
        self, sighting: Sighting, stamp_ns: int, context: ConversionContext, notes: list[str]
    ) -> TrackedObject | str:
        """Return the object, or why there is none; adds to `notes` what of the message is left out."""
        config = self._config
        state = context.state

        # Pose in the room
        lookup = FrameLookup(self._buffer, roots(state), context.stamp_ns, config.stale_s)
        frame = lookup.pose(sighting.frame or config.frame)
        if isinstance(frame, str):
            return frame
        pose = compose(frame, sighting.pose)
        position_m = pose.position_m
        identity = config.id or self._name
        if sighting.name:
            identity = f"{identity}-{sighting.name}"

        # Velocity by the message, or otherwise by the previous positions
        velocity_mps = stated_velocity(sighting, config.frame, pose, lookup)
        notes += sighting.notes
        if isinstance(velocity_mps, str):
            notes.append(velocity_mps)
        if velocity_mps is None or isinstance(velocity_mps, str):
            velocity_mps = self._motion.velocity_mps(identity, position_m, stamp_ns)
        if max(vector.norm(position_m), vector.norm(velocity_mps)) > FARTHEST:
            return f"{identity} is outside the room, or faster than anything: send metres and m/s"

        # Position and speed on a belt or strip. The package's number stays that of this object
        surface, surface_id, along_m = sighting.on or ("none", "", 0.0)
        speed_mps = 0.0
        if sighting.on is not None:
            line = state.lines[sighting.on[:2]]
            speed_mps = vector.dot(velocity_mps, line.tangent_at(along_m))
            state.uids.claim(int(sighting.name), identity)
        yaw_rad = yaw(pose.orientation) if sighting.has_heading else None
        kind = config.kind or sighting.kind
        length_m = config.size_m or sighting.size_m
        return TrackedObject(
            id=identity,
            kind=kind or ROBOT,
            position_m=position_m,
            velocity_mps=velocity_mps,
            length_m=length_m,
            yaw_rad=yaw_rad,
            position_sigma_m=sighting.sigma_m,
            surface=surface,
            surface_id=surface_id,
            surface_position_m=along_m,
            surface_speed_mps=speed_mps,
        )


class TfInput:
    """/tf and /tf_static, for the frames of all trackers, and the trackers that are frames."""

    def __init__(self, buffer: TransformBuffer, trackers: Mapping[str, RosTracker]) -> None:
        self._buffer = buffer
        self._trackers = trackers

    def moving(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a tf2_msgs/TFMessage of /tf."""
        sentences = self._buffer.take(value, is_static=False, now_ns=context.stamp_ns)
        problems = tuple(map(ConversionWarning, sentences))  # stores all transforms, before any is used
        objects = (tracker.look(context) for tracker in self._trackers.values())
        return (*problems, *itertools.chain.from_iterable(objects))

    def static(self, value: Any, _context: ConversionContext) -> Taken:
        """Convert a tf2_msgs/TFMessage of /tf_static."""
        return tuple(map(ConversionWarning, self._buffer.take(value, is_static=True)))

    def frames_in(self, cdr: bytes, _state: ConversionState) -> tuple[str, ...]:
        """Return the frames in `cdr` that matter."""
        return self._buffer.wanted_in(cdr)


def roots(state: ConversionState) -> dict[str, Pose]:
    """Return the frames in ROS whose pose in {W} is known without transforms: {W}, and those of the map."""
    frames = {frame_name(state.frames.world): AT_ORIGIN}
    if state.room is not None:
        for frame in state.room.frames:
            frames[frame_name(frame.id)] = Pose(frame.position_m, frame.orientation_xyzw)
    return frames


class FrameLookup(NamedTuple):
    """Poses of frames at one time."""

    buffer: TransformBuffer
    known: Mapping[str, Pose]
    """Frames whose pose needs no transform. Poses are in the first one."""
    now_ns: int
    """The time, Unix ns."""
    stale_s: float
    """Maximum age of moving transforms."""

    def pose(self, name: str) -> Pose | str:
        """Return the pose of the frame `name` in {W} (`""`: the room's), or why it is unknown."""
        name = frame_name(name)
        if not name:
            return AT_ORIGIN
        if name in self.known:
            return self.known[name]
        placed = self.buffer.placed(name, self.known, self.now_ns, self.stale_s)
        return placed if isinstance(placed, str) else placed.pose


def stated_velocity(seen: Sighting, own_frame: str, pose: Pose, lookup: FrameLookup) -> Vec3 | str | None:
    """Return the velocity in a message, the reason why it is unusable, or None if there is none.

    A twist is in the message's child frame. This is the object's own frame, with the pose of the message,
    unless it is the frame of the pose, a frame of the map, or fixed to the ground by REP 105.

    Args:
        seen: the object.
        own_frame: frame of the pose if the message names none.
        pose: pose of the object in the first known frame.
        lookup: poses of other frames.
    """
    if seen.velocity_mps is None:
        return None
    name = seen.velocity_frame
    pose_frame = seen.frame or frame_name(own_frame)
    is_known = name == pose_frame or name in lookup.known
    if name and (is_known or is_fixed(name)):
        frame = lookup.pose(name)
        if isinstance(frame, str):
            return f"the twist is left out: {frame}"
        return rotation.rotate(frame.orientation, seen.velocity_mps)
    if not seen.has_heading:
        return None
    return rotation.rotate(pose.orientation, seen.velocity_mps)


def captured(stamp: Any, now_ns: int, quantity: str, stale_s: float) -> int | str:
    """Return the time of a header's stamp, Unix ns, that of arrival for stamp 0, or the rejection."""
    stamp_ns = checks.stated_ns(stamp)
    if stamp_ns is None:
        return now_ns
    age_ns = message_age_ns(stamp_ns, now_ns)
    if -MAX_AHEAD_NS <= age_ns <= stale_s * NS_PER_S:
        return stamp_ns
    side = "old"
    limit_s = stale_s
    if age_ns <= 0:
        side = "ahead of the site's clock"
        limit_s = MAX_AHEAD_NS / NS_PER_S
    apart = round_beyond(abs(age_ns) / NS_PER_S, limit_s)
    return (
        f"{quantity} is {apart} s {side}, limit {limit_s:g} s: "
        "synchronize the clocks, or let both follow /clock"
    )


class _Last(NamedTuple):
    stamp_ns: int
    position_m: Vec3
    velocity_mps: Vec3


class Motion:
    """Smoothed differences of the positions of each object."""

    def __init__(self) -> None:
        self._last: dict[str, _Last] = {}

    def velocity_mps(self, name: str, position_m: Vec3, stamp_ns: int) -> Vec3:
        """Return the velocity of an object that is at `position_m` now; 0 if it was not seen just before."""
        velocity_mps = STILL
        last = self._last.get(name)
        if last is not None:
            velocity_mps = _smoothed_mps(last, position_m, stamp_ns)
        self._last[name] = _Last(stamp_ns, position_m, velocity_mps)
        return velocity_mps

    def keep(self, names: Container[str]) -> None:
        """Forget all other objects."""
        present = [name for name in self._last if name in names]
        self._last = {name: self._last[name] for name in present}


def _smoothed_mps(last: _Last, position_m: Vec3, stamp_ns: int) -> Vec3:
    """Return the velocity after a step to `position_m`, low-pass filtered; 0 if it is no motion."""
    passed_s = (stamp_ns - last.stamp_ns) / NS_PER_S
    if not 0.0 < passed_s <= LONGEST_S:
        return STILL
    step_m = vector.subtract(position_m, last.position_m)
    newest_mps = vector.scale(step_m, 1.0 / passed_s)
    share = 1.0 - math.exp(-passed_s / SMOOTHING_S)
    difference_mps = vector.subtract(newest_mps, last.velocity_mps)
    velocity_mps = vector.add(last.velocity_mps, vector.scale(difference_mps, share))
    if not all(abs(component) <= FARTHEST for component in velocity_mps):
        return STILL  # it was carried, or another took its name
    return velocity_mps


def tracker_routes(configs: Mapping[str, TrackerConfig]) -> tuple[InboundRoute, ...]:
    """Return the routes to `objects/NAME` of the trackers `configs` by name, with new converters."""
    if not configs:
        return ()
    buffer = TransformBuffer()
    of_tf: dict[str, RosTracker] = {}
    topics: list[InboundRoute] = []
    for name, config in configs.items():
        tracker = RosTracker(name, config, buffer)
        if config.type == TF:
            of_tf[name] = tracker
            continue
        route = InboundRoute(
            name=f"tracker {name}",
            ros=config.topic,
            type=config.type.replace("/", "/msg/"),
            qos=SENSOR,
            into=(OBJECTS,),
            by=tracker.read,
            rate_hz=RATE_HZ,
            max_bytes=MAX_BYTES,
            context=f"objects of {name}",
        )
        topics.append(route)

    # Transforms are read for all trackers at once: poses of topics are in frames, too
    tf = TfInput(buffer, of_tf)
    return (
        *topics,
        InboundRoute(
            name="trackers: tf",
            ros="/tf",
            type="tf2_msgs/msg/TFMessage",
            qos=Qos(depth=100),
            into=(OBJECTS,),
            by=tf.moving,
            bytes_hz=TF_BYTES_HZ,
            people=tf.frames_in,
            reader=" for trackers",
            max_bytes=MAX_BYTES,
            context="frames of trackers",
        ),
        InboundRoute(
            name="trackers: tf_static",
            ros="/tf_static",
            type="tf2_msgs/msg/TFMessage",
            qos=Qos(depth=100, latched=True),
            into=(OBJECTS,),
            by=tf.static,
            reader=" for trackers",
            max_bytes=MAX_BYTES,
            context="fixed frames of trackers",
        ),
    )
