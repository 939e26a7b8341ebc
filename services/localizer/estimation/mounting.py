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
from pointit.runtime.host.advised_commands import advised_commands
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

MOUNTED = "the rays turn with the {} and {}: the sensor seems to be mounted {} the arm; run {}"
SUSPECTED = (
    "the rays rise and sink only {:.1f} times as much as the robot; keep following it with the arm straight, "
    "and if this stays run {}"
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
        """Return True if the sensor is rather across the arm than along it: more pointing must decide."""
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
    # Rays that miss get the pose that fits them best, however far they miss
    fit = result
    if isinstance(result, Refusal) and result.residual_rad is not None:
        fit = solve(pointings, settings.any_fit(), floor_m=floor_m)
    if isinstance(fit, Refusal):
        return ""
    independent = float(holds) or settings.independent_hz * pointings.span_s
    slope = mounting_slope(pointings, fit, settings, floor_m, independent=independent)
    if slope is None:
        return ""

    # Azimuths that do not fit either show an arm that pointed elsewhere, which says nothing about the sensor
    if fit is not result:
        sigma_rad = settings.act_sigma_rad if holds else settings.ray_sigma_rad
        is_enough = holds >= FEWEST_HOLDS if holds else slope.freedom >= FOLLOWS_FREEDOM
        is_following = slope.sideways_rad <= FOLLOWS * sigma_rad
        if not (is_enough and is_following):
            return ""

    if holds:
        is_wrong = slope.value < MIN_HELD_SLOPE
        is_backwards = slope.value < -MIN_HELD_SLOPE
        target = "lamps"
        sinking = "are low at high ones"
        level = "do not rise to high ones"
    else:
        is_wrong = slope.is_wrong
        is_backwards = slope.value < BACKWARDS_SLOPE
        target = "robot"
        sinking = "sink where it rises"
        level = "do not rise with it"
    calibrate = advised_commands().command("pointit person calibrate mounting USER", "USER")
    if is_wrong and is_backwards:
        return MOUNTED.format(target, sinking, "backwards on", calibrate)
    if is_wrong:
        return MOUNTED.format(target, level, "across", calibrate)

    # Longer following can resolve a doubt. Holds at lamps are all there will be.
    is_doubtful = fit is result and slope.is_doubtful
    if is_doubtful and not holds:
        return SUSPECTED.format(max(slope.value, 0.0), calibrate)
    return ""


def mounting_slope(
    pointings: Pointings, solution: Solution, settings: SolverSettings, floor_m: float, *, independent: float
) -> Slope | None:
    """Return the slope by least squares, or None if the target's elevation hardly changes or is not known."""
    # Pose by the azimuths alone, from the solution
    freedom = independent - FEWEST
    timely = in_time(pointings, settings.latency_s + solution.late_s)
    means = blocks(timely).pointings
    place_m = np.array([solution.x_m, solution.y_m, floor_m])
    rays = settings.rays(means, place_m)
    weights = settings.weights()
    sigma_rad = weights.sigma_rad * np.array([[1.0], [FREE_ELEVATION]])
    weights = replace(weights, sigma_rad=sigma_rad)
    bias_rad = solution.bias_rad - settings.bias_rad
    start = np.array([[0.0, 0.0, solution.yaw_rad, bias_rad, solution.z_m]])
    pose = minimize(rays, start, weights)[0]

    # Elevations of the target from its eyes, about their mean
    x_m, y_m, yaw_rad, _, _ = pose.tolist()
    azimuth_phasor = np.conj(rays.inverse_azimuth)
    turned_origins: Complex = np.exp(1j * yaw_rad) * rays.origins * azimuth_phasor
    eyes = complex(x_m, y_m) + turned_origins
    level = np.abs(rays.targets - eyes)
    expected_rad: Array = np.arctan2(rays.heights - pose[4], level)
    expected_rad -= expected_rad.mean()
    spread_rad = float(np.sqrt(np.mean(expected_rad**2)))
    if spread_rad < MIN_SPREAD_RAD or freedom <= 0.0:
        return None

    # Regression of the measured elevations on these
    measured_rad: Array = rays.elevations_rad - rays.elevations_rad.mean()
    slope = float(np.mean(expected_rad * measured_rad)) / spread_rad**2
    residuals_rad = measured_rad - slope * expected_rad
    scatter_rad = float(np.sqrt(np.mean(residuals_rad**2)))
    sigma = scatter_rad / (spread_rad * math.sqrt(freedom))
    sideways_errors, _ = angular_errors(rays, pose[None])
    sideways_rad = float(np.sqrt(np.mean(sideways_errors**2)))
    return Slope(slope, sigma, freedom, sideways_rad)
