"""Check that the sensor points along the arm, by the likelihoods of the mountings.

The azimuths alone determine a pose, whatever the elevations, and with it the elevations of the targets. Along
the arm, rays have these and a bias. Across it their pitch is the roll of the arm, about constant, and
backwards they are negative. Each mounting is fitted. Of 900 windows of people with a sensor along the arm,
another one was 20 times likelier in none. `floor_m` is the height of the floor in {W}.
"""

import math
from dataclasses import replace

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import angular_errors
from pointit.services.localizer.estimation.estimator import solve
from pointit.services.localizer.estimation.levenberg_marquardt import evaluate_costs, huber_loss, minimize
from pointit.services.localizer.estimation.refinement import effective_samples
from pointit.services.localizer.estimation.sample_blocks import Pointings, blocks, in_time
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings

ROLL_RAD = math.radians(6.0)
"""Standard deviation of the roll of an arm about its mean."""

CERTAIN = math.log(99.0)
"""Log-likelihood ratio to a sensor along the arm from which another mounting is named."""

DOUBTFUL = 0.0
"""The same from which a pose waits for more pointing."""

FREE_ELEVATION = 10.0
"""Factor on the sigma of elevations that leaves the pose to the azimuths."""

FEWEST = 4.0
"""Independent pointings whose azimuths show that they were meant, even if the rays miss."""

FOLLOWS = 2.0
"""Rms of these azimuths, in sigmas."""


def mounting_fault(
    pointings: Pointings,
    result: Solution | Refusal,
    trust: SolverSettings,
    floor_m: float,
    *,
    is_known: bool = False,
) -> str:
    """Return a message about the sensor's mounting, or `""` if no fault is found.

    A wrong mounting may also be the reason why the rays miss, so refused rays are examined, too, if their
    azimuths follow the targets. If a pose of the mounting was accepted before (`is_known`), nothing waits.
    """
    is_missed = isinstance(result, Refusal) and result.residual_rad is not None
    found = solve(pointings, trust.anyhow(), floor_m=floor_m) if is_missed else result
    if isinstance(found, Refusal):
        return ""
    across, backwards, follows = likelihoods(pointings, found, trust, floor_m)
    likeliest = max(across, backwards)
    if (found is not result and not follows) or likeliest < DOUBTFUL:
        return ""
    if likeliest >= CERTAIN:
        does, how = "do not rise to high ones", "across"
        if backwards > across:
            does, how = "sink to high ones", "backwards on"
        return (
            f"the rays turn with the targets and {does}: the sensor seems to be mounted {how} the arm; "
            "run `pointit person calibrate mounting USER`"
        )
    if found is not result or is_known:
        return ""
    return (
        "the rays hardly rise and sink with the targets; go on with the arm straight, at targets of other "
        "heights, and if this stays run `pointit person calibrate mounting USER`"
    )


def likelihoods(
    pointings: Pointings, found: Solution, trust: SolverSettings, floor_m: float
) -> tuple[float, float, bool]:
    """Return log-likelihood ratios of a sensor across, and backwards; True if the azimuths show pointing."""
    means = blocks(in_time(pointings, found.latency_s))
    noise = trust.noise_model(is_still=means.is_still)
    counts = effective_samples(means, noise.independent_hz)
    rays = trust.rays(means.pointings, np.array([found.x_m, found.y_m, floor_m]))
    weights = replace(trust.weights(), sigma_rad=noise.sigma_rad[:, None])
    start = np.array([0.0, 0.0, found.yaw_rad, found.bias_rad - trust.bias_rad, found.z_m])
    starts = np.array([start, start * [1.0, 1.0, 1.0, 0.0, 1.0]])
    along, backwards = (
        float(evaluate_costs(each, minimize(each, starts, weights).poses[:1], weights, counts)[0])
        for each in (rays, replace(rays, elevations_rad=-rays.elevations_rad))
    )
    free = replace(weights, sigma_rad=weights.sigma_rad * np.array([[1.0], [FREE_ELEVATION]]))
    left = angular_errors(rays, minimize(rays, starts, free).poses[:1])[0][0] / noise.sigma_rad[0]
    rolled = (rays.elevations_rad - np.average(rays.elevations_rad, weights=counts)) / ROLL_RAD
    total = float(counts.sum())
    across = float(counts @ huber_loss(left**2 + rolled**2)) + total * math.log(ROLL_RAD / noise.sigma_rad[1])
    follows = total >= FEWEST and float(counts @ left**2) <= FOLLOWS**2 * total
    return along - across, along - backwards, follows
