"""Sightings: positions of objects in messages of ROS, each by the chain of transforms of its frame. Pure.

Unlike tf2 it does not interpolate: of each frame the newest transform counts, and an old one is refused.
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
    at_m = vector.add(outer.position_m, rotation.rotate(outer.orientation, inner.position_m))
    return Pose(at_m, rotation.normalized(rotation.multiply(outer.orientation, inner.orientation)))


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
        """Return the frames in the CDR of a tf2_msgs/TFMessage that some pose was asked for by."""
        return tuple(frame for frame in self._wanted if holds_frame(cdr, frame))

    def take(self, value: Any, *, is_static: bool, now_ns: int = 0) -> Iterator[str]:
        """Store the transforms of a tf2_msgs/TFMessage; yields a sentence for each that cannot be used.

        Args:
            value: the message.
            is_static: it is one of /tf_static.
            now_ns: the time of moving transforms without a stamp, Unix ns.
        """
        for each in value.transforms:
            problem = self._store(each, None if is_static else now_ns)
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
        here = frame_name(frame)
        for _ in range(MAX_CHAIN):
            self.want(here)
            if here in roots:
                return Placed(compose(roots[here], pose), stamp_ns)
            link = self._links.get(here)
            if link is None:
                return (
                    f"no transform leads from {checks.named(here)} to {checks.named(next(iter(roots), ''))}: "
                    "publish one on /tf or /tf_static, or add the frame to the map's `frames`"
                )
            if link.stamp_ns is not None:
                apart_s = message_age_ns(link.stamp_ns, at_ns) / NS_PER_S
                if abs(apart_s) > stale_s:
                    side = "old" if apart_s > 0 else "ahead"
                    remedy = "check its publisher and clock"
                    if apart_s < 0:  # AMCL does it by its `transform_tolerance`, 1 s by default
                        remedy = (
                            "if its publisher dates transforms ahead on purpose, as AMCL does, set a larger "
                            "stale_s of what uses it; else synchronize the clocks"
                        )
                    off_s = round_beyond(abs(apart_s), stale_s)
                    return (
                        f"the transform from {checks.named(link.parent)} to {checks.named(here)} is "
                        f"{off_s} s {side}, limit {stale_s:g} s: {remedy}"
                    )
                stamp_ns = link.stamp_ns if stamp_ns is None else stamp_ns
            pose = compose(link.pose, pose)
            here = link.parent
        return f"the transforms of {checks.named(frame)} go round in a circle: end one of their publishers"

    def _store(self, each: Any, now_ns: int | None) -> str:
        """Store a transform; `now_ns` is None if it is static."""
        child = frame_name(each.child_frame_id)
        parent = frame_name(each.header.frame_id)
        what = f"the transform from {checks.named(parent)} to {checks.named(child)}"
        if child == parent:
            return f"{what} leads from a frame to itself: end its publisher"
        position_m = checks.place(each.transform.translation, what)
        if isinstance(position_m, str):
            return position_m
        turned = checks.quaternion(each.transform.rotation, what)
        if isinstance(turned, str):
            return turned
        stamp_ns = None if now_ns is None else checks.stated_ns(each.header.stamp) or now_ns
        before = self._links.pop(child, None)
        if before is not None and not is_newer(stamp_ns, before.stamp_ns):
            self._links[child] = before
            return ""
        if len(self._links) >= MAX_TRANSFORMS:
            del self._links[next(iter(self._links))]  # the one not renewed for longest, which bounds memory
        self._links[child] = _Link(parent, Pose(position_m, turned), stamp_ns)
        return "" if stamp_ns is None else self._rivals.describe(child, parent, position_m)


def is_newer(stamp_ns: int | None, before_ns: int | None) -> bool:
    """Return False if a transform stamped `stamp_ns` is overtaken; a clock set back by a second counts."""
    return stamp_ns is None or before_ns is None or not 0 < before_ns - stamp_ns < NS_PER_S


def yaw(turned: Quaternion) -> float:
    """Return the azimuth of the x axis, rad; of a steep one, that of the y axis less 90°."""
    ahead = rotation.rotate(turned, (1.0, 0.0, 0.0))
    if math.hypot(ahead[0], ahead[1]) > 1e-3:
        return vector.azimuth(ahead)
    return vector.wrap(vector.azimuth(rotation.rotate(turned, (0.0, 1.0, 0.0))) - math.pi / 2.0)


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
    """None if the message does not tell."""
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
    return value.header.stamp, [_posed(value.header.frame_id, value.pose, None, "the pose")]


def pose_with_covariance(value: Any) -> Seen:
    """Return the object of a geometry_msgs/PoseWithCovarianceStamped."""
    found = _posed(value.header.frame_id, value.pose.pose, value.pose.covariance, "the pose")
    return value.header.stamp, [found]


def odometry(value: Any) -> Seen:
    """Return the object of a nav_msgs/Odometry; its twist is in the frame `child_frame_id`."""
    found = _posed(value.header.frame_id, value.pose.pose, value.pose.covariance, "the pose")
    if isinstance(found, Sighting) and _is_measured(value.twist):
        velocity_mps = checks.velocity(value.twist.twist.linear)
        if isinstance(velocity_mps, str):
            found = found._replace(notes=(*found.notes, velocity_mps))
        else:
            frame = frame_name(value.child_frame_id)
            found = found._replace(velocity_mps=velocity_mps, velocity_frame=frame)
    return value.header.stamp, [found]


def detections(value: Any) -> Seen:
    """Return the objects of a vision_msgs/Detection3DArray: the likeliest class, the centre of the box."""
    return value.header.stamp, list(_detections(value))


def packages(value: Any, state: ConversionState) -> Seen:
    """Return the objects of a conveyor_msgs/PackageList, which are on belts and strips of the map."""
    return value.header.stamp, [_package(each, state) for each in value.packages]


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
    place = np.asarray(covariance, dtype=float).reshape(6, 6)[:3, :3]
    variances = np.diag(place)
    measured = (variances >= 0.0) & (variances < UNMEASURED)
    if not measured.any() or not variances[0] >= 0.0:
        return None
    place = np.nan_to_num(place[np.ix_(measured, measured)])
    if np.abs(place).max() > UNMEASURED:
        return "the covariance is none: a number beside its diagonal is larger than those on it"
    largest = float(np.linalg.eigvalsh((place + place.T) / 2.0)[-1])
    return math.sqrt(largest) if largest > 0.0 else None


def _is_measured(twist: Any) -> bool:
    """Return False if the variance of a TwistWithCovariance states so, or if all of its numbers are 0.

    Drivers that do not compute a twist leave all of it at 0. A robot at rest then has that of its positions.
    """
    variance = float(twist.covariance[0])
    parts = (twist.twist.linear, twist.twist.angular)
    is_filled = any(each.x or each.y or each.z for each in parts) or any(
        each > 0.0 for each in twist.covariance
    )
    return is_filled and variance != UNKNOWN and not variance >= UNMEASURED


def _posed(frame: str, pose: Any, covariance: Any, what: str) -> Sighting | str:
    position_m = checks.place(pose.position, what)
    if isinstance(position_m, str):
        return position_m
    turned = checks.quaternion(pose.orientation, what)
    sigma_m = None if covariance is None else sigma(covariance)
    notes: list[str] = []
    if isinstance(turned, str):
        notes.append(turned)
    if isinstance(sigma_m, str):
        notes.append(f"{what}: {sigma_m}")
    return Sighting(
        frame_name(frame),
        Pose(position_m, IDENTITY if isinstance(turned, str) else turned),
        sigma_m=None if isinstance(sigma_m, str) else sigma_m,
        has_heading=not isinstance(turned, str),
        notes=tuple(notes),
    )


def _package(value: Any, state: ConversionState) -> Sighting | str:
    uid = int(value.uid)
    name = value.position.name
    share = float(value.position.position)
    what = f"package {uid}"
    strip = name.removeprefix("strip_")
    places: tuple[tuple[SurfaceKind, str], ...] = (("belt", name), ("strip", name), ("strip", strip))
    place = next((each for each in places if each in state.lines), None)
    if place is None:
        there_are = first_of((line_id for _, line_id in state.lines), 20) or "none"
        return f"{what} is on {checks.named(name)}, which is no line of the map; there are {there_are}"
    length_m = float(value.length)
    if not (0.0 <= share <= 1.0 and 0.0 <= length_m <= FARTHEST):
        return f"{what} is at {share:g} of {name}, {length_m:g} m long: send 0 (start) to 1 (end), and metres"
    line = state.lines[place]
    along_m = share * line.length_m
    return Sighting(
        frame=state.frames.world,
        pose=Pose(line.point_at(along_m), IDENTITY),
        name=str(uid),
        kind=state.kinds.kind(int(value.type)) or "",
        size_m=length_m,
        has_heading=False,
        on=(place[0], place[1], along_m),
    )


def _detections(value: Any) -> Iterator[Sighting | str]:
    for count, each in enumerate(value.detections):
        what = f"detection {checks.named(each.id or str(count))}"
        best = max(each.results, key=_score, default=None)
        found = _posed(
            each.header.frame_id or value.header.frame_id,
            each.bbox.center,
            None if best is None else best.pose.covariance,
            what,
        )
        if isinstance(found, str):
            yield found
            continue
        size = each.bbox.size
        sizes_m = (float(size.x), float(size.y), float(size.z))
        is_size = all(0.0 <= side_m <= FARTHEST for side_m in sizes_m)
        problem = f"the size of {what} is {sizes_m} m, and left out: send metres, 0 if it is unknown"
        yield found._replace(
            name=each.id[:MAX_ID] or str(count),
            kind="" if best is None else best.hypothesis.class_id[:MAX_ID],
            size_m=max(sizes_m) if is_size else 0.0,
            has_heading=found.pose.orientation != IDENTITY,
            notes=found.notes if is_size else (*found.notes, problem),
        )


def _score(result: Any) -> float:
    score = float(result.hypothesis.score)
    return score if math.isfinite(score) else -math.inf
