"""One person in a recorded session: rays of each localization, what they were pointed at, the truth."""

import math
from array import array
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Anchor, Localization, PointingRay, UserPose
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import unfiltered_rays
from pointit.services.localizer.estimation.estimator import Pointings
from pointit.services.localizer.procedure import Hold
from pointit.services.localizer.static_targets import MIN_LAMPS
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial

SET = "recordings"
"""Name of the set of all sessions."""

GAP_S = 1.0
"""A position counts for this long before and after its own time, for the person's as for the robot's."""

MAX_SAMPLES = 2_000_000
"""Limit of rays or positions of one person, eleven hours at 50 Hz; further ones are ignored."""


class Course:
    """Values over time, in arrays."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._times_ns = array("q")
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._times_ns)

    def add(self, time_ns: int, values: tuple[float, ...]) -> None:
        """Add the values of a time that is later than the last; others are ignored."""
        if len(self) >= MAX_SAMPLES:
            return
        is_first = not self._times_ns
        if not is_first and time_ns <= self._times_ns[-1]:
            return
        self._times_ns.append(time_ns)
        self._values.extend(values)

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """Return the times (n)."""
        return np.array(self._times_ns, dtype=np.int64)

    @property
    def values(self) -> Array:
        """Return the values (n x width)."""
        values = np.array(self._values, dtype=np.float64)
        return values.reshape(-1, self._width)

    def at(self, times_ns: NDArray[np.int64]) -> Array:
        """Return the interpolated values (k x width) at `times_ns`; NaN where none is within `GAP_S`."""
        shape = (len(times_ns), self._width)
        if not len(self):
            return np.full(shape, math.nan)
        own_ns = self.times_ns
        values = self.values
        # relative times: nanoseconds since 1970 exceed the precision of floats
        asked_ns = times_ns - own_ns[0]
        known_ns = own_ns - own_ns[0]
        interpolated = np.empty(shape)
        for axis in range(self._width):
            interpolated[:, axis] = np.interp(asked_ns, known_ns, values[:, axis])

        # the neighbours of each time
        after = np.searchsorted(own_ns, times_ns)
        after = after.clip(0, len(own_ns) - 1)
        before = (after - 1).clip(0)
        neighbours_ns = own_ns[np.stack([after, before])]
        apart_ns = np.abs(neighbours_ns - times_ns).min(axis=0)
        interpolated[apart_ns > GAP_S * NS_PER_S] = math.nan
        return interpolated


class PersonInSession:
    """Collects what a recording has of one person."""

    def __init__(self, user: str, config: LocalizerConfig) -> None:
        self.user = user
        self._config = config
        self.truth = Course(3)
        """Position in {W}, m, of a tracker."""
        self.yaws = Course(2)
        """Cosine and sine of the yaw of {H}, of a tracker that knows it."""
        self.poses: dict[int, UserPose] = {}
        """Poses that the localizer found, by the time of the pointing that determined them."""
        self.anchors: list[Anchor] = []
        self.follows: dict[str, Course] = {}
        """Times, origins and directions of rays at a moving target, by its id."""
        self._sessions: dict[int, list[tuple[Hold, Vec3]]] = {}
        """Holds at lamps, by the beginning of the localization."""
        self._target = ("", -1)
        self._since_ns = 0

    @property
    def was_localized(self) -> bool:
        """Return True if pointing in order to be localized is recorded, or a pose that was found."""
        return bool(self._sessions or self.follows or self.poses)

    def on_pose(self, pose: UserPose) -> None:
        """Note a true pose, or one of the localizer's."""
        if pose.method == "external":
            self.truth.add(pose.stamp_ns, pose.position_m)
            self.add_yaw(pose.stamp_ns, pose.yaw_rad)
        elif pose.method != "fixed":
            self.poses.setdefault(pose.anchored_ns, pose)

    def add_yaw(self, time_ns: int, yaw_rad: float) -> None:
        """Note the true yaw of {H}."""
        direction = (math.cos(yaw_rad), math.sin(yaw_rad))
        self.yaws.add(time_ns, direction)

    def on_localization(self, message: Localization, lamps: dict[str, Vec3]) -> None:
        """Note what the person points at from now on."""
        is_on = message.phase == "sampling" and message.purpose == "pose"
        target = ("", -1)
        if is_on:
            target = (message.target_id, message.target_index)
        self._since_ns = message.since_ns
        if target == self._target:
            return
        self._target = target
        name, _ = target
        if name in lamps:
            hold = Hold(message.stamp_ns, self._config)
            holds = self._sessions.setdefault(message.since_ns, [])
            holds.append((hold, lamps[name]))
        elif name:
            self.follows.setdefault(name, Course(6))

    def on_ray(self, ray: PointingRay) -> None:
        """Add a ray if the person is being localized."""
        target, _ = self._target
        if target in self.follows:
            direction = unfiltered_rays.unfiltered(ray)
            self.follows[target].add(ray.stamp_ns, (*ray.origin_m, *direction))
        elif target:
            hold, _ = self._sessions[self._since_ns][-1]
            hold.add(ray)

    def trials(self, tracks: dict[str, Course]) -> Iterator[LocalizationTrial]:
        """Yield the trials whose truth is known. `tracks`: positions (3) of moving targets."""
        for target, course in self.follows.items():
            if target in tracks:
                yield from self._following(course, tracks[target])
        for holds in self._sessions.values():
            lamps = sum(bool(hold.rays) for hold, _ in holds)
            if lamps >= MIN_LAMPS:
                yield from self._lamps(holds)

    def _following(self, course: Course, track: Course) -> Iterator[LocalizationTrial]:
        times_ns = course.times_ns
        rays = course.values
        targets = track.at(times_ns)
        heads = self.truth.at(times_ns)
        # repeated samples are old; the truth has gaps
        steps = np.diff(rays, axis=0)
        is_new = np.any(steps != 0.0, axis=1)
        fresh = np.append(True, is_new)
        has_target = np.isfinite(targets).all(axis=1)
        has_head = np.isfinite(heads).all(axis=1)
        known = fresh & has_target & has_head
        if np.count_nonzero(known) < 2:
            return
        times_ns = times_ns[known]
        rays = rays[known]
        heads = heads[known]
        origins_m = rays[:, :3]
        stamps_s = (times_ns - times_ns[0]) / NS_PER_S
        pointings = Pointings(stamps_s, origins_m, rays[:, 3:], targets[known])
        recording = FollowRecording(
            set=SET,
            subject=self.user,
            pointings=pointings,
            heads_m=heads,
            eye_height_m=float(rays[:, 2].mean()),
            yaw_rad=self._yaw_rad(times_ns, pointings, heads),
        )
        yield from recording.trials()

    def _lamps(self, holds: list[tuple[Hold, Vec3]]) -> Iterator[LocalizationTrial]:
        rays: list[PointingRay] = []
        lamps_m: list[Vec3] = []
        for hold, lamp_m in holds:
            rays += hold.rays
            lamps_m += [lamp_m] * len(hold.rays)
        places = np.array(lamps_m, dtype=np.float64)
        times_ns = np.array([ray.stamp_ns for ray in rays], dtype=np.int64)
        # one gap in the truth leaves the whole trial without one
        heads = self.truth.at(times_ns)
        if not np.isfinite(heads).all():
            return
        stamps_s = (times_ns - times_ns[0]) / NS_PER_S
        origins_m = unfiltered_rays.origins(rays)
        directions = unfiltered_rays.directions(rays)
        pointings = Pointings(stamps_s, origins_m, directions, places)
        lamps = len(np.unique(places, axis=0))
        yield LocalizationTrial(
            set=SET,
            subject=self.user,
            condition=f"{lamps} lamps",
            pointings=pointings,
            eye_height_m=float(origins_m[:, 2].mean()),
            x_m=float(heads[:, 0].mean()),
            y_m=float(heads[:, 1].mean()),
            yaw_rad=self._yaw_rad(times_ns, pointings, heads),
        )

    def _yaw_rad(self, times_ns: NDArray[np.int64], pointings: Pointings, heads: Array) -> float:
        """Return the true yaw of {H}: a tracker's, else that in which rays meet their targets on average."""
        if len(self.yaws):
            directions = self.yaws.at(times_ns)
            is_known = np.isfinite(directions).all(axis=1)
            directions = directions[is_known]
            if len(directions):
                cosine = float(directions[:, 0].mean())
                sine = float(directions[:, 1].mean())
                return math.atan2(sine, cosine)
        away = pointings.targets_m - heads
        aims = pointings.directions
        target_azimuths = np.arctan2(away[:, 1], away[:, 0])
        aim_azimuths = np.arctan2(aims[:, 1], aims[:, 0])
        turned = target_azimuths - aim_azimuths
        sine = float(np.sin(turned).mean())
        cosine = float(np.cos(turned).mean())
        return math.atan2(sine, cosine)
