"""Rigid bodies of a stream by their names, in timed frames: checked, in {W}, as tracked objects. Pure."""

import math
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pointit.bridges.mocap.config import MAX_BODIES, MocapConfig
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.maps.frames import point_in_world
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.schemas import NS_PER_S, TrackedObject
from pointit.schemas.environment import Frame
from pointit.schemas.expiring_dict import ExpiringDict
from pointit.schemas.text import first_of, first_problem

MAX_COORDINATE = 1e6
"""Limit of a coordinate in any unit. Unseen bodies may have NaN or 1e20."""
ARRIVAL_SIGMA_S = 0.02
"""1 sigma of the time of exposure if the server states no times of a known clock, s."""

MAX_BODY_AGE_NS = NS_PER_S // 5
"""Time for which an unseen body keeps its position and speed, ns."""
UNSEEN_NS = 2 * NS_PER_S
"""Time after which it is reported."""
REPORT_NS = 10 * NS_PER_S
"""Time for which a jump is reported."""
MAX_SPEED_MPS = 10.0
JUMP_M = 0.1
MAX_RATE_RADPS = 30.0
"""Speed of turning above which a body may have jumped."""
JUMP_RAD = 0.6
"""A body that turns by more than the speed allows, and this much, has jumped; `JUMP_M`: of a move."""
MIN_ALIKE = math.cos(JUMP_RAD / 2.0)
"""Scalar product of two quaternions below which the turn between them is larger than `JUMP_RAD`."""
JUMP_NS = 3 * NS_PER_S // 10
"""Time after which a body that jumped is used again, ns."""
SWAP_NS = 3 * NS_PER_S
"""Time after which one that jumped to where another body was is used again, ns."""
MIN_MEASURED = 3
"""Least number of markers that cameras see, below which Motive computes the others by the model."""
MIN_SIGMA_M = 0.001
"""Least 1 sigma of a position, m: the error that servers state is that of the fit to the markers."""
MAX_SIGMA_M = 1.0
"""Largest 1 sigma of a position, m."""
MAX_DISTANCE_M = 100.0
"""Largest distance from the origin of the stream, m."""
MIN_HEIGHT_M = -0.5
"""Least height above the floor of a body, m."""
HEAD_HEIGHTS_M = (0.8, 2.3)
"""Limits of the height of a head above the floor when it is first used, m."""
MAX_NAMES = 10
"""Number of names in a sentence."""
VELOCITY_NS = NS_PER_S // 10
"""Time over which a velocity is taken, ns."""


class BodySample(NamedTuple):
    """A rigid body in a frame."""

    id: int
    position_m: Vec3
    orientation_xyzw: Quaternion
    error_m: float
    """Mean distance of the markers from the model, m."""
    is_tracked: bool
    measured: int | None
    """Number of its markers that cameras saw, or None if the frame does not tell."""
    fault: str = ""
    """Reason why the stream does not tell which body it is, or `""`."""


@dataclass(frozen=True)
class TimedFrame:
    """The named bodies of one frame, and the time of its exposure."""

    stamp_ns: int
    sigma_s: float
    """1 sigma of `stamp_ns`, s."""
    bodies: tuple[tuple[str, BodySample], ...]
    up: str = "y"
    """Axis of the stream that points up, `y` or `z`, unless the configuration states another."""


def decode_name(data: bytes) -> str:
    """Return a text in UTF-8, or in the code page of Windows, in which old versions write."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def body_sample(
    number: int,
    position_m: Sequence[float],
    orientation_xyzw: Sequence[float],
    error_m: float,
    *,
    is_tracked: bool = True,
) -> BodySample:
    """Return a body; one whose values are not finite, too large or no rotation is not tracked."""
    x, y, z = position_m
    qx, qy, qz, qw = orientation_xyzw
    length = math.hypot(qx, qy, qz, qw)
    limit = MAX_COORDINATE
    is_placed = -limit < x < limit and -limit < y < limit and -limit < z < limit  # False for NaN as well
    if not is_placed or not 0.9 < length < 1.1:
        return BodySample(number, (0.0, 0.0, 0.0), rotation.IDENTITY, 0.0, is_tracked=False, measured=None)
    orientation = (qx / length, qy / length, qz / length, qw / length)
    error_m = error_m if math.isfinite(error_m) else 0.0
    return BodySample(number, (x, y, z), orientation, error_m, is_tracked, measured=None)


class BodyPose(NamedTuple):
    """A body in {W}."""

    name: str
    stamp_ns: int
    position_m: Vec3
    orientation_xyzw: Quaternion
    sigma_m: float


@dataclass
class _Track:
    """Course of one body."""

    pose: BodyPose | None = None
    """The last one that was used."""
    poses: deque[BodyPose] = field(default_factory=deque[BodyPose])
    streamed_ns: int = 0
    """Time of the last frame that has it."""
    seen_ns: int = 0
    """Time at which it was seen last, used or not."""
    jumped_ns: int = 0
    """Time of the jump since which it is not used, or 0."""
    fault: str = ""
    """Reason why it was not used in the last frame, or `""`."""

    @property
    def velocity_mps(self) -> Vec3:
        """Return the mean velocity in `poses`, which is 0 if they are too few."""
        first = self.poses[0]
        last = self.poses[-1]
        since_ns = last.stamp_ns - first.stamp_ns
        if since_ns <= VELOCITY_NS / 2:
            return (0.0, 0.0, 0.0)
        step_m = vector.subtract(last.position_m, first.position_m)
        return vector.scale(step_m, NS_PER_S / since_ns)


class Bodies:
    """The bodies of a stream."""

    def __init__(self, config: MocapConfig) -> None:
        self._config = config
        self._tracks: dict[str, _Track] = {}
        self._jumps = ExpiringDict[str, None](REPORT_NS)
        """Sentences about jumps."""
        self._frame_ns = 0
        self._has_head = False
        """True once a head was where one can be, so that axes and unit of the stream are right."""

    def update(self, timed: TimedFrame, frame: Frame | None) -> list[BodyPose]:
        """Return the usable bodies of a frame, in {W}. `frame`: that of the cameras, None for {W}."""
        self._frame_ns = timed.stamp_ns
        if len(self._tracks) > MAX_BODIES:
            self._tracks = {name: track for name, track in self._tracks.items() if self._is_streamed(track)}

        # Bodies of this frame in the room, each with the reason why it is not used
        counts = Counter(name for name, _ in timed.bodies)
        poses: list[tuple[_Track, BodyPose]] = []
        head_tracks: list[_Track] = []
        is_y_up = (self._config.up or timed.up) == "y"
        scale = 0.001 if self._config.unit == "mm" else 1.0
        for name, body in timed.bodies:
            track = self._tracks.setdefault(name, _Track())
            track.streamed_ns = timed.stamp_ns
            track.fault = _fault(name, body, counts[name])
            if track.fault:
                continue
            pose = _in_world(name, body, timed.stamp_ns, frame, is_y_up=is_y_up, scale=scale)
            if track.pose is None or track.jumped_ns:
                distance_m = scale * math.hypot(*body.position_m)
                track.fault = self._implausibility(pose, distance_m)
            if self._is_head(name):
                head_tracks.append(track)
            if not track.fault:
                poses.append((track, pose))

        # A head shows that axes and unit are right. After a jump to where none can be they may be others
        refused = [track for track in head_tracks if track.fault]
        has_jumped = any(track.jumped_ns for track in refused)
        is_confirmed = len(head_tracks) > len(refused)
        self._has_head = is_confirmed or (self._has_head and not has_jumped)
        if refused and not self._has_head:
            return []  # the same axes and unit are those of all bodies

        # All are judged before any is used: one may have jumped to where another was
        used = [(track, pose) for track, pose in poses if self._is_plausible(track, pose)]
        for track, pose in used:
            _follow(track, pose)
        return [pose for _, pose in used]

    def current(self, now_ns: int) -> Iterator[tuple[BodyPose, Vec3]]:
        """Yield the bodies that are seen, with their velocities. `now_ns`: time of the newest frame."""
        for track in self._tracks.values():
            pose = track.pose
            if pose is not None and 0 <= now_ns - pose.stamp_ns <= MAX_BODY_AGE_NS:
                yield pose, track.velocity_mps

    def objects(self, now_ns: int) -> tuple[TrackedObject, ...]:
        """Return the bodies that no person wears at `now_ns`."""
        worn = {name for name, config in self._config.bodies.items() if config.person}
        objects: list[TrackedObject] = []
        for pose, velocity_mps in self.current(now_ns):
            if pose.name not in worn:
                objects.append(self._object(pose, velocity_mps, now_ns))
        return tuple(objects)

    def states(self) -> dict[str, bool]:
        """Return the bodies of the stream by name: True if it is used in the last frame."""
        states: dict[str, bool] = {}
        for name, track in self._tracks.items():
            if self._is_streamed(track):
                states[name] = track.pose is not None and track.pose.stamp_ns == self._frame_ns
        return states

    def problem(self, now_ns: int) -> str:
        """Return a sentence about bodies that are not used, or `""`."""
        self._jumps.expire(now_ns)
        problems = list(self._jumps)

        # Bodies that are configured and not there
        names = sorted(self.states())
        for name in self._config.bodies:
            if name in names or not self._frame_ns:
                continue
            hint = did_you_mean(name, names)
            if not hint:
                hint = f"it has {first_of(names, MAX_NAMES) or 'none'};"
            program = self._config.program
            problems.append(
                f"{program} streams no body {name!r}: {hint} correct `bodies`, or rename it there"
            )

        # Bodies that are there and not used. A covered one matters only if it has a meaning
        for name in names:
            track = self._tracks[name]
            is_reported = name in self._config.bodies or "uncover" not in track.fault
            if not track.fault or not is_reported:
                continue
            last_ns = 0 if track.pose is None else track.pose.stamp_ns
            if self._frame_ns - last_ns > UNSEEN_NS:
                problems.append(track.fault)
        return first_problem(problems)

    def _is_streamed(self, track: _Track) -> bool:
        return self._frame_ns - track.streamed_ns <= UNSEEN_NS

    def _is_head(self, name: str) -> bool:
        worn = self._config.bodies.get(name)
        if worn is None or not worn.person:
            return False
        return worn.part == "head"

    def _implausibility(self, pose: BodyPose, distance_m: float) -> str:
        """Return a sentence if a body is where none can be, so that unit or axes are not those declared."""
        if distance_m > MAX_DISTANCE_M:
            distance = f"{distance_m:.0f} m from the cameras' origin"
            return f"{pose.name} is {distance}, limit {MAX_DISTANCE_M:.0f} m: correct `unit`"
        low_m = MIN_HEIGHT_M
        high_m = math.inf
        if self._is_head(pose.name):
            low_m, high_m = HEAD_HEIGHTS_M
        height_m = pose.position_m[2]
        if low_m <= height_m <= high_m:
            return ""
        height = f"{height_m:.2f} m above the floor"
        limits = f"{low_m:g} to {high_m:g} m are accepted at first"
        return f"{pose.name} is {height}, {limits}: correct `up`, `unit`, `frame` or `bodies`"

    def _is_plausible(self, track: _Track, pose: BodyPose) -> bool:
        """Return False if the body has just jumped."""
        last = track.pose
        since_s = (pose.stamp_ns - track.seen_ns) / NS_PER_S
        track.seen_ns = pose.stamp_ns
        if last is None or not _has_jumped(last, pose, since_s):
            track.jumped_ns = 0
            return True

        # Exchanged, if another body was just there
        nearest = self._nearest_other(pose) or last
        moved_m = math.dist(last.position_m, pose.position_m)
        apart_m = math.dist(nearest.position_m, pose.position_m)
        is_swap = nearest is not last and apart_m < JUMP_M < moved_m
        if not track.jumped_ns:
            track.jumped_ns = pose.stamp_ns
            text = f"{pose.name} jumped by {moved_m:.2f} m at once and is not used until it stays"
            if is_swap:
                program = self._config.program
                text = f"{pose.name} is where {nearest.name} was: {program} has exchanged them"
            self._jumps.put(f"{text}; make their markers more different", None, pose.stamp_ns)

        # Used again when it has stayed there, with a velocity from there on
        wait_ns = SWAP_NS if is_swap else JUMP_NS
        if pose.stamp_ns - track.jumped_ns < wait_ns:
            return False
        track.poses.clear()
        track.jumped_ns = 0
        return True

    def _nearest_other(self, pose: BodyPose) -> BodyPose | None:
        """Return the last pose nearest to `pose` of another body that may have been exchanged with it."""
        others: list[BodyPose] = []
        for track in self._tracks.values():
            other = track.pose
            if other is None or other.name == pose.name:
                continue
            if pose.stamp_ns - other.stamp_ns <= SWAP_NS:
                others.append(other)
        return min(others, key=lambda other: math.dist(other.position_m, pose.position_m), default=None)

    def _object(self, pose: BodyPose, velocity_mps: Vec3, now_ns: int) -> TrackedObject:
        config = self._config.bodies.get(pose.name)
        kind = "object"
        length_m = 0.1
        if config is not None:
            kind = config.kind
            length_m = config.length_m
        yaw_rad = None
        if kind == "robot":
            yaw_rad = vector.azimuth(rotation.rotate(pose.orientation_xyzw, (1.0, 0.0, 0.0)))
        age_s = (now_ns - pose.stamp_ns) / NS_PER_S
        position_m = vector.add(pose.position_m, vector.scale(velocity_mps, age_s))
        return TrackedObject(
            id=pose.name[:64],
            kind=kind,
            position_m=position_m,
            velocity_mps=velocity_mps,
            length_m=length_m,
            yaw_rad=yaw_rad,
            position_sigma_m=pose.sigma_m,
        )


def _in_world(
    name: str, body: BodySample, stamp_ns: int, frame: Frame | None, *, is_y_up: bool, scale: float
) -> BodyPose:
    position_m = vector.scale(body.position_m, scale)
    orientation = body.orientation_xyzw
    sigma_m = scale * body.error_m
    if is_y_up:
        x, y, z = position_m
        position_m = (x, -z, y)
        qx, qy, qz, qw = orientation
        orientation = (qx, -qz, qy, qw)
    if frame is not None:
        position_m = point_in_world(position_m, frame)
        orientation = rotation.multiply(frame.orientation_xyzw, orientation)
    if not MIN_SIGMA_M <= sigma_m <= MAX_SIGMA_M:
        sigma_m = MIN_SIGMA_M if sigma_m < MIN_SIGMA_M else MAX_SIGMA_M
    return BodyPose(name, stamp_ns, position_m, orientation, sigma_m)


def _fault(name: str, body: BodySample, count: int) -> str:
    """Return the reason why a body cannot be used, or `""`."""
    if body.fault:
        return body.fault
    if count > 1:
        return f"two bodies are called {name!r} and are not used: rename one"
    if not body.is_tracked:
        return f"{name} is not seen: uncover its markers"
    if body.measured is not None and body.measured < MIN_MEASURED:
        return f"{name} has {body.measured} markers that cameras see, {MIN_MEASURED} are needed: uncover them"
    return ""


def _has_jumped(last: BodyPose, pose: BodyPose, since_s: float) -> bool:
    if math.dist(last.position_m, pose.position_m) > MAX_SPEED_MPS * since_s + JUMP_M:
        return True
    ax, ay, az, aw = last.orientation_xyzw
    bx, by, bz, bw = pose.orientation_xyzw
    alike = abs(ax * bx + ay * by + az * bz + aw * bw)
    if alike >= MIN_ALIKE:
        return False
    turn_rad = 2.0 * math.acos(alike)
    return turn_rad > MAX_RATE_RADPS * since_s + JUMP_RAD


def _follow(track: _Track, pose: BodyPose) -> None:
    poses = track.poses
    if poses and not 0 < pose.stamp_ns - poses[-1].stamp_ns <= MAX_BODY_AGE_NS:
        poses.clear()
    track.pose = pose
    poses.append(pose)
    while len(poses) > 2 and pose.stamp_ns - poses[1].stamp_ns >= VELOCITY_NS:
        poses.popleft()
