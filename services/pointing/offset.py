"""Fit of a person's offset from pointings at known places without a cursor, with models of rising order.

Pitch first: a constant of the elevation, maximum a posteriori with a prior of people. Then yaw, which cannot
be separated from the heading of the pose and is added to it. Then, with enough anchors and if leave-one-out
errors fall, a ridge polynomial of total degree 2 in azimuth and elevation, for each axis.

An outlier gate drops sightings that are no pointing, and those far from the median of the others, at most a
third, so that a bad hold does no harm.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.schemas import Anchor, PointingOffset

PERSON_RAD = math.radians(4.0)
"""Standard deviation of people's elevation errors about zero.

Between people it is 2.8° about a mean of 2.8° (pointing.md §3). But the sign of the mean depends on the
posture and on the visibility of the hand, so it counts as scatter."""
HOLD_RAD = math.radians(1.0)
"""Scatter of one person's elevation between pointings."""
SCATTERS_RAD = np.radians(np.linspace(0.5, 6.0, 12))
"""Such scatters, all equally probable, for the sigma that is stated: 0.3 to 1.1° of people who see their
hand, 2.2 to 5.0° of people who see nothing (`vr_eyefinger`)."""
HOLD_AZIMUTH_RAD = math.radians(4.0)
"""Scatter of the azimuth, times the cosine of the elevation."""
HOLD_COUNT = 4.0
"""Weight of the two prior scatters, in pointings."""

INSIDE = 0.9545
"""Probability of a normal error within two sigma."""

NOT_POINTING_RAD = math.radians(25.0)
"""Elevation errors beyond this are no pointing."""
GATE_SIGMAS = 3.0

POLYNOMIAL_FROM = 8
"""Number of anchors that a polynomial needs."""
SLOPE = 0.1
"""Prior standard deviation of its coefficients except the constant: rad per rad, and rad per rad²."""
MAX_ERROR_RATIO = 0.9
"""Largest share of the constant's squared errors that a polynomial may leave."""
REACH_RAD = math.radians(90.0)
"""Anchors further than this from their middle azimuth surround the person, where a polynomial has a seam."""
STRETCH = 2.0
BENT_RAD = math.radians(5.0)
"""In the corners of the anchors' ranges a polynomial may bend by this multiple of its values at the anchors,
or by `BENT_RAD`; beyond the ranges it is constant."""
_HALVINGS = 6


@dataclass(frozen=True, slots=True)
class OffsetSighting:
    """One pointing at a known place: the raw ray and the direction from its origin to the place, in {W}."""

    azimuth_rad: float
    elevation_rad: float
    target_azimuth_rad: float
    target_elevation_rad: float


@dataclass(frozen=True, kw_only=True)
class OffsetFit:
    """Result of a fit."""

    offset: PointingOffset | None
    """None if no sighting was usable."""
    heading_rad: float
    """Correction of the pose's yaw: the mean azimuth error of the rays; not part of the offset."""
    heading_sigma_rad: float
    dropped: tuple[int, ...]
    """Indices of the outliers among the sightings."""


def sighting(anchor: Anchor) -> OffsetSighting | None:
    """Return the sighting of an anchor, or None if it has no position."""
    if anchor.target_m is None:
        return None
    eye = vector.add(anchor.position_m, vector.rotate_z(anchor.origin_m, anchor.yaw_rad))
    to_target = vector.subtract(anchor.target_m, eye)
    ray = vector.rotate_z(anchor.raw_direction, anchor.yaw_rad)
    return OffsetSighting(
        azimuth_rad=vector.azimuth(ray),
        elevation_rad=vector.elevation(ray),
        target_azimuth_rad=vector.azimuth(to_target),
        target_elevation_rad=vector.elevation(to_target),
    )


def fit(sightings: Sequence[OffsetSighting], fitted_ns: int = 0) -> OffsetFit:
    """Return the person's offset, the heading correction, and the dropped sightings.

    Args:
        sightings: in any number and order.
        fitted_ns: stamp of the fit.
    """
    angles = [
        (s.azimuth_rad, s.elevation_rad, s.target_azimuth_rad, s.target_elevation_rad) for s in sightings
    ]
    rays = np.array(angles).reshape(-1, 4)
    measured = rays[:, :2]
    expected = rays[:, 2:]
    errors = _wrapped(expected - measured)
    cos_elevation = np.cos(rays[:, 3])

    # outliers first: all that follows is a mean of what is left
    accepted, heading = _gate(errors, cos_elevation)
    dropped = tuple(index for index in range(len(rays)) if not accepted[index])
    rays = rays[accepted]
    errors = errors[accepted]
    elevation_errors = errors[:, 1]
    cos_elevation = cos_elevation[accepted]
    if not len(rays):
        return OffsetFit(offset=None, heading_rad=0.0, heading_sigma_rad=math.pi, dropped=dropped)

    # heading: the median of the gate becomes a mean; an azimuth counts less the steeper the arm is
    azimuth_residuals = _wrapped(errors[:, 0] - heading)
    weights = np.maximum(cos_elevation * cos_elevation, 1e-6)
    step = float(weights @ azimuth_residuals / weights.sum())
    heading = float(vector.wrap(heading + step))
    azimuth_residuals = azimuth_residuals - step
    azimuth_scatter = _scatter(cos_elevation * azimuth_residuals, HOLD_AZIMUTH_RAD)
    weight_sum = float(weights.sum())
    heading_sigma = min(azimuth_scatter / math.sqrt(weight_sum), math.pi)

    # pitch: a constant of the elevation
    constant, elevation_scatter = _pitch(elevation_errors)
    sigma = _sigma(elevation_errors, constant, PERSON_RAD)
    reference = _middle(rays[:, 2])
    azimuth_terms = np.zeros(6)
    elevation_terms = np.array([constant, 0.0, 0.0, 0.0, 0.0, 0.0])
    azimuth_range = (0.0, 0.0)
    elevation_range = (0.0, 0.0)

    # a polynomial for each axis for which it pays, if the anchors do not surround the person
    azimuths = _wrapped(rays[:, 0] + heading - reference)
    polynomials = 0
    if len(rays) >= POLYNOMIAL_FROM and np.abs(azimuths).max() <= REACH_RAD:
        directions = np.stack([azimuths, rays[:, 1]], axis=1)
        azimuth_range = _range(directions[:, 0])
        elevation_range = _range(directions[:, 1])
        fitted = _polynomial(directions, elevation_errors, np.ones(len(rays)), elevation_scatter, PERSON_RAD)
        if fitted is not None:
            elevation_terms, left_out_errors = fitted
            sigma = _sigma(left_out_errors, 0.0, 0.0)  # leave-one-out errors include the doubt
            polynomials += 1
        fitted = _polynomial(directions, azimuth_residuals, cos_elevation, azimuth_scatter, HOLD_AZIMUTH_RAD)
        if fitted is not None:
            azimuth_terms, _ = fitted
            polynomials += 1

    offset = PointingOffset(
        rung="polynomial" if polynomials else "pitch",
        azimuth=_terms(azimuth_terms),
        elevation=_terms(elevation_terms),
        reference_rad=reference,
        azimuth_range_rad=azimuth_range,
        elevation_range_rad=elevation_range,
        sigma_rad=sigma,
        anchors=len(rays),
        fitted_ns=fitted_ns,
    )
    return OffsetFit(offset=offset, heading_rad=heading, heading_sigma_rad=heading_sigma, dropped=dropped)


def _gate(errors: Array, cos_elevation: Array) -> tuple[NDArray[np.bool_], float]:
    """Return which sightings are not outliers, and the median azimuth error.

    `errors`: n x 2, azimuth and elevation, rad. `cos_elevation`: n.
    """
    azimuth_errors = errors[:, 0]
    elevation_errors = errors[:, 1]
    accepted = np.abs(elevation_errors) <= NOT_POINTING_RAD
    if not accepted.any():
        return accepted, 0.0

    # a median on the circle: the accepted error with the smallest sum of distances to the others
    differences = azimuth_errors[:, None] - azimuth_errors[None, accepted]
    distances = np.abs(_wrapped(differences))
    candidates = np.flatnonzero(accepted)
    central = candidates[np.argmin(distances[accepted].sum(axis=1))]
    heading = float(azimuth_errors[central])
    count = int(accepted.sum())
    if count < 3:
        return accepted, heading

    # distances from the medians, in robust standard deviations (1.4826 times the median absolute deviation)
    azimuth_deviations = cos_elevation * _wrapped(azimuth_errors - heading)
    elevation_deviations = elevation_errors - np.median(elevation_errors[accepted])
    deviations = np.stack([azimuth_deviations, elevation_deviations], axis=1)
    robust_sigma = 1.4826 * np.median(np.abs(deviations[accepted]), axis=0)
    robust_sigma = np.maximum(robust_sigma, [HOLD_AZIMUTH_RAD, HOLD_RAD])
    sigmas = np.abs(deviations / robust_sigma).max(axis=1)

    # at most a third is dropped, so that a bad hold does no harm and most of them cannot outvote the rest
    by_distance = [index for index in np.argsort(-sigmas) if accepted[index]]
    outliers = [index for index in by_distance[: count // 3] if sigmas[index] > GATE_SIGMAS]
    accepted[outliers] = False
    return accepted, heading


def _pitch(errors: Array) -> tuple[float, float]:
    """Return the most probable constant of the elevation, and the scatter about it."""
    scatter = _scatter(errors - errors.mean(), HOLD_RAD)
    precision = len(errors) / scatter**2 + 1.0 / PERSON_RAD**2
    constant = errors.sum() / scatter**2 / precision
    return float(constant), scatter


def _sigma(errors: Array, constant: float, person_rad: float) -> float:
    """Return half of the interval in which the error of a new pointing lies with 95 %.

    The scatter is unknown: each of `SCATTERS_RAD` counts by the likelihood of the anchors.
    """
    count = len(errors)
    mean = float(errors.mean())
    variance = SCATTERS_RAD**2
    person_variance = person_rad**2

    # posterior weight of each scatter; the person's constant is integrated out
    shrinkage = count * person_variance / (count * person_variance + variance)
    unexplained = float(errors @ errors) - shrinkage * count * mean**2
    log_likelihood = -count * np.log(SCATTERS_RAD)
    log_likelihood += 0.5 * np.log(1.0 - shrinkage)
    log_likelihood -= 0.5 * unexplained / variance
    weights = np.exp(log_likelihood - log_likelihood.max())
    weights /= weights.sum()

    # the error of a new pointing is a mixture of normal distributions, one for each scatter
    means = shrinkage * mean - constant
    sigmas = np.sqrt(variance + shrinkage * variance / count)

    def excess(limit: float) -> float:
        below = ndtr((-limit - means) / sigmas)
        inside = ndtr((limit - means) / sigmas) - below
        return float(weights @ inside) - INSIDE

    largest = sigmas.max() + np.abs(means).max()
    upper_limit = 10.0 * float(largest)
    return 0.5 * brentq(excess, 0.0, upper_limit, xtol=1e-6)


def _scatter(residuals: Array, prior: float) -> float:
    """Return the sigma of residuals about a mean, combined with the `prior` sigma."""
    squares = HOLD_COUNT * prior**2 + float(residuals @ residuals)
    return math.sqrt(squares / (HOLD_COUNT + len(residuals) - 1))


def _polynomial(
    directions: Array, errors: Array, weights: Array, sigma: float, constant_prior: float
) -> tuple[Array, Array] | None:
    """Return a polynomial's six terms and the leave-one-out errors of the anchors.

    None if the errors do not fall enough, or if it bends too far beyond the anchors at any stiffness.

    Args:
        directions: azimuth and elevation of each anchor, n x 2, rad.
        errors: n, rad.
        weights: n, of the errors.
        sigma: scatter of the weighted errors, rad.
        constant_prior: prior standard deviation of the constant term, rad.
    """
    columns = weights[:, None] * _columns(directions)
    weighted_errors = weights * errors
    constant_only = columns[:, :1]
    constant_errors, _ = _ridge(constant_only, weighted_errors, sigma, np.array([constant_prior]))
    max_squares = MAX_ERROR_RATIO * float(constant_errors @ constant_errors)
    azimuths, elevations = directions.T
    azimuth_steps = np.linspace(*_range(azimuths), 7)
    elevation_steps = np.linspace(*_range(elevations), 7)
    corners = np.stack(np.meshgrid(azimuth_steps, elevation_steps), axis=-1)
    grid = _columns(corners.reshape(-1, 2))

    # a stiffer polynomial bends less: the prior of its slopes is halved until its corners stay close
    slope = SLOPE
    for _ in range(_HALVINGS):
        prior = np.array([constant_prior, *[slope] * 5])
        left_out_errors, terms = _ridge(columns, weighted_errors, sigma, prior)
        if float(left_out_errors @ left_out_errors) > max_squares:
            return None
        at_anchors = _columns(directions) @ terms
        middle = at_anchors.mean()
        bend = np.abs(at_anchors - middle).max()
        max_bend = max(STRETCH * bend, BENT_RAD)
        if np.abs(grid @ terms - middle).max() <= max_bend:
            return terms, left_out_errors
        slope /= 2.0
    return None


def _ridge(columns: Array, errors: Array, sigma: float, prior: Array) -> tuple[Array, Array]:
    """Return the leave-one-out errors of the rows, and the terms fitted from all of them.

    `prior`: standard deviation of each term. The errors follow from the hat matrix without another fit.
    """
    penalty = np.diag((sigma / prior) ** 2)
    gain = np.linalg.solve(columns.T @ columns + penalty, columns.T)
    terms = gain @ errors
    leverage = np.einsum("ij,ji->i", columns, gain)
    return (errors - columns @ terms) / (1.0 - leverage), terms


def _columns(directions: Array) -> Array:
    """Return the columns 1, a, e, a², ae, e² of a polynomial of total degree 2."""
    a, e = directions.T
    one = np.ones_like(a)
    return np.stack([one, a, e, a * a, a * e, e * e], axis=1)


def _terms(values: Array) -> tuple[float, float, float, float, float, float]:
    c, a, e, aa, ae, ee = (float(value) for value in values)
    return (c, a, e, aa, ae, ee)


def _range(angles: Array) -> tuple[float, float]:
    return float(angles.min()), float(angles.max())


def _wrapped(angles: Array) -> Array:
    return math.pi - (math.pi - angles) % math.tau


def _middle(angles: Array) -> float:
    """Return the middle of the shortest arc that holds all `angles`."""
    ordered = np.sort(angles % math.tau)
    gaps = np.diff(ordered, append=ordered[0] + math.tau)
    widest = int(np.argmax(gaps))
    gap = gaps[widest]
    start = ordered[widest] + gap
    return float(vector.wrap(start + (math.tau - gap) / 2.0))
