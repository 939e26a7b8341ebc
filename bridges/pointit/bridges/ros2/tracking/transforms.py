"""Frames of ROS (/tf, /tf_static): the pose of a frame in the room, by its chain of transforms; pure.

Unlike tf2 it does not interpolate: of each frame the newest transform counts, and an old one is refused.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.routing.frames import frame_name, holds_frame
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import FARTHEST, NS_PER_S
from pointit.schemas.text import round_beyond

MAX_TRANSFORMS = 1000
"""Maximum number of transforms read from one message, and of frames stored."""
MAX_CHAIN = 32
"""Maximum number of transforms between a frame and the room."""


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
        for each in value.transforms[:MAX_TRANSFORMS]:
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
        pose, stamp_ns, here = AT_ORIGIN, None, frame_name(frame)
        for _ in range(MAX_CHAIN):
            self.want(here)
            if here in roots:
                found = compose(roots[here], pose)
                if not all(abs(each) <= FARTHEST for each in found.position_m):
                    return f"the frame {checks.named(frame)} is not in the room: its transforms lead far away"
                return Placed(found, stamp_ns)
            link = self._links.get(here)
            if link is None:
                return (
                    f"no transform leads from {checks.named(here)} to {checks.named(next(iter(roots), ''))}: "
                    "publish one on /tf or /tf_static, or add the frame to the map's `frames`"
                )
            if link.stamp_ns is not None:
                apart_s = (at_ns - link.stamp_ns) / NS_PER_S
                if abs(apart_s) > stale_s:
                    side = "old" if apart_s > 0 else "ahead"
                    off_s = round_beyond(abs(apart_s), stale_s)
                    return (
                        f"the transform from {checks.named(link.parent)} to {checks.named(here)} is "
                        f"{off_s} s {side}, limit {stale_s:g} s: check its publisher and clock"
                    )
                stamp_ns = link.stamp_ns if stamp_ns is None else stamp_ns
            pose, here = compose(link.pose, pose), link.parent
        return f"the transforms of {checks.named(frame)} go round in a circle: end one of their publishers"

    def _store(self, each: Any, now_ns: int | None) -> str:
        """Store a transform; `now_ns` is None if it is static."""
        child, parent = frame_name(each.child_frame_id), frame_name(each.header.frame_id)
        what = f"the transform from {checks.named(parent)} to {checks.named(child)}"
        if child == parent:
            return f"{what} leads from a frame to itself: end its publisher"
        position_m = checks.place(each.transform.translation, what)
        if isinstance(position_m, str):
            return position_m
        turned = checks.quaternion(each.transform.rotation, what)
        if isinstance(turned, str):
            return turned
        stamp = each.header.stamp
        stamp_ns = None if now_ns is None else int(stamp.sec) * NS_PER_S + int(stamp.nanosec) or now_ns
        before = self._links.pop(child, None)
        if before is not None and not is_newer(stamp_ns, before.stamp_ns):
            self._links[child] = before
            return ""
        if len(self._links) >= MAX_TRANSFORMS:
            del self._links[next(iter(self._links))]  # the one not renewed for longest, which bounds memory
        self._links[child] = _Link(parent, Pose(position_m, turned), stamp_ns)
        return ""


def is_newer(stamp_ns: int | None, before_ns: int | None) -> bool:
    """Return False if a transform stamped `stamp_ns` is overtaken; a clock set back by a second counts."""
    return stamp_ns is None or before_ns is None or not 0 < before_ns - stamp_ns < NS_PER_S


def yaw(turned: Quaternion) -> float:
    """Return the azimuth of the x axis, rad; of a steep one, that of the y axis less 90°."""
    ahead = rotation.rotate(turned, (1.0, 0.0, 0.0))
    if math.hypot(ahead[0], ahead[1]) > 1e-3:
        return vector.azimuth(ahead)
    return vector.wrap(vector.azimuth(rotation.rotate(turned, (0.0, 1.0, 0.0))) - math.pi / 2.0)
