"""Pose of the person from rays in {H} that were pointed at known places in {W} (pointing.md §4).

Maximum a posteriori estimate from angles, of x, y, yaw, the person's elevation bias and, within the
uncertainty of body measures, the eye height, with the feet on the floor. It starts from many poses because
reflected poses are minima, too. The weights are those of the tremor within a hold, one measurement each
0.15 s: an error that lasts a whole hold goes into yaw and bias, and weighing it heavier made positions of
recorded people worse. What else is uncertain follows in `refinement`, and the covariance with it.

A filter lags behind the arm, and averages do not need it.
"""

import math
from dataclasses import replace

import numpy as np

from pointit.geometry.array_types import Array
from pointit.schemas.text import round_beyond
from pointit.services.localizer.estimation.levenberg_marquardt import (
    Rays,
    angular_errors,
    evaluate_costs,
    initial_poses,
    minimize,
)
from pointit.services.localizer.estimation.pointings import Blocks, Pointings, blocks, in_time
from pointit.services.localizer.estimation.solution import (
    LATENCY,
    NoiseModel,
    Refusal,
    Solution,
    SolverSettings,
    effective_samples,
    refine,
)

NEGLIGIBLE = 1e-3
"""Poses less probable than this are left out of the covariance."""

NEAREST_M = 0.4
"""Smallest distance from the eyes to a target of a straight arm."""

TRIMMED = 0.1
"""Share of the samples, the worst, that may be outliers."""

LESS = math.sqrt(1.0 + TRIMMED * math.log(TRIMMED) / (1.0 - TRIMMED))
"""Ratio of the others' rms to that of all, for normal errors on both axes (exponential squares)."""

SAME_PLACE_M = 0.05
"""Targets closer together than this count as one."""

AMBIGUOUS_COST = 2.0
"""Two refined minima whose costs differ by less (a factor e² in likelihood) are ambiguous."""

FARTHEST_TARGET_M = 1000.0
"""Largest distance of a target: pointing at farther ones does not determine a position."""

SAME_VIEW_RAD = math.radians(2.0)
"""Rays within this have one direction."""

NO_COMMON_POINT = "these rays meet nowhere in the world; point at each target, arm straight"

ONE_VIEW = (
    "the arm was held in one direction while there were several targets; "
    "point at each target, arm straight, until it changes"
)

LEVEL_M = 0.1
"""Targets within this of the eye height are seen level."""


def solve(
    pointings: Pointings,
    settings: SolverSettings | None = None,
    *,
    floor_m: float = 0.0,
    start: Solution | None = None,
) -> Solution | Refusal:
    """Return the pose that fits the rays best, or the refusal if there is none.

    Outliers have less weight (Huber) and must not decide either: rays that miss the targets by too much are
    solved once more without the worst tenth of them.

    Args:
        pointings: at least `settings.min_samples`, at two or more places.
        settings: weights and limits.
        floor_m: height in {W} of the floor on which the person stands.
        start: a pose found before, used as an additional start.
    """
    settings = settings if settings is not None else SolverSettings()
    count = len(pointings)
    if count < settings.min_samples:
        return Refusal(
            f"only {count} rays were gathered and {settings.min_samples} are needed; check the IMU"
        )

    # Targets at one place, or above one another, leave the pose open
    targets = pointings.targets_m
    spread_m = np.ptp(targets, axis=0)
    if float(spread_m.max()) < SAME_PLACE_M:
        return Refusal("all pointing was at one place; point at two or more different ones")
    if float(spread_m[:2].max()) < SAME_PLACE_M:
        return Refusal("all targets are above one another, so the direction is open; add one to the side")

    # Minima of the means of blocks, about the centre, which keeps numbers small wherever the origin is
    timely = in_time(pointings, settings.latency_s)
    summary = blocks(timely)
    centre = np.array([*targets[:, :2].mean(axis=0), floor_m])
    rays = settings.rays(summary.pointings, centre)
    weights = settings.weights()
    starts = [initial_poses(rays, weights)]
    if start is not None:
        starts.append(_pose_of(start, centre, settings)[None])
    minima = minimize(rays, np.vstack(starts), weights)
    poses = _out_of_reach(rays, minima)
    if not len(poses):
        return Refusal(NO_COMMON_POINT)
    solution = _solution(rays, summary, poses, settings)

    # Angles by which all samples miss. If they show a latency, with it or without, whichever fits better.
    missed_rad = _missed_rad(settings.rays(timely, centre), poses[0])
    if solution.late_s:
        late_rays = settings.rays(in_time(timely, solution.late_s, summary), centre)
        late_missed_rad = _missed_rad(late_rays, _pose_of(solution, np.zeros(3), settings))
        if float(late_missed_rad @ late_missed_rad) < float(missed_rad @ missed_rad):
            missed_rad = late_missed_rad
    residual_rad = math.sqrt(float(np.mean(missed_rad * missed_rad)))

    # Once more without the worst samples if they miss by too much
    limit_rad = settings.residual_limit_rad(is_still=summary.is_still)
    if residual_rad > limit_rad and settings.trims:
        is_kept = missed_rad <= np.quantile(missed_rad, 1.0 - TRIMMED)
        trimmed = solve(pointings.only(is_kept), settings.trimmed(LESS), floor_m=floor_m, start=start)
        if isinstance(trimmed, Solution):
            return trimmed
    solution = replace(
        solution,
        x_m=float(solution.x_m + centre[0]),
        y_m=float(solution.y_m + centre[1]),
        residual_rad=residual_rad,
        samples=count,
    )
    place_m = (float(poses[0, 0]), float(poses[0, 1]))
    return check_solution(solution, place_m, rays, settings, limit_rad)


def _out_of_reach(rays: Rays, poses: Array) -> Array:
    """Return those of `poses` (k x 5) in which no target is nearer to the eyes than `NEAREST_M`."""
    x, y, yaw, _, height = poses.T[:, :, None]
    origins = rays.origins * np.conj(rays.inverse_azimuth)
    turned_origins = np.exp(1j * yaw) * origins
    places = x + 1j * y
    level = np.abs(rays.targets - places - turned_origins)
    nearest = np.hypot(level, rays.heights - height).min(axis=1)
    return np.asarray(poses[nearest >= NEAREST_M], dtype=np.float64)


def _solution(rays: Rays, summary: Blocks, poses: Array, settings: SolverSettings) -> Solution:
    """Return the likeliest of `poses` about the centre; its covariance includes the alternatives."""
    noise = settings.noise_model(is_still=summary.is_still)
    probabilities = np.ones(1)
    if len(poses) > 1:
        probabilities = _probabilities(rays, summary, poses, settings, noise)
    is_likely = probabilities >= NEGLIGIBLE
    is_likely[0] = True
    refined = [refine(rays, pose, summary, noise) for pose in poses[is_likely]]

    # Covariance of the mixture about the likeliest pose
    best, best_covariance, scatter = refined[0]
    mixed = np.zeros_like(best_covariance)
    for (state, covariance, _), probability in zip(refined, probabilities[is_likely], strict=True):
        offset = state - best
        offset[2] = math.remainder(float(offset[2]), math.tau)
        mixed += probability * (covariance + np.outer(offset, offset))

    # A latency that the rays show is one beyond 2 sigma
    x_m, y_m, yaw_rad, bias_rad, z_m, _, latency_s = best.tolist()
    sigmas = np.sqrt(np.maximum(np.diag(mixed), 0.0)).tolist()
    latency_sigma_s = sigmas[LATENCY]
    late_s = latency_s if abs(latency_s) > 2.0 * latency_sigma_s else 0.0
    return Solution(
        x_m=x_m,
        y_m=y_m,
        yaw_rad=math.remainder(yaw_rad, math.tau),
        bias_rad=settings.bias_rad + bias_rad,
        bias_sigma_rad=sigmas[3],
        covariance=mixed[:3, :3],
        residual_rad=0.0,
        samples=0,
        z_m=z_m,
        z_sigma_m=sigmas[4],
        latency_s=settings.latency_s + latency_s,
        late_s=late_s,
        latency_sigma_s=latency_sigma_s,
        of_latency=mixed[:3, LATENCY],
        alternative=float(1.0 - probabilities[0]),
        scatter=0.0 if summary.is_still else scatter,
    )


def _probabilities(
    rays: Rays, summary: Blocks, poses: Array, settings: SolverSettings, noise: NoiseModel
) -> Array:
    """Return the probability (k) of each of `poses` (k x 5)."""
    sample_weights = effective_samples(summary, noise.independent_hz)
    weights = replace(settings.weights(), sigma_rad=noise.sigma_rad)
    costs = evaluate_costs(rays, poses, weights, sample_weights)
    probabilities: Array = np.exp(costs.min() - costs)
    return np.asarray(probabilities / probabilities.sum(), dtype=np.float64)


def _missed_rad(rays: Rays, pose: Array) -> Array:
    """Return the angles (n) between `rays` and the targets as seen from `pose` (5)."""
    left, above = angular_errors(rays, pose[None])
    size = np.hypot(left, above)  # 2 tan(angle / 2)
    return np.asarray(2.0 * np.arctan(0.5 * size), dtype=np.float64).ravel()


def _pose_of(solution: Solution, centre: Array, settings: SolverSettings) -> Array:
    """Return `solution` as a pose (5) of the descent, about `centre`."""
    x_m = solution.x_m - centre[0]
    y_m = solution.y_m - centre[1]
    bias_rad = solution.bias_rad - settings.bias_rad
    return np.array([x_m, y_m, solution.yaw_rad, bias_rad, solution.z_m])


def check_solution(
    solution: Solution, place_m: tuple[float, float], rays: Rays, settings: SolverSettings, limit_rad: float
) -> Solution | Refusal:
    """Return `solution`, or the refusal if it is not good enough."""
    residual_rad = solution.residual_rad
    distances_m = np.abs(rays.targets - complex(*place_m))
    distance_m = float(np.median(distances_m))
    is_finite = math.isfinite(distance_m + residual_rad)
    is_finite = is_finite and bool(np.isfinite(solution.covariance).all())
    if distance_m > FARTHEST_TARGET_M or not is_finite:
        return Refusal(ONE_VIEW if _is_one_view(rays) else NO_COMMON_POINT)
    if residual_rad > limit_rad:
        return Refusal(_miss_text(residual_rad, rays, limit_rad), residual_rad)
    max_bias_rad = settings.bias_sigma_limit * settings.bias_sigma_rad
    if abs(solution.bias_rad - settings.bias_rad) > max_bias_rad:
        return Refusal(
            f"the rays would lie {math.degrees(solution.bias_rad):+.0f}° too high all the time, which is not "
            "pointing; point at each target, arm straight",
            residual_rad,
        )
    if not settings.accepts(solution):
        return Refusal(_uncertainty_text(solution, rays, settings), residual_rad)
    return solution


def _miss_text(residual_rad: float, rays: Rays, limit_rad: float) -> str:
    if _is_one_view(rays):
        return ONE_VIEW
    limit_deg = math.degrees(limit_rad)
    return (
        f"the rays miss the targets by {round_beyond(math.degrees(residual_rad), limit_deg)}° and at most "
        f"{limit_deg:.3g}° is accepted; point at each target, arm straight"
    )


def _uncertainty_text(solution: Solution, rays: Rays, settings: SolverSettings) -> str:
    stated = _stated_uncertainty(solution, settings)
    if _is_one_view(rays):
        return f"{stated}: the targets lie in one direction; add one far to the side"
    if float(np.max(np.abs(rays.heights))) < LEVEL_M:
        return f"{stated}: all targets are at the height of the eyes; add one below the waist"
    if solution.alternative > 1.0 / (1.0 + math.exp(AMBIGUOUS_COST)):
        return f"{stated}: two places fit the pointing equally well; add a target in another direction"
    if settings.accepts(replace(solution, covariance=solution.timely, of_latency=np.zeros(3))):
        return (
            f"{stated}: the latency of what tracks the target is uncertain by "
            f"{settings.latency_sigma_s:.2f} s; have the tracker state its `latency_sigma_s`, or the target "
            "move slower"
        )
    return f"{stated}; point longer or at one more target, below the waist or far to the side"


def _stated_uncertainty(solution: Solution, settings: SolverSettings) -> str:
    sigma_m = min(solution.position_sigma_m, 99.0)
    sigma_deg = min(math.degrees(solution.yaw_sigma_rad), 180.0)
    if not solution.scatter:
        limit_m = settings.max_position_sigma_m
        limit_deg = math.degrees(settings.max_yaw_sigma_rad)
        place = round_beyond(sigma_m, limit_m, 2)
        yaw = round_beyond(sigma_deg, limit_deg)
        return f"the pose is uncertain by {place} m and {yaw}°, limits {limit_m:.3g} m and {limit_deg:.3g}°"
    stated = f"the pose is uncertain by {sigma_m:.2f} m and {sigma_deg:.1f}°"
    right = 100.0 * solution.right_probability
    needed = 100.0 * settings.min_right_probability
    if right >= needed:
        return f"{stated}, too much of it by the latency"
    percent = round_beyond(right, needed)
    return f"{stated}: pointing would select the right thing in {percent} %, and {needed:.3g} % are needed"


def _is_one_view(rays: Rays) -> bool:
    first = rays.inverse_azimuth[0]
    turns_rad = np.angle(rays.inverse_azimuth * np.conj(first))
    least_level = float(np.min(rays.elevation_phasor.real))
    spread_rad = float(np.ptp(turns_rad)) * least_level
    return spread_rad < SAME_VIEW_RAD and float(np.ptp(rays.elevations_rad)) < SAME_VIEW_RAD
