"""Sightings: positions of objects in messages of ROS, each by the chain of transforms of its frame. Pure.

Unlike tf2 it does not interpolate: the newest transform of each frame counts, and an old one is rejected.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.rival_publishers import RivalPublishers
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.names import frame_name, holds_frame
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import IDENTITY, Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import FARTHEST, NS_PER_S
from pointit.schemas.message_age import message_age_ns
from pointit.schemas.pointing import SurfaceKind
from pointit.schemas.text import first_of, round_beyond

MAX_TRANSFORMS = 1000
"""Maximum number of stored frames."""
MAX_CHAIN = 32
"""Maximum number of transforms between a frame and the room."""

PACKAGES = "conveyor_msgs/PackageList"
MAX_ID = 64
UNMEASURED = 1e3
"""A variance from which drivers mean that they do not measure the coordinate, m² or (m/s)²."""
UNKNOWN = -1.0
"""First number of a covariance that is unknown; PX4 has NaN there."""


class Pose(NamedTuple):
    """Pose of a frame or an object in another frame."""

    position_m: Vec3
    orientation: Quaternion


AT_ORIGIN = Pose((0.0, 0.0, 0.0), rotation.IDENTITY)


class _Link(NamedTuple):
    parent: str
    pose: Pose
    stamp_ns: int | None
    """None if it is static."""


class Placed(NamedTuple):
    """Pose of a frame in the room."""

    pose: Pose
    stamp_ns: int | None
    """Time of the moving transform nearest to the frame, or None if all are static."""


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return `inner`, a pose in a frame that is at `outer`, in the frame that `outer` is in."""
    offset_m = rotation.rotate(outer.orientation, inner.position_m)
    orientation = rotation.multiply(outer.orientation, inner.orientation)
    return Pose(vector.add(outer.position_m, offset_m), rotation.normalized(orientation))


class TransformBuffer:
    """The newest transform of each frame to its parent."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._wanted: dict[str, None] = {}
        self._rivals = RivalPublishers()

    def want(self, frame: str) -> None:
        """Remember that `frame` matters."""
        if len(self._wanted) < MAX_TRANSFORMS:
            self._wanted[frame_name(frame)] = None

    def wanted_in(self, cdr: bytes) -> tuple[str, ...]:
        """Return the frames in the CDR of a tf2_msgs/TFMessage that some pose was requested for."""
        return tuple(frame for frame in self._wanted if holds_frame(cdr, frame))

    def take(self, value: Any, *, is_static: bool, now_ns: int = 0) -> Iterator[str]:
        """Store the transforms of a tf2_msgs/TFMessage; yields a sentence for each that cannot be used.

        Args:
            value: the message.
            is_static: it is one of /tf_static.
            now_ns: the time of moving transforms without a stamp, Unix ns.
        """
        default_ns = None if is_static else now_ns
        for transform in value.transforms:
            problem = self._store(transform, default_ns)
            if problem:
                yield problem

    def placed(self, frame: str, roots: Mapping[str, Pose], at_ns: int, stale_s: float) -> Placed | str:
        """Return the pose of `frame` in the room at `at_ns`, or a sentence why it is unknown.

        Args:
            frame: its name in ROS.
            roots: frames whose pose in the room is known.
            at_ns: the time for which it is needed, Unix ns.
            stale_s: maximum time between `at_ns` and a moving transform.
        """
        pose = AT_ORIGIN
        stamp_ns = None
        ancestor = frame_name(frame)
        for _ in range(MAX_CHAIN):
            self.want(ancestor)
            if ancestor in roots:
                return Placed(compose(roots[ancestor], pose), stamp_ns)

            # One step up, if the transform is known and up to date
            link = self._links.get(ancestor)
            if link is None:
                root = next(iter(roots), "")
                return (
                    f"no transform leads from {checks.named(ancestor)} to {checks.named(root)}: "
                    "publish one on /tf or /tf_static, or add the frame to the map's `frames`"
                )
            if link.stamp_ns is not None:
                problem = _timing_problem(link, link.stamp_ns, ancestor, at_ns, stale_s)
                if problem:
                    return problem
                if stamp_ns is None:
                    stamp_ns = link.stamp_ns
            pose = compose(link.pose, pose)
            ancestor = link.parent
        return f"the transforms of {checks.named(frame)} go round in a circle: end one of their publishers"

    def _store(self, transform: Any, now_ns: int | None) -> str:
        """Store a transform; `now_ns` is None if it is static. Return why it cannot be used, or `""`."""
        child = frame_name(transform.child_frame_id)
        parent = frame_name(transform.header.frame_id)
        subject = f"the transform from {checks.named(parent)} to {checks.named(child)}"
        if child == parent:
            return f"{subject} leads from a frame to itself: end its publisher"
        position_m = checks.place(transform.transform.translation, subject)
        if isinstance(position_m, str):
            return position_m
        orientation = checks.quaternion(transform.transform.rotation, subject)
        if isinstance(orientation, str):
            return orientation

        # Keep the newest: messages of several publishers may overtake each other
        stamp_ns = None
        if now_ns is not None:
            stamp_ns = checks.stated_ns(transform.header.stamp) or now_ns
        previous = self._links.pop(child, None)
        if previous is not None and not is_newer(stamp_ns, previous.stamp_ns):
            self._links[child] = previous
            return ""
        if len(self._links) >= MAX_TRANSFORMS:
            oldest = next(iter(self._links))
            del self._links[oldest]  # the one not renewed for longest, which bounds memory
        self._links[child] = _Link(parent, Pose(position_m, orientation), stamp_ns)

        if stamp_ns is None:
            return ""
        return self._rivals.describe(child, parent, position_m)


def _timing_problem(link: _Link, stamp_ns: int, child: str, at_ns: int, stale_s: float) -> str:
    """Return a sentence if the moving transform of `child` cannot be used at `at_ns`, else `""`."""
    apart_s = message_age_ns(stamp_ns, at_ns) / NS_PER_S
    if abs(apart_s) <= stale_s:
        return ""
    side = "old"
    remedy = "check its publisher and clock"
    if apart_s < 0:  # AMCL does it by its `transform_tolerance`, 1 s by default
        side = "ahead"
        remedy = (
            "if its publisher dates transforms ahead on purpose, as AMCL does, set a larger "
            "stale_s of what uses it; else synchronize the clocks"
        )
    subject = f"the transform from {checks.named(link.parent)} to {checks.named(child)}"
    apart = round_beyond(abs(apart_s), stale_s)
    return f"{subject} is {apart} s {side}, limit {stale_s:g} s: {remedy}"


def is_newer(stamp_ns: int | None, before_ns: int | None) -> bool:
    """Return False if a transform stamped `stamp_ns` is overtaken; a clock set back by a second counts."""
    if stamp_ns is None or before_ns is None:
        return True
    return not 0 < before_ns - stamp_ns < NS_PER_S


def yaw(orientation: Quaternion) -> float:
    """Return the azimuth of the x axis, rad; of a steep one, that of the y axis less 90°."""
    x_axis = rotation.rotate(orientation, (1.0, 0.0, 0.0))
    if math.hypot(x_axis[0], x_axis[1]) > 1e-3:
        return vector.azimuth(x_axis)
    y_axis = rotation.rotate(orientation, (0.0, 1.0, 0.0))
    return vector.wrap(vector.azimuth(y_axis) - math.pi / 2.0)


class Sighting(NamedTuple):
    """One object in one message."""

    frame: str
    """Frame of pose and velocity, or `""` if the message names none."""
    pose: Pose
    name: str = ""
    """The message's name for it, or `""` if it is about one object only."""
    kind: str = ""
    size_m: float = 0.0
    velocity_mps: Vec3 | None = None
    """None if the message does not state it."""
    velocity_frame: str = ""
    """Frame of the velocity as the message names it, or `""` for the object's own."""
    sigma_m: float | None = None
    has_heading: bool = True
    notes: tuple[str, ...] = ()
    """Parts of the message that cannot be used, with the reasons."""
    on: tuple[SurfaceKind, str, float] | None = None
    """The line that it is on, and its centre's arc length there, m."""


Seen = tuple[Any, list[Sighting | str]]
"""The stamp of a message, and its objects or the reasons why one cannot be used."""

Reader = Callable[[Any], Seen]


def pose_stamped(value: Any) -> Seen:
    """Return the object of a geometry_msgs/PoseStamped."""
    header = value.header
    return header.stamp, [_sighting_at(header.frame_id, value.pose, None, "the pose")]


def pose_with_covariance(value: Any) -> Seen:
    """Return the object of a geometry_msgs/PoseWithCovarianceStamped."""
    header = value.header
    sighting = _sighting_at(header.frame_id, value.pose.pose, value.pose.covariance, "the pose")
    return header.stamp, [sighting]


def odometry(value: Any) -> Seen:
    """Return the object of a nav_msgs/Odometry; its twist is in the frame `child_frame_id`."""
    header = value.header
    sighting = _sighting_at(header.frame_id, value.pose.pose, value.pose.covariance, "the pose")
    if isinstance(sighting, Sighting) and _is_measured(value.twist):
        velocity_mps = checks.velocity(value.twist.twist.linear)
        if isinstance(velocity_mps, str):
            notes = (*sighting.notes, velocity_mps)
            sighting = sighting._replace(notes=notes)
        else:
            frame = frame_name(value.child_frame_id)
            sighting = sighting._replace(velocity_mps=velocity_mps, velocity_frame=frame)
    return header.stamp, [sighting]


def detections(value: Any) -> Seen:
    """Return the objects of a vision_msgs/Detection3DArray: the likeliest class, the centre of the box."""
    return value.header.stamp, list(_detections(value))


def packages(value: Any, state: ConversionState) -> Seen:
    """Return the objects of a conveyor_msgs/PackageList, which are on belts and strips of the map."""
    sightings = [_package(package, state) for package in value.packages]
    return value.header.stamp, sightings


READERS: dict[str, Reader] = {
    "geometry_msgs/PoseStamped": pose_stamped,
    "geometry_msgs/PoseWithCovarianceStamped": pose_with_covariance,
    "nav_msgs/Odometry": odometry,
    "vision_msgs/Detection3DArray": detections,
}
"""Readers by the type of a topic; `packages` is that of PACKAGES."""


def sigma(covariance: Any) -> float | str | None:
    """Return 1 sigma along the worst direction by a pose covariance of 36 numbers, m, or the rejection.

    None if it is unknown: all 0, or -1 at the beginning, as sensor_msgs/Imu defines them, or NaN there. A
    coordinate whose variance is huge, negative or NaN is not measured, and left out.
    """
    matrix = np.asarray(covariance, dtype=float).reshape(6, 6)
    position = matrix[:3, :3]
    variances = np.diag(position)
    measured = (variances >= 0.0) & (variances < UNMEASURED)
    if not measured.any() or not variances[0] >= 0.0:
        return None
    position = np.nan_to_num(position[np.ix_(measured, measured)])
    if np.abs(position).max() > UNMEASURED:
        return "the covariance is none: a number beside its diagonal is larger than those on it"
    symmetric = (position + position.T) / 2.0
    largest = float(np.linalg.eigvalsh(symmetric)[-1])
    return math.sqrt(largest) if largest > 0.0 else None


def _is_measured(twist: Any) -> bool:
    """Return False if the variance of a TwistWithCovariance states so, or if all of its numbers are 0.

    Drivers that do not compute a twist leave all of it at 0. A robot at rest then has that of its positions.
    """
    variance = float(twist.covariance[0])
    if variance == UNKNOWN or variance >= UNMEASURED:
        return False
    if any(entry > 0.0 for entry in twist.covariance):
        return True
    linear = twist.twist.linear
    angular = twist.twist.angular
    return any((linear.x, linear.y, linear.z, angular.x, angular.y, angular.z))


def _sighting_at(frame: str, pose: Any, covariance: Any, subject: str) -> Sighting | str:
    """Return an object without a name at `pose`, or why its position cannot be used."""
    position_m = checks.place(pose.position, subject)
    if isinstance(position_m, str):
        return position_m
    orientation = checks.quaternion(pose.orientation, subject)
    sigma_m = None if covariance is None else sigma(covariance)

    # Even without a heading or an accuracy it is a position
    notes: list[str] = []
    has_heading = True
    if isinstance(orientation, str):
        notes.append(orientation)
        orientation = IDENTITY
        has_heading = False
    if isinstance(sigma_m, str):
        notes.append(f"{subject}: {sigma_m}")
        sigma_m = None
    return Sighting(
        frame_name(frame),
        Pose(position_m, orientation),
        sigma_m=sigma_m,
        has_heading=has_heading,
        notes=tuple(notes),
    )


def _package(value: Any, state: ConversionState) -> Sighting | str:
    uid = int(value.uid)
    name = value.position.name
    share = float(value.position.position)
    subject = f"package {uid}"

    # The line: a strip's name may have the prefix of the ROS toolkit
    strip = name.removeprefix("strip_")
    keys: tuple[tuple[SurfaceKind, str], ...] = (("belt", name), ("strip", name), ("strip", strip))
    key = next((key for key in keys if key in state.lines), None)
    if key is None:
        line_names = first_of((line_id for _, line_id in state.lines), 20)
        return (
            f"{subject} is on {checks.named(name)}, which is no line of the map; "
            f"there are {line_names or 'none'}"
        )
    length_m = float(value.length)
    if not (0.0 <= share <= 1.0 and 0.0 <= length_m <= FARTHEST):
        size = f"{length_m:g} m long"
        return f"{subject} is at {share:g} of {name}, {size}: send 0 (start) to 1 (end), and metres"

    line = state.lines[key]
    along_m = share * line.length_m
    surface, surface_id = key
    kind = state.kinds.kind(int(value.type))
    return Sighting(
        frame=state.frames.world,
        pose=Pose(line.point_at(along_m), IDENTITY),
        name=str(uid),
        kind=kind or "",
        size_m=length_m,
        has_heading=False,
        on=(surface, surface_id, along_m),
    )


def _detections(value: Any) -> Iterator[Sighting | str]:
    for count, detection in enumerate(value.detections):
        identity = detection.id or str(count)
        subject = f"detection {checks.named(identity)}"
        frame = detection.header.frame_id or value.header.frame_id

        # Class and covariance are those of the likeliest hypothesis
        best = max(detection.results, key=_score, default=None)
        covariance = None
        kind = ""
        if best is not None:
            covariance = best.pose.covariance
            kind = best.hypothesis.class_id[:MAX_ID]
        sighting = _sighting_at(frame, detection.bbox.center, covariance, subject)
        if isinstance(sighting, str):
            yield sighting
            continue

        # The longest side of the box, unless a side is impossible
        size = detection.bbox.size
        sides_m = (float(size.x), float(size.y), float(size.z))
        size_m = max(sides_m)
        notes = sighting.notes
        if not all(0.0 <= side_m <= FARTHEST for side_m in sides_m):
            size_m = 0.0
            problem = f"the size of {subject} is {sides_m} m, and left out: send metres, 0 if it is unknown"
            notes = (*notes, problem)
        yield sighting._replace(
            name=identity[:MAX_ID],
            kind=kind,
            size_m=size_m,
            has_heading=sighting.pose.orientation != IDENTITY,  # detectors without one leave the identity
            notes=notes,
        )


def _score(result: Any) -> float:
    score = float(result.hypothesis.score)
    return score if math.isfinite(score) else -math.inf
