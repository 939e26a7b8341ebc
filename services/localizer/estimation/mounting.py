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

from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.estimator import solve
from pointit.services.localizer.estimation.levenberg_marquardt import Complex, angular_errors, minimize
from pointit.services.localizer.estimation.pointings import Pointings, blocks, in_time
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings

MIN_SLOPE = 0.5
"""Halfway between a sensor along the arm and one across: the least of recorded people is 0.57 in 5 s."""

MIN_HELD_SLOPE = 0.25
"""The same of pointing at lamps: people exaggerate heights less than they understate them."""

BACKWARDS_SLOPE = -0.5
"""Halfway between a sensor across the arm and one backwards."""

FEWEST_HOLDS = 4
"""Pointings at lamps whose azimuths show that they were meant, even if the rays miss."""

MIN_SPREAD_RAD = math.radians(0.8)
"""Smallest standard deviation of the target's elevation that gives a slope."""

MAX_SUSPICION_SIGMA = 0.25
"""Largest standard deviation of a slope that is doubted."""

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
SUSPECTED = (
    "the rays rise and sink only {:.1f} times as much as the robot; keep following it with the arm straight, "
    "and if this stays run `pointit person calibrate mounting USER`"
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

    @property
    def is_doubtful(self) -> bool:
        """Return True if the sensor is rather across the arm than along it: more pointing must tell."""
        return self.value < MIN_SLOPE and self.sigma < MAX_SUSPICION_SIGMA


def mounting_fault(
    pointings: Pointings,
    result: Solution | Refusal,
    settings: SolverSettings,
    floor_m: float,
    *,
    holds: int = 0,
) -> str:
    """Return a message about the mounting of the sensor, or `""` if no fault is found.

    A wrong mounting may also be the reason why the rays miss, so refused rays are examined, too, if their
    azimuths fit the targets. `holds`: number of targets at rest; 0 of a moving one.
    """
    fit = result
    if isinstance(result, Refusal) and result.residual_rad is not None:
        fit = solve(pointings, settings.any_fit(), floor_m=floor_m)
    if isinstance(fit, Refusal):
        return ""
    independent = float(holds) or settings.independent_hz * pointings.span_s
    slope = mounting_slope(pointings, fit, settings, floor_m, independent=independent)
    if slope is None:
        return ""
    sigma_rad = settings.act_sigma_rad if holds else settings.ray_sigma_rad
    is_enough = holds >= FEWEST_HOLDS if holds else slope.freedom >= FOLLOWS_FREEDOM
    if fit is not result and not (is_enough and slope.sideways_rad <= FOLLOWS * sigma_rad):
        return ""
    if holds:
        is_wrong = slope.value < MIN_HELD_SLOPE
        is_back = slope.value < -MIN_HELD_SLOPE
        target = "lamps"
        back = "are low at high ones"
        across = "do not rise to high ones"
    else:
        is_wrong = slope.is_wrong
        is_back = slope.value < BACKWARDS_SLOPE
        target = "robot"
        back = "sink where it rises"
        across = "do not rise with it"
    if is_wrong:
        return MOUNTED.format(target, *((back, "backwards on") if is_back else (across, "across")))
    is_doubtful = not holds and fit is result and slope.is_doubtful
    return SUSPECTED.format(max(slope.value, 0.0)) if is_doubtful else ""


def mounting_slope(
    pointings: Pointings, solution: Solution, settings: SolverSettings, floor_m: float, *, independent: float
) -> Slope | None:
    """Return the slope by least squares, or None if the target's elevation hardly changes or is not known."""
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
