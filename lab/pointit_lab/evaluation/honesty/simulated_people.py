"""Simulated people, one a seed, who follow a robot or point at lamps (pointing.md §7).

Each has their own bias, slopes, scatter and body, drawn from the ranges of recorded people. Arms are late by
0.1 to 0.25 s, as those of `user_sim`. That is harder than recordings, whose latencies scatter by 0.05 s.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial

Course = Callable[[Array], Array]
"""Positions (n x 3, {W}, m) of a robot at times (n, s)."""

RATE_HZ = 50.0

REACH_S = 0.7
"""Time of the reach to the robot."""

HANGING_RAD = -1.2
"""Elevation of an arm that rests."""

CORRELATION_S = 0.4
"""Correlation time of the error of an arm that follows."""

SET = "simulated"
LAMPS_SET = "simulated lamps"

FOLLOWED_S = 11.0
"""Duration of following: the longest window of 10 s, and a late report of 0.5 s on either side."""

ELEVATION_SLOPES = (-0.33, 0.10)
AZIMUTH_SLOPES = (0.2, 0.3)
EXAGGERATING = 1.0 / 3.0
"""Range of slopes; share of the people who exaggerate sideways."""

TURNS_RAD = math.radians(45.0)
"""Azimuth from the middle of the lamps at which a person begins to turn the body, which ends exaggeration."""

BODY_SIGMA_M = 0.05
HEIGHT_SIGMA_M = 0.03
"""Standard deviations of the eyes' place over the feet, per axis, and of their height from the stated one."""

SPEED_MPS = 0.8
COURSE_M = (0.6, 1.0)
"""Range of the radius of a course."""
AWAY_M = (2.0, 3.5)
"""Range of the distance of a course's middle."""
RISE_M = 0.4
"""Vertical amplitude of a quadrotor."""
FLIES_M = 1.2

ACT_RAD = (math.radians(3.0), math.radians(6.0))
ACT_UP_RAD = (math.radians(1.0), math.radians(2.5))
"""Ranges of the standard deviation of one pointing at a lamp, sideways and upwards."""

HOLD_S = 2.0
PAUSE_S = 2.0
HOLD_RAYS = 40
HOLD_WANDER_RAD = math.radians(0.3)

WALL_M = 3.0
"""Distance of the wall in front, and of those to the left and to the right, from the middle of the room."""
FRONT_LAMPS = 7
SIDE_LAMPS = 4


@dataclass(frozen=True, kw_only=True)
class SimulatedFollower:
    """One person's place and errors."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Azimuth of {H} in {W}."""
    eyes_m: float
    aim_rad: float
    """Constant error of this pointing, to the left."""
    bias_rad: float
    """The same, upwards."""
    lag_s: float
    """Time by which the arm is behind the robot."""
    wander_rad: float
    """Standard deviation, per axis, of the error that changes."""
    elevation_slope: float = 0.0
    """Elevation of the rays above the robot's, per angle of the robot over the horizon."""
    azimuth_slope: float = 0.0
    """The same sideways, per angle from the middle of the course."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "SimulatedFollower":
        """Return a person within 1 m of the origin (per axis), who faces anywhere."""
        x_m, y_m = rng.uniform(-1.0, 1.0, 2)
        yaw_rad = float(rng.uniform(-math.pi, math.pi))
        aim_deg = float(rng.normal(0.0, 5.0))
        bias_deg = float(rng.normal(-2.8, 2.8))
        lag_s = float(rng.uniform(0.1, 0.25))
        wander_deg = float(rng.uniform(1.0, 3.0))
        return cls(
            x_m=float(x_m),
            y_m=float(y_m),
            yaw_rad=yaw_rad,
            eyes_m=1.64,
            aim_rad=math.radians(aim_deg),
            bias_rad=math.radians(bias_deg),
            lag_s=lag_s,
            wander_rad=math.radians(wander_deg),
        )

    def directions(self, course: Course, times_s: Array, rng: np.random.Generator) -> Array:
        """Return the rays (n x 3, unit, {H}) at the robot of `course` at `times_s`, which rise evenly.

        The first `REACH_S` are the reach from a resting arm. Rays start at (0, 0, `eyes_m`).
        """
        away = course(times_s - self.lag_s) - (self.x_m, self.y_m, self.eyes_m)
        azimuths, elevations = _angles(away)
        # constant errors, and slopes
        azimuths = np.unwrap(azimuths)
        from_middle = azimuths - azimuths.mean()
        azimuths += self.azimuth_slope * from_middle + self.aim_rad
        elevations += self.elevation_slope * elevations + self.bias_rad
        # the reach from a hanging arm, with minimum jerk
        since_start_s = times_s - times_s[0]
        share = np.clip(since_start_s / REACH_S, 0.0, 1.0)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        azimuths += (1.0 - share) * rng.uniform(-math.pi, math.pi)
        elevations = HANGING_RAD + share * (elevations - HANGING_RAD)
        # the wander is an angle on the sphere: azimuths change more when the arm is steep
        wander = self._wander(times_s, rng)
        azimuth_wander = wander[:, 0] / np.cos(elevations)
        azimuths += azimuth_wander - self.yaw_rad
        elevations += wander[:, 1]
        flat = np.cos(elevations)
        x = flat * np.cos(azimuths)
        y = flat * np.sin(azimuths)
        return np.stack([x, y, np.sin(elevations)], axis=1)

    def _wander(self, times_s: Array, rng: np.random.Generator) -> Array:
        """Return errors (n x 2, rad) of an arm that follows: a first-order autoregression."""
        white = rng.standard_normal((len(times_s), 2))
        correlation = 0.0
        if len(times_s) > 1:
            step_s = float(times_s[1] - times_s[0])
            correlation = math.exp(-step_s / CORRELATION_S)
        # the variance stays 1
        innovation = math.sqrt(1.0 - correlation * correlation)
        errors = np.empty_like(white)
        errors[0] = white[0]
        for row in range(1, len(white)):
            previous = errors[row - 1]
            errors[row] = correlation * previous + innovation * white[row]
        return np.asarray(self.wander_rad * errors, dtype=np.float64)


def followers(seeds: Iterable[int]) -> list[FollowRecording]:
    """Return people who follow a robot on a circle or a figure of eight, on the ground or in the air."""
    return [_follower(seed) for seed in seeds]


def rooms(seeds: Iterable[int]) -> list[LocalizationTrial]:
    """Return people who have pointed once at each lamp of a room, in random order."""
    return [_room(seed) for seed in seeds]


def _person(rng: np.random.Generator) -> SimulatedFollower:
    exaggerates = float(rng.random()) < EXAGGERATING
    follower = SimulatedFollower.drawn(rng)
    elevation_slope = float(rng.uniform(*ELEVATION_SLOPES))
    azimuth_slope = 0.0
    if exaggerates:
        azimuth_slope = float(rng.uniform(*AZIMUTH_SLOPES))
    return replace(follower, elevation_slope=elevation_slope, azimuth_slope=azimuth_slope)


def _body(follower: SimulatedFollower, rng: np.random.Generator) -> SimulatedFollower:
    """Return the eyes of `follower`, where they really are."""
    x_m, y_m = rng.normal(0.0, BODY_SIGMA_M, 2).tolist()
    height_m = float(rng.normal(0.0, HEIGHT_SIGMA_M))
    eyes_x_m = follower.x_m + x_m
    eyes_y_m = follower.y_m + y_m
    return replace(follower, x_m=eyes_x_m, y_m=eyes_y_m, eyes_m=follower.eyes_m + height_m)


def _follower(seed: int) -> FollowRecording:
    rng = np.random.default_rng([seed, 1])
    follower = _person(rng)
    end_s = REACH_S + FOLLOWED_S
    step_s = 1.0 / RATE_HZ
    times_s = np.arange(0.0, end_s + 0.5 / RATE_HZ, step_s)
    course = _course(follower, rng)
    directions = _body(follower, rng).directions(course, times_s, rng)

    # without the reach
    counts = times_s >= REACH_S
    times_s = times_s[counts]
    origins_m = _origins(follower, len(times_s))
    stamps_s = times_s - times_s[0]
    pointings = Pointings(stamps_s, origins_m, directions[counts], course(times_s))
    head_m = [follower.x_m, follower.y_m, follower.eyes_m]
    name = f"seed {seed}"
    return FollowRecording(
        set=SET,
        subject=name,
        pointings=pointings,
        heads_m=np.tile(head_m, (len(times_s), 1)),
        eye_height_m=follower.eyes_m,
        yaw_rad=_yaw_rad(follower),
        name=name,
    )


def _angles(away: Array) -> tuple[Array, Array]:
    """Return the azimuths and elevations (n each, rad) of vectors (n x 3)."""
    azimuths = np.arctan2(away[:, 1], away[:, 0])
    level_m = np.hypot(away[:, 0], away[:, 1])
    return azimuths, np.arctan2(away[:, 2], level_m)


def _yaw_rad(follower: SimulatedFollower) -> float:
    """Return the yaw of pointing, which includes the constant error of the azimuth."""
    return math.remainder(follower.yaw_rad - follower.aim_rad, math.tau)


def _origins(follower: SimulatedFollower, count: int) -> Array:
    return np.tile([0.0, 0.0, follower.eyes_m], (count, 1))


def _course(follower: SimulatedFollower, rng: np.random.Generator) -> Course:
    """Return a circle or a figure of eight at `SPEED_MPS` on average."""
    bearing, phase = rng.uniform(-math.pi, math.pi, 2)
    radius_m = float(rng.uniform(*COURSE_M))
    away_m = float(rng.uniform(*AWAY_M))
    is_eight, is_flying = rng.random(2) < 0.5
    middle_x_m = follower.x_m + away_m * math.cos(bearing)
    middle_y_m = follower.y_m + away_m * math.sin(bearing)

    # a figure of eight is longer: its angle advances more slowly
    rate_radps = SPEED_MPS / radius_m
    if is_eight:
        rate_radps /= 1.5

    def positions_m(times_s: Array) -> Array:
        angles = phase + rate_radps * times_s
        across = np.cos(angles)
        if is_eight:
            across = np.sin(2.0 * angles)
        x_m = middle_x_m + radius_m * np.sin(angles)
        y_m = middle_y_m + radius_m * across
        z_m = np.zeros_like(angles)
        if is_flying:
            rise_m = RISE_M * np.sin(1.3 * angles)
            z_m = FLIES_M + rise_m
        return np.stack([x_m, y_m, z_m], axis=1)

    return positions_m


def _room(seed: int) -> LocalizationTrial:
    rng = np.random.default_rng([seed, 2])
    follower = _person(rng)
    eyes = _body(follower, rng)
    lamps_m = rng.permutation(_lamps(rng))
    count = len(lamps_m)

    azimuths, elevations = _lamp_angles(follower, eyes, lamps_m, rng)
    rays = _held_rays(azimuths, elevations, rng)
    within_s = np.arange(HOLD_RAYS) * (HOLD_S / HOLD_RAYS)
    starts_s = np.arange(count) * (HOLD_S + PAUSE_S)
    stamps_s = starts_s[:, None] + within_s
    origins_m = _origins(follower, len(rays))
    targets_m = np.repeat(lamps_m, HOLD_RAYS, axis=0)
    return LocalizationTrial(
        set=LAMPS_SET,
        subject=f"seed {seed}",
        condition=f"{count} targets",
        pointings=Pointings(stamps_s.reshape(-1), origins_m, rays, targets_m),
        eye_height_m=follower.eyes_m,
        x_m=follower.x_m,
        y_m=follower.y_m,
        yaw_rad=_yaw_rad(follower),
    )


def _lamp_angles(
    follower: SimulatedFollower, eyes: SimulatedFollower, lamps_m: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return azimuths and elevations (n each, {H}, rad) of a hold at each lamp, with the person's errors."""
    away = lamps_m - (eyes.x_m, eyes.y_m, eyes.eyes_m)
    azimuths, elevations = _angles(away)  # the room is in front: no wrapping
    count = len(lamps_m)

    # slopes, constant errors, and the scatter of a hold
    from_middle = azimuths - azimuths.mean()
    turns = np.clip(from_middle, -TURNS_RAD, TURNS_RAD)
    azimuths += follower.azimuth_slope * turns
    azimuth_scatter = rng.normal(0.0, rng.uniform(*ACT_RAD), count)
    azimuths += follower.aim_rad - follower.yaw_rad + azimuth_scatter
    elevations += follower.elevation_slope * elevations + follower.bias_rad
    elevations += rng.normal(0.0, rng.uniform(*ACT_UP_RAD), count)
    return azimuths, elevations


def _held_rays(azimuths: Array, elevations: Array, rng: np.random.Generator) -> Array:
    """Return `HOLD_RAYS` rays at each of the angles, which wander."""
    shape = (2, len(azimuths) * HOLD_RAYS)
    azimuth_wander, elevation_wander = rng.normal(0.0, HOLD_WANDER_RAD, shape)
    ray_azimuths = np.repeat(azimuths, HOLD_RAYS) + azimuth_wander
    ray_elevations = np.repeat(elevations, HOLD_RAYS) + elevation_wander
    return vector_rows(ray_azimuths, ray_elevations)


def vector_rows(azimuths: Array, elevations: Array) -> Array:
    """Return unit vectors (n x 3) of azimuths and elevations (n each, rad)."""
    angles = zip(azimuths.tolist(), elevations.tolist(), strict=True)
    directions = [vector.direction(azimuth, elevation) for azimuth, elevation in angles]
    return np.array(directions, dtype=np.float64)


def _lamps(rng: np.random.Generator) -> Array:
    """Return the lamps (n x 3) on three walls, those in front at the same x."""
    side_lamps = 2 * SIDE_LAMPS
    heights_m = rng.uniform(0.0, 2.2, FRONT_LAMPS + side_lamps)
    front_x_m = np.full(FRONT_LAMPS, WALL_M)
    front_y_m = rng.uniform(-2.0, 2.0, FRONT_LAMPS)
    front = np.stack([front_x_m, front_y_m], axis=1)
    side_x_m = rng.uniform(0.0, 2.5, side_lamps)
    side_y_m = np.repeat([WALL_M, -WALL_M], SIDE_LAMPS)
    side = np.stack([side_x_m, side_y_m], axis=1)
    floor_plan = np.concatenate([front, side])
    return np.column_stack([floor_plan, heights_m])
