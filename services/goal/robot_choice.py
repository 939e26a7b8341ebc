"""The robot that a person points at, from the last seconds of rays, and cues when it is not clear which.

Pure. Each robot, and "none", is a hypothesis about the angles by which the rays miss a target. Errors that
last (place, yaw, aim, elevation bias, latency of the tracker) are common to all rays of the window: they are
integrated out, so a robot that moves, and is followed, differs from one that merely lies near the ray.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Candidate, PointingRay, RobotState, UserPose
from pointit.schemas.text import all_of

NO_TARGET_RAD = np.array([1.8, 0.5])
"""1 sigma of the direction of a ray at no robot: about its mean azimuth, and `DOWNWARDS_RAD`."""

DOWNWARDS_RAD = math.radians(-15.0)
"""Mean elevation of rays at no robot."""

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

PERIOD_NS = NS_PER_S // 5
"""Time between two identifications without a press."""
PENDING_NS = 3 * NS_PER_S
"""Time after a press within which an unclear choice may still become clear by pointing on."""
LIKELY = 0.1
"""Probability from which a robot is named as one that may be meant."""
ONE = 0.8
"""Share of the likeliest robot in all likely ones from which only a place beside it may be meant instead."""
RATHER = 0.5
"""Probability from which staying asks whether a robot is meant: nothing else says that one is wanted."""
SHOWN_STEP = 0.05
"""Resolution of published probabilities, which are rounded down: what is shown is not stated too high."""


@dataclass(frozen=True, kw_only=True)
class IdentificationSettings:
    """Errors of people who point, and limits."""

    window_s: float = 3.0
    block_s: float = 0.25
    """Rays of this time count as one measurement."""
    ray_sigma_rad: float = math.radians(2.0)
    """Standard deviation of the error of a block that changes within a pointing."""
    correlation_s: float = 0.5
    """Correlation time of that error."""
    scales: tuple[float, ...] = (0.5, 1.0, 2.0)
    """Factors on that error, equally probable: steady and restless people."""
    aim_sigma_rad: float = math.radians(5.0)
    """Standard deviation of the constant error of one pointing, sideways (pointing.md §7: 4 to 6 degrees)."""
    bias_sigma_rad: float = math.radians(4.0)
    """The same upwards."""
    body_sigma_m: float = 0.1
    """Standard deviation of the eyes' position over the feet."""
    height_sigma_m: float = 0.05
    latency_sigma_s: float = 0.15
    """Standard deviation of the delay between rays and reports: the person's lag, and the tracker's."""
    walks_rad: tuple[float, ...] = (0.0, math.radians(10.0), math.radians(40.0))
    """Movement of an arm that points at no robot: standard deviation after 1 s, equally probable."""
    began_s: tuple[float, ...] = (3.0, 2.0, 1.0, 0.5)
    """Times since which the person may have pointed at the present target, the longest first."""
    began_odds: tuple[float, ...] = (0.4, 0.2, 0.2, 0.2)
    none_prior: float = 0.5
    """Probability that the person points at no robot, before any ray."""
    beside_share: float = 0.8
    """Share of it that is of places beside robots, where people want one to go."""
    beside_sigma_m: float = 1.0
    """Standard deviation of such a place about a robot, per axis on the floor."""
    chosen: float = 0.9
    """Probability from which a robot is chosen."""
    max_age_s: float = 1.0
    """Robots whose newest report is older are no candidates, and rays older than this identify none."""


@dataclass(frozen=True)
class RayBlocks:
    """Means of rays, one row a block, in {W}."""

    times_ns: NDArray[np.int64]
    eyes_m: Array
    """n x 3."""
    angles: Array
    """n x 2: azimuth, unwrapped, and elevation, rad."""

    @property
    def ages_s(self) -> Array:
        """Return the times before the newest block."""
        return np.asarray((self.times_ns[-1] - self.times_ns) / NS_PER_S, dtype=np.float64)


def log_likelihoods(
    blocks: RayBlocks, missed: Array, spreads: Array, settings: IdentificationSettings
) -> Array:
    """Return the log likelihoods (k + 1) of the rays if they are at each robot, and at none.

    The person may have begun to point at it within the window; before, they pointed at nothing in particular.

    Args:
        blocks: n.
        missed: k x 2n, angles to the robots: all sideways ones, then all upwards.
        spreads: k x 2n x 2n, the covariances of their lasting errors.
        settings: errors of people.
    """
    ages = blocks.ages_s
    centre = np.array([blocks.angles[:, 0].mean(), DOWNWARDS_RAD])
    no_target = (blocks.angles - centre).T.ravel()
    noise = _of_both_axes(_correlated(ages, settings))
    constant = np.kron(np.diag(NO_TARGET_RAD**2), np.ones((len(ages), len(ages))))
    walked = _of_both_axes(np.minimum.outer(ages, ages))
    roams = constant + np.square(settings.walks_rad)[:, None, None] * walked
    logs = list[Array]()
    for began_s, odds in zip(settings.began_s, settings.began_odds, strict=True):
        late = np.flatnonzero(np.tile(ages <= began_s, 2))
        early = np.flatnonzero(np.tile(ages > began_s, 2))
        robots = [
            _log_density(miss[late], _part(spread, late), _part(noise, late), settings.scales)
            for miss, spread in zip(missed, spreads, strict=True)
        ]
        none = _at_none(no_target[late], _part(roams, late), _part(noise, late), settings)
        if len(early):
            before = _at_none(no_target[early], _part(roams, early), _part(noise, early), settings)
        else:
            before = 0.0
        logs.append(math.log(odds) + before + np.array([*robots, none]))
    return np.asarray(np.logaddexp.reduce(np.stack(logs)), dtype=np.float64)


def _part(matrices: Array, rows: NDArray[np.intp]) -> Array:
    return np.asarray(matrices[..., rows[:, None], rows], dtype=np.float64)


def _of_both_axes(matrix: Array) -> Array:
    """Return the covariance (2n x 2n) of independent errors on both axes, each of `matrix` (n x n)."""
    return np.asarray(np.kron(np.eye(2), matrix), dtype=np.float64)


def _correlated(ages: Array, settings: IdentificationSettings) -> Array:
    """Return the covariance (n x n) of errors that change within a pointing."""
    apart = np.abs(ages[:, None] - ages)
    return np.asarray(settings.ray_sigma_rad**2 * np.exp(-apart / settings.correlation_s), dtype=np.float64)


def _at_none(angles: Array, roams: Array, noise: Array, settings: IdentificationSettings) -> float:
    """Return the log density of `angles` of an arm that stays, or moves at any of the rates."""
    logs = [_log_density(angles, roam, noise, settings.scales) for roam in roams]
    return float(np.logaddexp.reduce(logs)) - math.log(len(logs))


def _log_density(values: Array, spread: Array, noise: Array, scales: Sequence[float]) -> float:
    """Return the log density of `values` with normal errors: `spread`, and `noise` times any of `scales`."""
    covariances = spread + np.square(scales)[:, None, None] * noise
    roots = np.linalg.cholesky(covariances)
    whitened = np.linalg.solve(roots, np.broadcast_to(values, (len(roots), len(values)))[..., None])[..., 0]
    sizes = np.log(np.einsum("kii->ki", roots)).sum(axis=1)
    logs = -0.5 * np.square(whitened).sum(axis=1) - sizes
    return float(np.logaddexp.reduce(logs)) - math.log(len(scales)) - 0.5 * len(values) * math.log(math.tau)


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
        self, robot: str, stamp_ns: int, position_m: Vec3, *, position_sigma_m: float | None = None
    ) -> None:
        """Add a report of `robot`, {W}. `position_sigma_m`: 1 sigma of its position, None if it is exact."""
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

    def forget(self, robot: str) -> None:
        """Remove a robot that has left."""
        self._tracks.pop(robot, None)

    def identify(self, now_ns: int) -> Identification:
        """Return the probabilities at `now_ns`; those of none if there are no recent rays, or no pose."""
        max_age_ns = round(self._settings.max_age_s * NS_PER_S)
        tracks = {
            robot: track
            for robot, track in self._tracks.items()
            if track.places and abs(now_ns - track.places[-1][0]) <= max_age_ns
        }
        pose = self._pose
        is_recent = bool(self._rays) and abs(now_ns - self._rays[-1].stamp_ns) <= max_age_ns
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
        slope[0, :, 0] = -seen[:, 1] / level**2 * flat
        slope[0, :, 1] = seen[:, 0] / level**2 * flat
        slope[1, :, :2] = -seen[:, 2:] * seen[:, :2] / (level * reach**2)[:, None]
        slope[1, :, 2] = level / reach**2
        slope[0, :, 3] = flat
        slope[1, :, 4] = 1.0
        slope[:, :, 5] = np.einsum("knj,nj->kn", slope[:, :, :3], velocities)
        errors = np.zeros((6, 6))
        errors[np.ix_([0, 1, 3], [0, 1, 3])] = _valid(np.array(pose.covariance).reshape(3, 3))
        level_m2 = settings.body_sigma_m**2 + track.position_sigma_m**2 + beside_m**2
        height_m2 = settings.height_sigma_m**2 + track.position_sigma_m**2
        lasting = np.square([settings.aim_sigma_rad, settings.bias_sigma_rad, settings.latency_sigma_s])
        own = [level_m2, level_m2, height_m2, *lasting]
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
    cos = math.cos(pose.yaw_rad)
    sin = math.sin(pose.yaw_rad)
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


class ChosenRobot(NamedTuple):
    """A result of pointing at robots."""

    robot: str
    """The robot that is meant, or `""` if it is unclear."""
    problem: str
    """One sentence for the person, or `""`."""


class RobotChoice:
    """Identifies the robot that one person points at, and takes it by a press or by staying on it."""

    def __init__(self, take: Literal["press", "dwell"], dwell_s: float) -> None:
        self._identifier = RobotIdentifier()
        self._take = take
        self._dwell_ns = round(dwell_s * NS_PER_S)
        self._next_ns = 0
        self._pressed_ns: int | None = None
        self._asked = ("", 0)
        """Robot that another press takes, and since when."""
        self._on = ("", 0)
        """Robot that is pointed at, and since when."""
        self._done: str = ""
        """Robot whose stay had a result, until another one, or none, is pointed at."""
        self.candidates: tuple[Candidate, ...] = ()
        """Robots that may be meant, in steps of `SHOWN_STEP`, the likeliest first."""

    def on_ray(self, ray: PointingRay) -> None:
        """Process a ray of the person."""
        self._identifier.on_ray(ray)

    def on_pose(self, pose: UserPose) -> None:
        """Update the person's own pose."""
        self._identifier.on_pose(pose)

    def on_robot(self, robot: str, state: RobotState) -> None:
        """Update the place of a robot."""
        if state.phase == "lost":
            self.forget(robot)
            return
        self._identifier.on_robot(
            robot, state.stamp_ns, state.position_m, position_sigma_m=state.position_sigma_m
        )

    def forget(self, robot: str) -> None:
        """Remove a robot that is no longer heard of."""
        self._identifier.forget(robot)

    def reset(self) -> None:
        """Withdraw an unclear choice, and show no candidates."""
        self._pressed_ns = None
        self._asked = self._on = ("", 0)
        self.candidates = ()

    def press(self, now_ns: int) -> ChosenRobot:
        """Return the robot pointed at.

        If it is unclear which, pointing on for a while may make it clear. If it is unclear whether one is
        meant at all, or a place near it, another press takes it.
        """
        chosen = self._identify(now_ns)
        (asked, asked_ns), self._asked = self._asked, ("", 0)
        candidates, one = self._likely()
        if one and one == asked and 0 <= now_ns - asked_ns <= PENDING_NS:
            chosen = chosen or asked
        if chosen:
            self._pressed_ns = None
            return ChosenRobot(chosen, "")
        if not candidates:
            self._pressed_ns = None
            return ChosenRobot("", "no robot is where you point: point at one, then press")
        self._pressed_ns = now_ns
        if one:
            self._asked = (one, now_ns)
            return ChosenRobot("", f"{one} may be meant: press again to take it")
        return ChosenRobot("", _unclear(candidates))

    def step(self, now_ns: int) -> ChosenRobot | None:
        """Return a choice that became clear by pointing on, or None. Identifies at 5 Hz only.

        Staying on a robot that may be meant asks for staying on it for as long again.
        """
        if 0 <= self._next_ns - now_ns <= PERIOD_NS:
            return None
        self._next_ns = now_ns + PERIOD_NS
        chosen = self._identify(now_ns)
        on: str = chosen
        if self._pressed_ns is not None and not 0 <= now_ns - self._pressed_ns <= PENDING_NS:
            self._pressed_ns = None
        if self._take == "dwell" and self.candidates and self.candidates[0].probability >= RATHER:
            on = chosen or self._likely()[1]
        if on != self._on[0]:
            self._on = (on, now_ns)
        if on != self._done:
            self._done = ""
        stayed = self._take == "dwell" and now_ns - self._on[1] >= self._dwell_ns
        if not on or on == self._done or not (stayed or (chosen and self._pressed_ns is not None)):
            return None
        if not chosen and self._asked != self._on:
            self._asked = self._on = (on, now_ns)
            return ChosenRobot("", f"{on} may be meant: stay on it to take it")
        self._pressed_ns = None
        self._done = on
        return ChosenRobot(on, "")

    def _likely(self) -> tuple[list[Candidate], str]:
        """Return the robots that may be meant, and the one that is if any is, `""` if that is unclear."""
        candidates = [each for each in self.candidates if each.probability >= LIKELY]
        is_one = bool(candidates) and candidates[0].probability >= ONE * sum(
            each.probability for each in candidates
        )
        return candidates, candidates[0].object_id if is_one else ""

    def _identify(self, now_ns: int) -> str:
        found = self._identifier.identify(now_ns)
        steps = [(each.object_id, math.floor(each.probability / SHOWN_STEP)) for each in found.candidates]
        rounded = [Candidate(object_id=name, probability=step * SHOWN_STEP) for name, step in steps]
        self.candidates = tuple(each for each in rounded if each.probability > 0.0)
        return found.chosen


def _unclear(candidates: list[Candidate]) -> str:
    names = [each.object_id for each in candidates]
    count = "two" if len(names) == 2 else str(len(names))
    return f"{count} robots may be meant, {all_of(names)}: point longer at one"
