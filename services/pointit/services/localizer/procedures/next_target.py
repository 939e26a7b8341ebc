"""Which lamp to point at next: the one after which the pose would be known best (pointing.md §4).

What one pointing tells is its Fisher information about x, y, yaw and the person's elevation bias; holds add
up. Where the person stands is taken from the pose so far, or, before there is one, from everywhere in the
room: the pose's yaw does not matter, since turning the person turns all the rays alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.angular_residuals import Array
from pointit.services.localizer.estimation.estimator import SolverSettings

EYES_M = 1.64
"""Height of the eyes over the floor before a ray has told it."""

AROUND_M = 1.5
"""People stand at most so far outside the rectangle of the lamps."""

NEAREST_M = 0.7
"""Nobody stands nearer to the point below a lamp."""

PLACES = 7
"""Along each side of the room, before a pose is known."""

PARAMETERS = 4
"""x, y, yaw, elevation bias."""

VAGUE_M = 10.0
VAGUE_RAD = math.pi
"""One sigma of a pose that nothing has told yet."""

_TRUST = SolverSettings()


@dataclass(frozen=True, kw_only=True)
class ObservationModel:
    """How well a hold tells where a target is seen."""

    ray_sigma_rad: float = _TRUST.act_sigma_rad
    """One sigma of one pointing sideways."""
    elevation_sigma_rad: float = _TRUST.elevation_sigma_rad
    """The same upwards."""
    bias_sigma_rad: float = _TRUST.bias_sigma_rad
    """One sigma of the person's elevation bias."""
    independent: float = 1.0
    """Independent pointings of one hold: a reach errs until the next one, however long it is held."""
    body_sigma_m: float = _TRUST.body_sigma_m
    """One sigma of where the eyes are: near targets tell less than the angles promise."""
    eyes_m: float = EYES_M
    """Over the floor."""


def fisher_information(targets_m: Array, eyes_m: Array, acuity: ObservationModel) -> Array:
    """Return what one hold at each target tells about (x, y, yaw, bias).

    Args:
        targets_m: n x 3, {W}.
        eyes_m: p x 3, {W}: where the eyes are; not straight above or below a target.
        acuity: how well it tells.

    Returns:
        p x n x 4 x 4, in 1/m², 1/(m·rad), 1/rad².
    """
    reach = targets_m[None, :, :] - eyes_m[:, None, :]
    distance = np.maximum(np.linalg.norm(reach, axis=2), 1e-3)
    level = np.maximum(np.hypot(reach[..., 0], reach[..., 1]), 1e-3)
    east, north = reach[..., 0] / level, reach[..., 1] / level
    cos_el, sin_el = level / distance, reach[..., 2] / distance
    slopes = np.zeros((*distance.shape, 2, 4))
    slopes[..., 0, 0] = north / distance  # sideways
    slopes[..., 0, 1] = -east / distance
    slopes[..., 0, 2] = -cos_el
    slopes[..., 1, 0] = sin_el * east / distance  # upwards
    slopes[..., 1, 1] = sin_el * north / distance
    slopes[..., 1, 3] = 1.0
    sigmas = np.array([acuity.ray_sigma_rad, acuity.elevation_sigma_rad])
    variance = sigmas**2 / acuity.independent + (acuity.body_sigma_m / distance[..., None]) ** 2
    told: Array = np.einsum("pnij,pnik,pni->pnjk", slopes, slopes, 1.0 / variance)
    return told


def log_det_information(information_of_pose: Array) -> Array:
    """Return -log det of the covariance of (x, y, yaw), the elevation bias being unknown too.

    Args:
        information_of_pose: ... x 4 x 4, of (x, y, yaw, bias).
    """
    _, whole = np.linalg.slogdet(information_of_pose)
    return np.asarray(whole - np.log(information_of_pose[..., 3, 3]), dtype=np.float64)


def next_target(
    lamps_m: Sequence[Vec3],
    visits: Sequence[int],
    acuity: ObservationModel,
    *,
    floor_m: float = 0.0,
    place_m: tuple[float, float] | None = None,
) -> int:
    """Return the index of the lamp to point at next.

    A lamp that was not visited is preferred to one that was; among equals the first.

    Args:
        lamps_m: where the lamps are, {W}.
        visits: how often each was pointed at already.
        acuity: how well a hold tells.
        floor_m: height of the floor in {W}.
        place_m: x and y of the person as far as known; none: anywhere in the room.
    """
    lamps, counts = np.array(lamps_m, dtype=np.float64), np.array(visits)
    places = _room(lamps) if place_m is None else np.array([place_m])
    eyes = np.column_stack([places, np.full(len(places), floor_m + acuity.eyes_m)])
    told = fisher_information(lamps, eyes, acuity)
    sofar = np.einsum("n,pnij->pij", counts, told) + prior(acuity)
    after = sofar[:, None] + told  # places x lamps
    if not counts.any():  # of the best pair, the one that tells more by itself
        pairs = log_det_information(after[:, :, None] + told[:, None, :]).mean(axis=0)
        np.fill_diagonal(pairs, -np.inf)
        best = np.unravel_index(int(np.argmax(pairs)), pairs.shape) if len(lamps) > 1 else (0, 0)
        alone = log_det_information(after).mean(axis=0)
        return int(max(sorted(int(index) for index in best), key=lambda index: float(alone[index])))
    worth = log_det_information(after).mean(axis=0)
    fewest = counts == counts.min()
    return int(np.argmax(np.where(fewest, worth, -np.inf)))


def prior(acuity: ObservationModel) -> Array:
    """Return what is known of (x, y, yaw, bias) before any pointing, as information (4 x 4)."""
    return np.diag([VAGUE_M**-2, VAGUE_M**-2, VAGUE_RAD**-2, acuity.bias_sigma_rad**-2])


def _room(lamps: Array) -> Array:
    """Return where people may stand (p x 2): evenly over the room, not right at a lamp."""
    low, high = lamps[:, :2].min(axis=0) - AROUND_M, lamps[:, :2].max(axis=0) + AROUND_M
    east, north = (np.linspace(float(low[axis]), float(high[axis]), PLACES) for axis in (0, 1))
    places: Array = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(places[:, None, :] - lamps[None, :, :2], axis=2).min(axis=1)
    free: Array = places[away >= NEAREST_M]
    return free if len(free) else places


def best_for_yaw(
    lamps_m: Sequence[Vec3],
    place_m: tuple[float, float],
    covariance: Array,
    acuity: ObservationModel,
    *,
    floor_m: float = 0.0,
) -> int:
    """Return the index of the lamp after which the yaw of a known pose is known best.

    Mostly that is a far one at the height of the eyes, for what is uncertain of the place turns it less; but
    when the last one was that, one in another direction tells the place and the yaw apart.

    Args:
        lamps_m: where the lamps are, {W}, at least one.
        place_m: x and y of the person.
        covariance: 3 x 3, of x, y, yaw.
        acuity: how well a hold tells.
        floor_m: height of the floor in {W}.
    """
    lamps = np.array(lamps_m, dtype=np.float64)
    eyes = np.array([[*place_m, floor_m + acuity.eyes_m]])
    told: Array = fisher_information(lamps, eyes, acuity)[0][:, :3, :3]
    left = np.linalg.solve(np.eye(3) + covariance @ told, np.broadcast_to(covariance, told.shape))
    near: Array = np.linalg.norm(lamps[:, :2] - eyes[0, :2], axis=1)
    return (
        int(np.argmin(np.where(near >= NEAREST_M, left[:, 2, 2], np.inf))) if near.max() >= NEAREST_M else 0
    )
