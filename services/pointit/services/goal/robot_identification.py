"""Identification of the robot that a person points at, from the last seconds of rays and of robots' tracks.

Pure. Each robot, and "none", is a hypothesis about the angles by which the rays miss a target. Errors that
last (place, yaw, aim, elevation bias, latency of the tracker) are common to all rays of the window: they are
integrated out, so a robot that moves, and is followed, differs from one that merely lies near the ray.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Candidate, PointingRay, UserPose
from pointit.services.goal.aim_evidence import Array, IdentificationSettings, RayBlocks, log_likelihoods

MAX_RAYS = 2048
"""Largest number of rays in the window; the oldest are dropped."""

MAX_AHEAD_S = 0.5
"""Longest time for which a robot is extrapolated beyond its newest report."""

MIN_LEVEL = 0.2
"""Lower bound of the cosine of an elevation: a steeper ray has no usable azimuth."""

MIN_STEP_S = 1e-3
"""Lower bound of the time between two reports: their difference is no velocity if a clock was set."""

MAX_VARIANCE = 1e4
"""Upper bound of a pose's variances: m², rad²."""


@dataclass(frozen=True)
class Identification:
    """Probability of each robot, and of none."""

    candidates: tuple[Candidate, ...] = ()
    """Likeliest first."""
    none_probability: float = 1.0
    chosen: str = ""
    """The robot that is meant, or `""` if that is unsure."""


@dataclass
class _Track:
    places: deque[tuple[int, Vec3]] = field(default_factory=lambda: deque[tuple[int, Vec3]](maxlen=MAX_RAYS))
    position_sigma_m: float = 0.0
    latency_sigma_s: float | None = None


class RobotIdentifier:
    """Keeps the window of rays and tracks of one person, and identifies the robot on request."""

    def __init__(self, settings: IdentificationSettings | None = None) -> None:
        self._settings = settings if settings is not None else IdentificationSettings()
        self._window_ns = round(self._settings.window_s * NS_PER_S)
        self._rays: deque[PointingRay] = deque(maxlen=MAX_RAYS)
        self._tracks: dict[str, _Track] = {}
        self._pose: UserPose | None = None

    def on_ray(self, ray: PointingRay) -> None:
        """Add `ray`. One that is not newer than the last is ignored, unless the clock was set back."""
        if self._rays and ray.stamp_ns <= self._rays[-1].stamp_ns:
            if ray.stamp_ns >= self._rays[-1].stamp_ns - self._window_ns:
                return
            self._rays.clear()
        self._rays.append(ray)
        while self._rays[0].stamp_ns < ray.stamp_ns - self._window_ns:
            self._rays.popleft()

    def on_pose(self, pose: UserPose | None) -> None:
        """Set the person's pose. None: unknown."""
        self._pose = pose

    def on_robot(
        self,
        robot: str,
        stamp_ns: int,
        position_m: Vec3,
        *,
        position_sigma_m: float | None = None,
        latency_sigma_s: float | None = None,
    ) -> None:
        """Add a report of `robot`.

        Args:
            robot: its name.
            stamp_ns: time of the position.
            position_m: {W}.
            position_sigma_m: 1 sigma of the position. None: exact.
            latency_sigma_s: 1 sigma of the tracker's latency. None: that of the settings alone.
        """
        track = self._tracks.setdefault(robot, _Track())
        places = track.places
        if places and stamp_ns <= places[-1][0]:
            if stamp_ns >= places[-1][0] - self._window_ns:
                return
            places.clear()
        places.append((stamp_ns, position_m))
        while len(places) > 2 and places[1][0] < stamp_ns - 2 * self._window_ns:
            places.popleft()
        track.position_sigma_m = position_sigma_m or 0.0
        track.latency_sigma_s = latency_sigma_s

    def forget(self, robot: str) -> None:
        """Remove a robot that has left."""
        self._tracks.pop(robot, None)

    def identify(self, now_ns: int) -> Identification:
        """Return the probabilities at `now_ns`; those of none if there are no recent rays, or no pose."""
        stale_ns = round(self._settings.stale_s * NS_PER_S)
        tracks = {
            robot: track
            for robot, track in self._tracks.items()
            if track.places and abs(now_ns - track.places[-1][0]) <= stale_ns
        }
        pose = self._pose
        is_recent = bool(self._rays) and abs(now_ns - self._rays[-1].stamp_ns) <= stale_ns
        if not tracks or pose is None or not is_recent:
            return Identification()
        blocks = _blocks(self._rays, pose, self._settings.block_s)
        settings = self._settings
        found_at = [
            self._missed(blocks, track, pose, beside_m)
            for beside_m in (0.0, settings.beside_sigma_m)
            for track in tracks.values()
        ]
        means, spreads = zip(*found_at, strict=True)
        logs = log_likelihoods(blocks, np.stack(means), np.stack(spreads), settings)
        beside = settings.none_prior * settings.beside_share
        shares = np.array([1.0 - settings.none_prior, beside]) / len(tracks)
        prior = np.append(np.repeat(shares, len(tracks)), settings.none_prior - beside)
        odds = prior * np.exp(logs - logs.max())
        odds /= odds.sum()
        found = [
            Candidate(object_id=robot, probability=min(1.0, float(share)))
            for robot, share in zip(tracks, odds, strict=False)  # then come the places beside them
        ]
        found.sort(key=lambda each: -each.probability)
        is_sure = found[0].probability >= self._settings.chosen
        none = min(1.0, float(odds[len(tracks) :].sum()))
        return Identification(tuple(found), none, found[0].object_id if is_sure else "")

    def _missed(
        self, blocks: RayBlocks, track: _Track, pose: UserPose, beside_m: float
    ) -> tuple[Array, Array]:
        """Return the angles from the rays to a robot (2n: sideways, upwards), and their lasting errors.

        Those to places beside it if `beside_m`, 1 sigma of their distance from it per axis, is not 0.

        Returns:
            2n; 2n x 2n, the covariance of errors that are common to all rays, rad².
        """
        settings = self._settings
        places, velocities = _positions(track, blocks.times_ns)
        seen = places - blocks.eyes_m
        level = np.maximum(np.hypot(seen[:, 0], seen[:, 1]), 1e-3)
        reach = np.hypot(level, seen[:, 2])
        flat = np.maximum(level / reach, MIN_LEVEL)
        turn = np.arctan2(seen[:, 1], seen[:, 0]) - blocks.angles[:, 0]
        aside = (np.remainder(turn + math.pi, math.tau) - math.pi) * flat
        upwards = np.arctan2(seen[:, 2], level) - blocks.angles[:, 1]
        # by place (x, y, z), yaw with aim, elevation, latency
        slope = np.zeros((2, len(level), 6))
        slope[0, :, 0], slope[0, :, 1] = -seen[:, 1] / level**2 * flat, seen[:, 0] / level**2 * flat
        slope[1, :, :2] = -seen[:, 2:] * seen[:, :2] / (level * reach**2)[:, None]
        slope[1, :, 2] = level / reach**2
        slope[0, :, 3], slope[1, :, 4] = flat, 1.0
        slope[:, :, 5] = np.einsum("knj,nj->kn", slope[:, :, :3], velocities)
        errors = np.zeros((6, 6))
        errors[np.ix_([0, 1, 3], [0, 1, 3])] = _valid(np.array(pose.covariance).reshape(3, 3))
        level_m2 = settings.body_sigma_m**2 + track.position_sigma_m**2 + beside_m**2
        height_m2 = settings.height_sigma_m**2 + track.position_sigma_m**2
        late_s2 = settings.latency_sigma_s**2 + (track.latency_sigma_s or 0.0) ** 2
        own = [level_m2, level_m2, height_m2, settings.aim_sigma_rad**2, settings.bias_sigma_rad**2, late_s2]
        rows = slope.reshape(-1, 6)
        spread = rows @ (errors + np.diag(own)) @ rows.T
        return np.concatenate([aside, upwards]), np.asarray(spread, dtype=np.float64)


def _valid(stated: Array) -> Array:
    """Return the nearest covariance to that of a message, which may be none, within `MAX_VARIANCE`."""
    values, vectors = np.linalg.eigh(0.5 * (stated + stated.T))
    return np.asarray((vectors * np.clip(values, 0.0, MAX_VARIANCE)) @ vectors.T, dtype=np.float64)


def _blocks(rays: Sequence[PointingRay], pose: UserPose, block_s: float) -> RayBlocks:
    """Return the means of `rays` in {W} at `pose`, by blocks of `block_s` that end at the newest."""
    stamps = np.array([ray.stamp_ns for ray in rays], dtype=np.int64)
    ages = (stamps[-1] - stamps) // round(block_s * NS_PER_S)
    first = np.flatnonzero(np.append(True, np.diff(ages) != 0))
    counts = np.diff(np.append(first, len(stamps)))[:, None]
    origins = np.add.reduceat(np.array([ray.origin_m for ray in rays]), first) / counts
    aims = np.add.reduceat(np.array([ray.direction for ray in rays]), first)
    cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    azimuths = np.unwrap(np.arctan2(aims[:, 1], aims[:, 0])) + pose.yaw_rad
    elevations = np.arctan2(aims[:, 2], np.hypot(aims[:, 0], aims[:, 1])) - pose.elevation_bias_rad
    since = stamps - stamps[0]
    times = stamps[0] + np.rint(np.add.reduceat(since, first) / counts[:, 0]).astype(np.int64)
    return RayBlocks(times, np.array(pose.position_m) + origins @ turn.T, np.stack([azimuths, elevations], 1))


def _positions(track: _Track, times_ns: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return positions and velocities (n x 3) at `times_ns`; at rest before the first report."""
    base_ns = track.places[0][0]
    own_s = np.array([stamp_ns - base_ns for stamp_ns, _ in track.places]) / NS_PER_S
    places = np.array([place for _, place in track.places], dtype=np.float64)
    wanted_s = np.minimum((times_ns - base_ns) / NS_PER_S, own_s[-1] + MAX_AHEAD_S)
    if len(own_s) < 2:
        return np.repeat(places, len(times_ns), axis=0), np.zeros((len(times_ns), 3))
    speeds = np.diff(places, axis=0) / np.maximum(np.diff(own_s), MIN_STEP_S)[:, None]
    leg = np.clip(np.searchsorted(own_s, wanted_s) - 1, 0, len(speeds) - 1)
    velocities = np.where((wanted_s < 0.0)[:, None], 0.0, speeds[leg])
    return places[leg] + (wanted_s - own_s[leg])[:, None] * velocities, velocities
