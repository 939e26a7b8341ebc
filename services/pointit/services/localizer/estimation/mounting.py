"""Check that the sensor points along the arm: rays of one across or backwards do not rise with the target.

The azimuths alone determine a pose, whatever the elevations: a sensor that is turned on the arm by a constant
angle only shifts them. From that pose the target's elevation is known. The slope of the measured elevation
over it is 1 for a sensor along the arm, about 0 for one across (its pitch is the roll of the arm) and -1 for
one backwards. Recorded people have slopes of 0.5 to 2.4 in 8 s and more, with a sensor across -0.6 to 0.5,
backwards -1 to -0.6. A target at a constant elevation gives no slope. People who point at four lamps or more
have slopes of 0.3 to 1.2, with a sensor across -0.2 to 0.2, backwards -1.1 to -0.2. `floor_m` is the height
of the floor in {W}.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import Array, Complex, angular_errors
from pointit.services.localizer.estimation.estimator import solve
from pointit.services.localizer.estimation.levenberg_marquardt import minimize
from pointit.services.localizer.estimation.sample_blocks import Pointings, blocks, in_time
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings

MIN_SLOPE = 0.5
"""Halfway between a sensor along the arm and one across."""

MIN_HELD_SLOPE = 0.25
"""The same of pointing at lamps: people exaggerate heights less than they understate them."""

BACKWARDS_SLOPE = -0.5
"""Halfway between a sensor across the arm and one backwards."""

FEWEST_HOLDS = 4
"""Pointings at lamps whose azimuths show that they were meant, even if the rays miss."""

MIN_SPREAD_RAD = math.radians(0.8)
"""Smallest standard deviation of the target's elevation that gives a slope."""

LARGEST_SIGMA = 0.25
"""Largest standard deviation of a slope that is reported as doubtful."""

FEWEST = 2.0
"""Independent pointings that the estimates of pose and slope use up."""

FREE_ELEVATION = 10.0
"""Factor on the sigma of elevations that leaves the pose to the azimuths."""

FOLLOWS_FREEDOM = 4.0
"""Independent pointings beyond `FEWEST` before azimuths show that the arm follows the robot."""

FOLLOWS = 2.0
"""Rms of the azimuths up to which the arm follows the robot, in sigmas of a ray."""

MOUNTED = (
    "the rays turn with the {} and {}: the sensor seems to be mounted {} the arm; "
    "run `pointit person calibrate mounting USER`"
)


@dataclass(frozen=True)
class Slope:
    """Slope of the measured elevation over that of the target."""

    value: float
    sigma: float
    freedom: float
    """Independent pointings beyond `FEWEST`."""

    sideways_rad: float
    """Rms of the azimuth residuals of the pose."""

    @property
    def is_wrong(self) -> bool:
        """Return True if the sensor is certainly not along the arm; few pointings need a wider margin."""
        return self.value + (1.0 + 6.0 / self.freedom) * self.sigma < MIN_SLOPE

    def follows(self, settings: SolverSettings) -> bool:
        """Return True if the azimuths alone show that the arm follows the robot."""
        return self.freedom >= FOLLOWS_FREEDOM and self.sideways_rad <= FOLLOWS * settings.ray_sigma_rad

    @property
    def is_doubtful(self) -> bool:
        """Return True if the sensor is rather across the arm than along it."""
        return self.value < MIN_SLOPE and self.sigma < LARGEST_SIGMA


def mounting_fault(
    pointings: Pointings, result: Solution | Refusal, settings: SolverSettings, floor_m: float
) -> str:
    """Return a message about the sensor's mounting, or `""` if no fault is found.

    A wrong mounting may also be the reason why the rays miss, so refused rays are examined, too, if their
    azimuths follow the robot.
    """
    fit = _best_fit(pointings, result, settings, floor_m)
    if isinstance(fit, Refusal):
        return ""
    independent = settings.independent_hz * pointings.span_s
    slope = mounting_slope(pointings, fit, settings, floor_m, independent=independent)
    if slope is None or (fit is not result and not slope.follows(settings)):
        return ""
    if slope.is_wrong:
        is_back = slope.value < BACKWARDS_SLOPE
        does, how = ("sink where it rises", "backwards on") if is_back else ("do not rise with it", "across")
        return MOUNTED.format("robot", does, how)
    if fit is result and slope.is_doubtful:
        return (
            f"the rays rise and sink only {max(slope.value, 0.0):.1f} times as much as the robot; keep "
            "following it with the arm straight, and if this stays run `pointit person calibrate "
            "mounting USER`"
        )
    return ""


def held_mounting_fault(
    pointings: Pointings, result: Solution | Refusal, settings: SolverSettings, floor_m: float, *, holds: int
) -> str:
    """Return a message about the mounting of a sensor with which lamps were pointed at, or `""`."""
    fit = _best_fit(pointings, result, settings, floor_m)
    if isinstance(fit, Refusal):
        return ""
    slope = mounting_slope(pointings, fit, settings, floor_m, independent=float(holds))
    if slope is None or slope.value >= MIN_HELD_SLOPE:
        return ""
    are_meant = holds >= FEWEST_HOLDS and slope.sideways_rad <= FOLLOWS * settings.act_sigma_rad
    if fit is not result and not are_meant:
        return ""
    is_back = slope.value < -MIN_HELD_SLOPE
    does, how = (
        ("are low at high ones", "backwards on") if is_back else ("do not rise to high ones", "across")
    )
    return MOUNTED.format("lamps", does, how)


def _best_fit(
    pointings: Pointings, result: Solution | Refusal, settings: SolverSettings, floor_m: float
) -> Solution | Refusal:
    """Return `result`, or the pose that was refused because the rays miss or it is uncertain."""
    if isinstance(result, Solution) or result.residual_rad is None:
        return result
    unlimited = replace(
        settings.unlimited(),
        max_residual_rad=math.inf,
        max_act_residual_rad=math.inf,
        bias_sigma_limit=math.inf,
    )
    return solve(pointings, unlimited, floor_m=floor_m)


def mounting_slope(
    pointings: Pointings, solution: Solution, settings: SolverSettings, floor_m: float, *, independent: float
) -> Slope | None:
    """Return the slope by least squares, or None if the target's elevation hardly changes or is not known."""
    if not len(pointings):
        return None
    freedom = independent - FEWEST
    means = blocks(in_time(pointings, settings.latency_s + solution.late_s)).pointings
    place_m = np.array([solution.x_m, solution.y_m, floor_m])
    rays = settings.rays(means, place_m)
    weights = settings.weights()
    weights = replace(weights, sigma_rad=weights.sigma_rad * np.array([[1.0], [FREE_ELEVATION]]))
    start = np.array([[0.0, 0.0, solution.yaw_rad, solution.bias_rad - settings.bias_rad, solution.z_m]])
    pose = minimize(rays, start, weights)[0]
    turned: Complex = np.exp(1j * float(pose[2])) * rays.origins * np.conj(rays.inverse_azimuth)
    eyes = complex(float(pose[0]), float(pose[1])) + turned
    seen: Array = np.arctan2(rays.heights - pose[4], np.abs(rays.targets - eyes))
    seen -= seen.mean()
    spread_rad = float(np.sqrt(np.mean(seen**2)))
    if spread_rad < MIN_SPREAD_RAD or freedom <= 0.0:
        return None
    measured: Array = rays.elevations_rad - rays.elevations_rad.mean()
    value = float(np.mean(seen * measured)) / spread_rad**2
    scatter_rad = float(np.sqrt(np.mean((measured - value * seen) ** 2)))
    left, _ = angular_errors(rays, pose[None])
    return Slope(
        value, scatter_rad / (spread_rad * math.sqrt(freedom)), freedom, float(np.sqrt(np.mean(left**2)))
    )
