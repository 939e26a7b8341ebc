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
from pointit.schemas import Anchor, PointingOffset

Array = NDArray[np.float64]

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
    way = vector.subtract(anchor.target_m, eye)
    ray = vector.rotate_z(anchor.raw_direction, anchor.yaw_rad)
    return OffsetSighting(
        vector.azimuth(ray), vector.elevation(ray), vector.azimuth(way), vector.elevation(way)
    )


def fit(sightings: Sequence[OffsetSighting], fitted_ns: int = 0) -> OffsetFit:
    """Return the person's offset, the heading correction, and the dropped sightings.

    Args:
        sightings: in any number and order.
        fitted_ns: stamp of the fit.
    """
    rays = np.array(
        [[s.azimuth_rad, s.elevation_rad, s.target_azimuth_rad, s.target_elevation_rad] for s in sightings]
    ).reshape(-1, 4)
    off = _wrapped(rays[:, 2:] - rays[:, :2])
    level = np.cos(rays[:, 3])
    accepted, heading = _gate(off, level)
    dropped = tuple(index for index in range(len(rays)) if not accepted[index])
    rays = rays[accepted]
    off = off[accepted]
    level = level[accepted]
    if not len(rays):
        return OffsetFit(offset=None, heading_rad=0.0, heading_sigma_rad=math.pi, dropped=dropped)

    turned = _wrapped(off[:, 0] - heading)
    weight = np.maximum(level * level, 1e-6)
    step = float(weight @ turned / weight.sum())
    heading = float(vector.wrap(heading + step))
    turned = turned - step
    spread = _spread(level * turned, HOLD_AZIMUTH_RAD)
    heading_sigma = min(spread / math.sqrt(float(weight.sum())), math.pi)

    constant, scatter = _pitch(off[:, 1])
    sigma = _sigma(off[:, 1], constant, PERSON_RAD)
    reference = _middle(rays[:, 2])
    azimuth_terms = np.zeros(6)
    elevation_terms = np.array([constant, 0.0, 0.0, 0.0, 0.0, 0.0])
    polynomials = 0
    ranges = ((0.0, 0.0), (0.0, 0.0))
    if len(rays) >= POLYNOMIAL_FROM:
        where = np.stack([_wrapped(rays[:, 0] + heading - reference), rays[:, 1]], axis=1)
        if np.abs(where[:, 0]).max() <= REACH_RAD:
            ranges = (_range(where[:, 0]), _range(where[:, 1]))
            bent = _bent(where, off[:, 1], np.ones(len(rays)), scatter, PERSON_RAD)
            if bent is not None:
                elevation_terms, left = bent
                sigma = _sigma(left, 0.0, 0.0)  # leave-one-out errors include the doubt
                polynomials += 1
            bent = _bent(where, turned, level, spread, HOLD_AZIMUTH_RAD)
            if bent is not None:
                azimuth_terms, _ = bent
                polynomials += 1
    offset = PointingOffset(
        rung="polynomial" if polynomials else "pitch",
        azimuth=_terms(azimuth_terms),
        elevation=_terms(elevation_terms),
        reference_rad=reference,
        azimuth_range_rad=ranges[0],
        elevation_range_rad=ranges[1],
        sigma_rad=sigma,
        anchors=len(rays),
        fitted_ns=fitted_ns,
    )
    return OffsetFit(offset=offset, heading_rad=heading, heading_sigma_rad=heading_sigma, dropped=dropped)


def _gate(off: Array, level: Array) -> tuple[NDArray[np.bool_], float]:
    """Return which sightings are not outliers, and the median azimuth error."""
    accepted = np.abs(off[:, 1]) <= NOT_POINTING_RAD
    if not accepted.any():
        return accepted, 0.0
    between = np.abs(_wrapped(off[:, None, 0] - off[None, accepted, 0]))
    own = np.flatnonzero(accepted)
    heading = float(off[own[np.argmin(between[accepted].sum(axis=1))], 0])  # a median on the circle
    count = int(accepted.sum())
    if count >= 3:
        away = np.stack(
            [level * _wrapped(off[:, 0] - heading), off[:, 1] - np.median(off[accepted, 1])], axis=1
        )
        deviation = 1.4826 * np.median(np.abs(away[accepted]), axis=0)
        sigmas = np.abs(away / np.maximum(deviation, [HOLD_AZIMUTH_RAD, HOLD_RAD])).max(axis=1)
        worst = [index for index in np.argsort(-sigmas) if accepted[index]][: count // 3]
        accepted[[index for index in worst if sigmas[index] > GATE_SIGMAS]] = False
    return accepted, heading


def _pitch(off: Array) -> tuple[float, float]:
    """Return the most probable constant of the elevation, and the scatter about it."""
    scatter = _spread(off - off.mean(), HOLD_RAD)
    sharpness = len(off) / scatter**2 + 1.0 / PERSON_RAD**2
    return float(off.sum() / scatter**2 / sharpness), scatter


def _sigma(off: Array, constant: float, person_rad: float) -> float:
    """Return half of the interval in which the error of a new pointing lies with 95 %.

    The scatter is unknown: each of `SCATTERS_RAD` counts by the likelihood of the anchors.
    """
    count = len(off)
    variance = SCATTERS_RAD**2
    person = person_rad**2
    shrunk = count * person / (count * person + variance)
    score = -count * np.log(SCATTERS_RAD) + 0.5 * np.log(1.0 - shrunk)
    score -= 0.5 * (float(off @ off) - shrunk * count * float(off.mean()) ** 2) / variance
    weights = np.exp(score - score.max())
    weights /= weights.sum()
    away = shrunk * float(off.mean()) - constant
    sigmas = np.sqrt(variance + shrunk * variance / count)

    def beyond(limit: float) -> float:
        inside = ndtr((limit - away) / sigmas) - ndtr((-limit - away) / sigmas)
        return float(weights @ inside) - INSIDE

    return 0.5 * brentq(beyond, 0.0, 10.0 * float(sigmas.max() + np.abs(away).max()), xtol=1e-6)


def _spread(left: Array, believed: float) -> float:
    """Return the sigma of residuals about a mean, combined with the prior `believed`."""
    return math.sqrt((HOLD_COUNT * believed**2 + float(left @ left)) / (HOLD_COUNT + len(left) - 1))


def _bent(
    where: Array, off: Array, weight: Array, sigma: float, constant: float
) -> tuple[Array, Array] | None:
    """Return a polynomial's six terms and the leave-one-out errors of the anchors.

    None if the errors do not fall enough, or if it bends too far beyond the anchors at any stiffness.
    """
    columns = weight[:, None] * _columns(where)
    flat, _ = _ridge(columns[:, :1], weight * off, sigma, np.array([constant]))
    edges = [np.linspace(*_range(where[:, axis]), 7) for axis in (0, 1)]
    grid = _columns(np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2))
    slope = SLOPE
    for _ in range(_HALVINGS):
        left, terms = _ridge(columns, weight * off, sigma, np.array([constant, *[slope] * 5]))
        if float(left @ left) > MAX_ERROR_RATIO * float(flat @ flat):
            return None
        held = _columns(where) @ terms
        middle = held.mean()
        if np.abs(grid @ terms - middle).max() <= max(STRETCH * np.abs(held - middle).max(), BENT_RAD):
            return terms, left
        slope /= 2.0
    return None


def _ridge(columns: Array, off: Array, sigma: float, prior: Array) -> tuple[Array, Array]:
    """Return the leave-one-out errors of the rows, and the terms fitted from all of them."""
    gain = np.linalg.solve(columns.T @ columns + np.diag((sigma / prior) ** 2), columns.T)
    terms = gain @ off
    return (off - columns @ terms) / (1.0 - np.einsum("ij,ji->i", columns, gain)), terms


def _columns(where: Array) -> Array:
    a = where[:, 0]
    e = where[:, 1]
    return np.stack([np.ones_like(a), a, e, a * a, a * e, e * e], axis=1)


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
    return float(vector.wrap(ordered[widest] + gaps[widest] + (math.tau - gaps[widest]) / 2.0))
