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
"""Longest time for which a robot is extrapolated beyond its newest report, s."""

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
"""Minimum probability of a robot that is named as one that may be meant."""
ONE = 0.8
"""Share of the likeliest robot in all likely ones from which only a place beside it may be meant instead."""
RATHER = 0.5
"""Minimum probability at which staying asks whether a robot is meant: nothing else says that one is."""
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
        ages_ns = self.times_ns[-1] - self.times_ns
        return np.asarray(ages_ns / NS_PER_S, dtype=np.float64)


def log_likelihoods(
    blocks: RayBlocks, missed: Array, spreads: Array, settings: IdentificationSettings
) -> Array:
    """Return the log likelihoods (k + 1) of the rays if they are at each robot, and at none.

    The person may have begun to point at it within the window. Before, they pointed at nothing in particular.

    Args:
        blocks: n.
        missed: k x 2n, angles to the robots: all sideways ones, then all upwards.
        spreads: k x 2n x 2n, the covariances of their lasting errors.
        settings: errors of people.
    """
    # Errors within a pointing, and directions of an arm at no robot: a constant, and a random walk
    ages = blocks.ages_s
    mean_azimuth = blocks.angles[:, 0].mean()
    centre = np.array([mean_azimuth, DOWNWARDS_RAD])
    no_target = (blocks.angles - centre).T.ravel()
    noise = _of_both_axes(_correlated(ages, settings))
    same_for_all = np.ones((len(ages), len(ages)))
    constant = np.kron(np.diag(NO_TARGET_RAD**2), same_for_all)
    walked = _of_both_axes(np.minimum.outer(ages, ages))
    walk_variances = np.square(settings.walks_rad)[:, None, None]
    roams = constant + walk_variances * walked

    # For each beginning of the pointing: the rays since then at a robot or at none, those before at none
    logs: list[Array] = []
    for began_s, odds in zip(settings.began_s, settings.began_odds, strict=True):
        late = np.flatnonzero(np.tile(ages <= began_s, 2))
        early = np.flatnonzero(np.tile(ages > began_s, 2))
        late_noise = _submatrix(noise, late)
        late_logs: list[float] = []
        for miss, spread in zip(missed, spreads, strict=True):
            late_spread = _submatrix(spread, late)
            late_logs.append(_log_density(miss[late], late_spread, late_noise, settings.scales))
        late_roams = _submatrix(roams, late)
        late_logs.append(_log_density_at_none(no_target[late], late_roams, late_noise, settings))
        early_log = 0.0
        if len(early):
            early_roams = _submatrix(roams, early)
            early_noise = _submatrix(noise, early)
            early_log = _log_density_at_none(no_target[early], early_roams, early_noise, settings)
        logs.append(math.log(odds) + early_log + np.array(late_logs))
    total = np.logaddexp.reduce(np.stack(logs))
    return np.asarray(total, dtype=np.float64)


def _submatrix(matrices: Array, rows: NDArray[np.intp]) -> Array:
    """Return the rows and columns `rows` of a matrix, or of each of several."""
    return np.asarray(matrices[..., rows[:, None], rows], dtype=np.float64)


def _of_both_axes(matrix: Array) -> Array:
    """Return the covariance (2n x 2n) of independent errors on both axes, each of `matrix` (n x n)."""
    return np.asarray(np.kron(np.eye(2), matrix), dtype=np.float64)


def _correlated(ages: Array, settings: IdentificationSettings) -> Array:
    """Return the covariance (n x n) of errors that change within a pointing."""
    apart = np.abs(ages[:, None] - ages)
    correlation = np.exp(-apart / settings.correlation_s)
    return np.asarray(settings.ray_sigma_rad**2 * correlation, dtype=np.float64)


def _log_density_at_none(
    angles: Array, roams: Array, noise: Array, settings: IdentificationSettings
) -> float:
    """Return the log density of `angles` of an arm that stays, or moves at any of the rates."""
    logs = [_log_density(angles, roam, noise, settings.scales) for roam in roams]
    return float(np.logaddexp.reduce(logs)) - math.log(len(logs))


def _log_density(values: Array, spread: Array, noise: Array, scales: Sequence[float]) -> float:
    """Return the log density of `values` with normal errors: `spread`, and `noise` times any of `scales`."""
    covariances = spread + np.square(scales)[:, None, None] * noise
    roots = np.linalg.cholesky(covariances)
    rows = np.broadcast_to(values, (len(roots), len(values)))
    whitened = np.linalg.solve(roots, rows[..., None])[..., 0]
    log_determinants = np.log(np.einsum("kii->ki", roots)).sum(axis=1)
    logs = -0.5 * np.square(whitened).sum(axis=1) - log_determinants
    log_sum = float(np.logaddexp.reduce(logs))
    log_mean = log_sum - math.log(len(scales))
    return log_mean - 0.5 * len(values) * math.log(math.tau)


@dataclass(frozen=True)
class Identification:
    """Probability of each robot, and of none."""

    candidates: tuple[Candidate, ...] = ()
    """Robots, the likeliest first."""
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
        if self._rays:
            newest_ns = self._rays[-1].stamp_ns
            if newest_ns - self._window_ns <= ray.stamp_ns <= newest_ns:
                return
            if ray.stamp_ns <= newest_ns:  # the clock was set back
                self._rays.clear()
        self._rays.append(ray)
        oldest_ns = ray.stamp_ns - self._window_ns
        while self._rays[0].stamp_ns < oldest_ns:
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
        if places:
            newest_ns, _ = places[-1]
            if newest_ns - self._window_ns <= stamp_ns <= newest_ns:
                return
            if stamp_ns <= newest_ns:  # the clock was set back
                places.clear()
        places.append((stamp_ns, position_m))

        # Two stay, whatever their age: they give the velocity
        oldest_ns = stamp_ns - 2 * self._window_ns
        while len(places) > 2 and places[1][0] < oldest_ns:
            places.popleft()
        track.position_sigma_m = position_sigma_m or 0.0

    def forget(self, robot: str) -> None:
        """Remove a robot that has left."""
        self._tracks.pop(robot, None)

    def identify(self, now_ns: int) -> Identification:
        """Return the probabilities at `now_ns`: no robot if there are no recent rays, or no pose."""
        settings = self._settings
        max_age_ns = round(settings.max_age_s * NS_PER_S)
        pose = self._pose
        tracks = self._recent_tracks(now_ns, max_age_ns)
        if not tracks or pose is None:
            return Identification()
        if not self._rays:
            return Identification()
        ray_age_ns = now_ns - self._rays[-1].stamp_ns
        if abs(ray_age_ns) > max_age_ns:
            return Identification()

        # Likelihood of each robot, then of a place beside each, then of none
        blocks = _blocks(self._rays, pose, settings.block_s)
        means: list[Array] = []
        spreads: list[Array] = []
        for beside_m in (0.0, settings.beside_sigma_m):
            for track in tracks.values():
                mean, spread = self._missed(blocks, track, pose, beside_m)
                means.append(mean)
                spreads.append(spread)
        logs = log_likelihoods(blocks, np.stack(means), np.stack(spreads), settings)

        # Posterior, with the prior in the same order
        beside = settings.none_prior * settings.beside_share
        at_robot = 1.0 - settings.none_prior
        shares = np.array([at_robot, beside]) / len(tracks)
        prior_of_robots = np.repeat(shares, len(tracks))
        prior = np.append(prior_of_robots, settings.none_prior - beside)
        odds = prior * np.exp(logs - logs.max())
        odds /= odds.sum()

        # A place beside a robot is none: the person wants one to go there
        candidates: list[Candidate] = []
        for robot, share in zip(tracks, odds, strict=False):
            probability = min(1.0, float(share))
            candidates.append(Candidate(object_id=robot, probability=probability))
        candidates.sort(key=lambda candidate: -candidate.probability)
        odds_of_none = odds[len(tracks) :]
        none = min(1.0, float(odds_of_none.sum()))
        likeliest = candidates[0]
        is_sure = likeliest.probability >= settings.chosen
        return Identification(tuple(candidates), none, likeliest.object_id if is_sure else "")

    def _recent_tracks(self, now_ns: int, max_age_ns: int) -> dict[str, _Track]:
        """Return the robots that have reported within `max_age_ns`."""
        tracks: dict[str, _Track] = {}
        for robot, track in self._tracks.items():
            if not track.places:
                continue
            newest_ns, _ = track.places[-1]
            if abs(now_ns - newest_ns) <= max_age_ns:
                tracks[robot] = track
        return tracks

    def _missed(
        self, blocks: RayBlocks, track: _Track, pose: UserPose, beside_m: float
    ) -> tuple[Array, Array]:
        """Return the angles from the rays to a robot (2n: sideways, upwards), and their lasting errors.

        Those to places beside it if `beside_m`, 1 sigma of their distance from it per axis, is not 0.

        Returns:
            2n; 2n x 2n, the covariance of errors that are common to all rays, rad².
        """
        # Angles from the rays to the robot
        settings = self._settings
        places, velocities = _positions(track, blocks.times_ns)
        offsets = places - blocks.eyes_m
        x = offsets[:, 0]
        y = offsets[:, 1]
        z = offsets[:, 2]
        level = np.maximum(np.hypot(x, y), 1e-3)
        reach = np.hypot(level, z)
        flat = np.maximum(level / reach, MIN_LEVEL)
        azimuths, elevations = blocks.angles.T
        turn = np.arctan2(y, x) - azimuths
        wrapped = np.remainder(turn + math.pi, math.tau) - math.pi
        sideways = wrapped * flat
        upwards = np.arctan2(z, level) - elevations

        # Derivatives of these by place (x, y, z), yaw with aim, elevation, latency
        slope = np.zeros((2, len(level), 6))
        level_2 = level**2
        slope[0, :, 0] = -y / level_2 * flat
        slope[0, :, 1] = x / level_2 * flat
        reach_2 = reach**2
        level_reach_2 = level * reach_2
        slope[1, :, 0] = -z * x / level_reach_2
        slope[1, :, 1] = -z * y / level_reach_2
        slope[1, :, 2] = level / reach_2
        slope[0, :, 3] = flat
        slope[1, :, 4] = 1.0
        slope_by_place = slope[:, :, :3]
        slope[:, :, 5] = np.einsum("knj,nj->kn", slope_by_place, velocities)

        # Errors of the pose, and independent ones of the person, the robot and its tracker
        errors = np.zeros((6, 6))
        pose_rows = np.ix_([0, 1, 3], [0, 1, 3])
        stated = np.array(pose.covariance).reshape(3, 3)
        errors[pose_rows] = _nearest_covariance(stated)
        robot_m2 = track.position_sigma_m**2
        level_m2 = settings.body_sigma_m**2 + robot_m2 + beside_m**2
        height_m2 = settings.height_sigma_m**2 + robot_m2
        lasting = np.square([settings.aim_sigma_rad, settings.bias_sigma_rad, settings.latency_sigma_s])
        independent = [level_m2, level_m2, height_m2, *lasting]
        rows = slope.reshape(-1, 6)
        missed = np.concatenate([sideways, upwards])
        spread = rows @ (errors + np.diag(independent)) @ rows.T
        return missed, np.asarray(spread, dtype=np.float64)


def _nearest_covariance(stated: Array) -> Array:
    """Return the nearest covariance to that of a message, which may be none, within `MAX_VARIANCE`."""
    values, vectors = np.linalg.eigh(0.5 * (stated + stated.T))
    clipped = np.clip(values, 0.0, MAX_VARIANCE)
    return np.asarray((vectors * clipped) @ vectors.T, dtype=np.float64)


def _blocks(rays: Sequence[PointingRay], pose: UserPose, block_s: float) -> RayBlocks:
    """Return the means of `rays` in {W} at `pose`, by blocks of `block_s` that end at the newest."""
    # Index of the first ray of each block, and number of rays
    stamps = np.array([ray.stamp_ns for ray in rays], dtype=np.int64)
    numbers = (stamps[-1] - stamps) // round(block_s * NS_PER_S)
    is_next = np.diff(numbers) != 0
    first = np.flatnonzero(np.append(True, is_next))
    counts = np.diff(np.append(first, len(stamps)))

    # Eyes and directions, turned from {H} into {W}
    all_origins = np.array([ray.origin_m for ray in rays])
    all_directions = np.array([ray.direction for ray in rays])
    origins = np.add.reduceat(all_origins, first) / counts[:, None]
    x, y, z = np.add.reduceat(all_directions, first).T
    cos = math.cos(pose.yaw_rad)
    sin = math.sin(pose.yaw_rad)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    eyes_m = np.array(pose.position_m) + origins @ rotation.T
    azimuths = np.unwrap(np.arctan2(y, x)) + pose.yaw_rad
    elevations = np.arctan2(z, np.hypot(x, y)) - pose.elevation_bias_rad

    # Times since the first ray: a Unix time in ns has more digits than a float
    since_ns = stamps - stamps[0]
    mean_since_ns = np.add.reduceat(since_ns, first) / counts
    times_ns = stamps[0] + np.rint(mean_since_ns).astype(np.int64)
    return RayBlocks(times_ns, eyes_m, np.stack([azimuths, elevations], 1))


def _positions(track: _Track, times_ns: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return positions and velocities (n x 3) at `times_ns`. The robot rests before its first report."""
    base_ns, _ = track.places[0]
    report_ns = [stamp_ns - base_ns for stamp_ns, _ in track.places]
    report_s = np.array(report_ns) / NS_PER_S
    places = np.array([place for _, place in track.places], dtype=np.float64)
    newest_s = report_s[-1] + MAX_AHEAD_S
    times_s = np.minimum((times_ns - base_ns) / NS_PER_S, newest_s)
    if len(report_s) < 2:
        count = len(times_ns)
        return np.repeat(places, count, axis=0), np.zeros((count, 3))
    leg_s = np.maximum(np.diff(report_s), MIN_STEP_S)
    leg_velocities = np.diff(places, axis=0) / leg_s[:, None]
    reports_before = np.searchsorted(report_s, times_s)
    leg = np.clip(reports_before - 1, 0, len(leg_velocities) - 1)
    is_at_rest = times_s < 0.0
    velocities = np.where(is_at_rest[:, None], 0.0, leg_velocities[leg])
    since_s = times_s - report_s[leg]
    positions = places[leg] + since_s[:, None] * velocities
    return positions, velocities


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
        """Robot that another press takes, and the time since which it does, ns."""
        self._pointed = ("", 0)
        """Robot that is pointed at, and the time since which it is, ns."""
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
        self._asked = ("", 0)
        self._pointed = ("", 0)
        self.candidates = ()

    def press(self, now_ns: int) -> ChosenRobot:
        """Return the robot that is pointed at.

        If it is unclear which, pointing on for a while may make it clear. If it is unclear whether one is
        meant at all, or a place near it, another press takes it.
        """
        chosen = self._identify(now_ns)
        asked, asked_ns = self._asked
        self._asked = ("", 0)
        candidates, likely = self._likely()

        # Clear, by pointing or by a second press
        is_in_time = 0 <= now_ns - asked_ns <= PENDING_NS
        if not chosen and likely == asked and is_in_time:
            chosen = asked  # or still `""`, if no robot is likely
        if chosen:
            self._pressed_ns = None
            return ChosenRobot(chosen, "")

        # Unclear: none, one or a place beside it, or several
        if not candidates:
            self._pressed_ns = None
            return ChosenRobot("", "no robot is where you point: point at one, then press")
        self._pressed_ns = now_ns
        if likely:
            self._asked = (likely, now_ns)
            return ChosenRobot("", f"{likely} may be meant: press again to take it")
        return ChosenRobot("", _unclear_message(candidates))

    def step(self, now_ns: int) -> ChosenRobot | None:
        """Return a choice that became clear by pointing on, or None. Identifies at 5 Hz only.

        Staying on a robot that may be meant asks for staying on it for as long again.
        """
        if 0 <= self._next_ns - now_ns <= PERIOD_NS:
            return None
        self._next_ns = now_ns + PERIOD_NS
        chosen = self._identify(now_ns)
        if self._pressed_ns is not None and not 0 <= now_ns - self._pressed_ns <= PENDING_NS:
            self._pressed_ns = None

        # The robot that is pointed at, and the time since which it is
        is_by_dwell = self._take == "dwell"
        robot: str = chosen
        may_be_meant = bool(self.candidates) and self.candidates[0].probability >= RATHER
        if not chosen and is_by_dwell and may_be_meant:
            _candidates, robot = self._likely()
        pointed, _ = self._pointed
        if robot != pointed:
            self._pointed = (robot, now_ns)
        if robot != self._done:
            self._done = ""
        if not robot or robot == self._done:
            return None

        # It is taken after a stay, or if it became clear after a press
        _, since_ns = self._pointed
        has_stayed = is_by_dwell and now_ns - since_ns >= self._dwell_ns
        has_pressed = bool(chosen) and self._pressed_ns is not None
        if not has_stayed and not has_pressed:
            return None
        if not chosen and self._asked != self._pointed:
            self._asked = self._pointed = (robot, now_ns)  # equal, so that another stay takes it
            return ChosenRobot("", f"{robot} may be meant: stay on it to take it")
        self._pressed_ns = None
        self._done = robot
        return ChosenRobot(robot, "")

    def _likely(self) -> tuple[list[Candidate], str]:
        """Return the robots that may be meant, and the one that is if any is, `""` if that is unclear."""
        candidates = [candidate for candidate in self.candidates if candidate.probability >= LIKELY]
        if not candidates:
            return [], ""
        total = sum(candidate.probability for candidate in candidates)
        is_one = candidates[0].probability >= ONE * total
        return candidates, candidates[0].object_id if is_one else ""

    def _identify(self, now_ns: int) -> str:
        """Update the candidates. Return the robot that is meant, or `""` if that is unsure."""
        identification = self._identifier.identify(now_ns)
        candidates: list[Candidate] = []
        for candidate in identification.candidates:
            steps = math.floor(candidate.probability / SHOWN_STEP)
            if steps > 0:
                rounded = Candidate(object_id=candidate.object_id, probability=steps * SHOWN_STEP)
                candidates.append(rounded)
        self.candidates = tuple(candidates)
        return identification.chosen


def _unclear_message(candidates: list[Candidate]) -> str:
    names = [candidate.object_id for candidate in candidates]
    count = "two" if len(names) == 2 else str(len(names))
    return f"{count} robots may be meant, {all_of(names)}: point longer at one"
