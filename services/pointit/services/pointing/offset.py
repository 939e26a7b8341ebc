"""Fits a person's offset from pointings at known places without a cursor, rung by rung of a ladder.

Pitch first: a constant of the elevation, maximum a posteriori under what is known of people. Then yaw, which
cannot be told from the heading of the pose and goes there. Then, once there are enough anchors and it pays
by leave-one-out, a ridge polynomial of total degree 2 in azimuth and elevation, each axis by itself.

One bad hold must not spoil it: an outlier gate drops those that no pointing person makes, and those far from
the median of the others, at most a third.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.schemas import Anchor, PointingOffset

Array = NDArray[np.float64]

PERSON_RAD = math.radians(4.0)
"""How far people's elevations are off, 1 sigma about zero.

Between people it is 2.8° about a mean of 2.8° (pointing.md §3); but the sign of the mean depends on
the posture and on what is seen of the hand, so it counts as scatter.
"""
HOLD_RAD = math.radians(1.0)
"""Scatter of one person's elevation from pointing to pointing."""
HOLD_AZIMUTH_RAD = math.radians(4.0)
"""The same of the azimuth, times the cosine of the elevation."""
HOLD_COUNT = 4.0
"""The two scatters are believed as if they had been seen in so many pointings."""

NOT_POINTING_RAD = math.radians(25.0)
"""Nobody who points is so far off in elevation."""
GATE_SIGMAS = 3.0

POLYNOMIAL_FROM = 8
"""Anchors a polynomial needs."""
SLOPE = 0.1
"""1 sigma of its coefficients but the constant: rad per rad, and per rad²."""
WORTH = 0.9
"""It must leave less than this share of the squared errors that the constant leaves."""
REACH_RAD = math.radians(90.0)
"""Anchors further than this from their middle azimuth are all around, where a polynomial has a seam."""
STRETCH = 2.0
BENT_RAD = math.radians(5.0)
"""In the corners of the anchors' ranges it must bend no further than so many times what it does at the
anchors, or this; beyond the ranges it is held."""
_HALVINGS = 6


@dataclass(frozen=True, slots=True)
class Sighting:
    """One pointing at a known place: the raw ray and the way from the ray's origin to the place, in {W}."""

    azimuth_rad: float
    elevation_rad: float
    target_azimuth_rad: float
    target_elevation_rad: float


@dataclass(frozen=True, kw_only=True)
class OffsetFit:
    """What sightings tell."""

    offset: PointingOffset | None
    """None where no sighting was of use."""
    heading_rad: float
    """To add to the pose's yaw: the mean of the azimuth that the rays were off; not part of the offset."""
    heading_sigma_rad: float
    dropped: tuple[int, ...]
    """Indices of the sightings that were no pointing at their target, or far from the others."""


def sighting(anchor: Anchor) -> Sighting | None:
    """Return what an anchor's message tells, or none where it names no place."""
    if anchor.target_m is None:
        return None
    eye = vector.add(anchor.position_m, vector.rotate_z(anchor.origin_m, anchor.yaw_rad))
    way = vector.subtract(anchor.target_m, eye)
    ray = vector.rotate_z(anchor.raw_direction, anchor.yaw_rad)
    return Sighting(vector.azimuth(ray), vector.elevation(ray), vector.azimuth(way), vector.elevation(way))


def fit(
    sightings: Sequence[Sighting],
    fitted_ns: int = 0,
    *,
    highest: Literal["pitch", "polynomial"] = "polynomial",
) -> OffsetFit:
    """Return the person's offset, the heading's, and which sightings were dropped.

    Args:
        sightings: in any number and order.
        fitted_ns: the time it is said to be fitted at.
        highest: rung that may be climbed to.
    """
    rays = np.array(
        [[s.azimuth_rad, s.elevation_rad, s.target_azimuth_rad, s.target_elevation_rad] for s in sightings]
    ).reshape(-1, 4)
    off = _wrapped(rays[:, 2:] - rays[:, :2])
    level = np.cos(rays[:, 3])
    kept, heading = _gate(off, level)
    dropped = tuple(index for index in range(len(rays)) if not kept[index])
    rays, off, level = rays[kept], off[kept], level[kept]
    if not len(rays):
        return OffsetFit(offset=None, heading_rad=0.0, heading_sigma_rad=math.pi, dropped=dropped)

    turned = _wrapped(off[:, 0] - heading)
    weight = np.maximum(level * level, 1e-6)
    step = float(weight @ turned / weight.sum())
    heading = float(vector.wrap(heading + step))
    turned = turned - step
    spread = _spread(level * turned, HOLD_AZIMUTH_RAD)
    heading_sigma = min(spread / math.sqrt(float(weight.sum())), math.pi)

    constant, scatter, doubt = _pitch(off[:, 1])
    reference = _middle(rays[:, 2])
    azimuth_terms, elevation_terms = np.zeros(6), np.array([constant, 0.0, 0.0, 0.0, 0.0, 0.0])
    polynomials, ranges = 0, ((0.0, 0.0), (0.0, 0.0))
    if len(rays) >= POLYNOMIAL_FROM and highest == "polynomial":
        where = np.stack([_wrapped(rays[:, 0] + heading - reference), rays[:, 1]], axis=1)
        if np.abs(where[:, 0]).max() <= REACH_RAD:
            ranges = (_range(where[:, 0]), _range(where[:, 1]))
            bent = _bent(where, off[:, 1], np.ones(len(rays)), scatter, PERSON_RAD)
            if bent is not None:
                elevation_terms, left = bent
                scatter, doubt = _spread(left, HOLD_RAD), 0.0  # left out in turn: it has the doubt in it
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
        sigma_rad=math.hypot(scatter, doubt) * _unsure(len(rays)),
        anchors=len(rays),
        fitted_ns=fitted_ns,
    )
    return OffsetFit(offset=offset, heading_rad=heading, heading_sigma_rad=heading_sigma, dropped=dropped)


def _gate(off: Array, level: Array) -> tuple[NDArray[np.bool_], float]:
    """Return which are pointings like the others, and the azimuth that most of them are off."""
    kept = np.abs(off[:, 1]) <= NOT_POINTING_RAD
    if not kept.any():
        return kept, 0.0
    between = np.abs(_wrapped(off[:, None, 0] - off[None, kept, 0]))
    own = np.flatnonzero(kept)
    heading = float(off[own[np.argmin(between[kept].sum(axis=1))], 0])  # a median on the circle
    count = int(kept.sum())
    if count >= 3:
        away = np.stack([level * _wrapped(off[:, 0] - heading), off[:, 1] - np.median(off[kept, 1])], axis=1)
        deviation = 1.4826 * np.median(np.abs(away[kept]), axis=0)
        sigmas = np.abs(away / np.maximum(deviation, [HOLD_AZIMUTH_RAD, HOLD_RAD])).max(axis=1)
        worst = [index for index in np.argsort(-sigmas) if kept[index]][: count // 3]
        kept[[index for index in worst if sigmas[index] > GATE_SIGMAS]] = False
    return kept, heading


def _pitch(off: Array) -> tuple[float, float, float]:
    """Return the most probable constant of the elevation, the scatter about it, and its own sigma."""
    scatter = _spread(off - off.mean(), HOLD_RAD)
    sharpness = len(off) / scatter**2 + 1.0 / PERSON_RAD**2
    return float(off.sum() / scatter**2 / sharpness), scatter, 1.0 / math.sqrt(sharpness)


def _spread(left: Array, believed: float) -> float:
    """Return the sigma of what is left about a mean, mixed with what is believed of people."""
    return math.sqrt((HOLD_COUNT * believed**2 + float(left @ left)) / (HOLD_COUNT + len(left) - 1))


def _unsure(count: int) -> float:
    """Return by how much a sigma is larger because the scatter itself was only estimated (Student)."""
    freedom = HOLD_COUNT + count - 1
    return math.sqrt(freedom / (freedom - 2.0))


def _bent(
    where: Array, off: Array, weight: Array, sigma: float, constant: float
) -> tuple[Array, Array] | None:
    """Return a polynomial's six terms and the errors it leaves each anchor when that is left out.

    None where it does not pay, or would bend wildly beyond the anchors however stiff it is made.

    Args:
        where: n x 2, azimuth from the reference and elevation, rad.
        off: n errors, rad.
        weight: n, by which an error counts.
        sigma: of one error.
        constant: 1 sigma of the polynomial's constant before anything is known.
    """
    columns = weight[:, None] * _columns(where)
    flat, _ = _ridge(columns[:, :1], weight * off, sigma, np.array([constant]))
    edges = [np.linspace(*_range(where[:, axis]), 7) for axis in (0, 1)]
    grid = _columns(np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2))
    slope = SLOPE
    for _ in range(_HALVINGS):
        left, terms = _ridge(columns, weight * off, sigma, np.array([constant, *[slope] * 5]))
        if float(left @ left) > WORTH * float(flat @ flat):
            return None
        held = _columns(where) @ terms
        middle = held.mean()
        if np.abs(grid @ terms - middle).max() <= max(STRETCH * np.abs(held - middle).max(), BENT_RAD):
            return terms, left
        slope /= 2.0
    return None


def _ridge(columns: Array, off: Array, sigma: float, prior: Array) -> tuple[Array, Array]:
    """Return the errors left when each row in turn is left out, and the terms fitted from all of them."""
    gain = np.linalg.solve(columns.T @ columns + np.diag((sigma / prior) ** 2), columns.T)
    terms = gain @ off
    return (off - columns @ terms) / (1.0 - np.einsum("ij,ji->i", columns, gain)), terms


def _columns(where: Array) -> Array:
    a, e = where[:, 0], where[:, 1]
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
