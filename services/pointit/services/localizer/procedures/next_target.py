"""Selection of the lamp after which the pose is most certain (pointing.md §4).

The information of one pointing is its Fisher information about x, y, yaw and the person's elevation bias;
holds add up. The position is that of the pose so far, or any in the room before there is one. The pose's yaw
does not matter, since turning the person turns all rays equally.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.angular_residuals import Array
from pointit.services.localizer.estimation.estimator import SolverSettings

EYES_M = 1.64
"""Eye height above the floor before a ray has given it."""

AROUND_M = 1.5
"""Largest distance of people outside the rectangle of the lamps."""

NEAREST_M = 0.7
"""Smallest horizontal distance of people from a lamp."""

PLACES = 7
"""Number of assumed positions along each side of the room, before a pose is known."""

PARAMETERS = 4
"""x, y, yaw, elevation bias."""

VAGUE_M = 10.0
VAGUE_RAD = math.pi
"""Standard deviations of an unknown pose."""

_SETTINGS = SolverSettings()


@dataclass(frozen=True, kw_only=True)
class ObservationModel:
    """Noise of a hold, which is one pointing, however long: a reach errs until the next one."""

    ray_sigma_rad: float = _SETTINGS.act_sigma_rad
    """Standard deviation of one pointing sideways."""
    elevation_sigma_rad: float = _SETTINGS.elevation_sigma_rad
    """The same upwards."""
    bias_sigma_rad: float = _SETTINGS.bias_sigma_rad
    """Standard deviation of the person's elevation bias."""
    body_sigma_m: float = _SETTINGS.body_sigma_m
    """Standard deviation of the eyes' position, which makes near targets less informative."""
    eyes_m: float = EYES_M
    """Eye height above the floor."""


def fisher_information(targets_m: Array, eyes_m: Array, observation_model: ObservationModel) -> Array:
    """Return the information about (x, y, yaw, bias) of one hold at each target.

    Args:
        targets_m: n x 3, {W}.
        eyes_m: p x 3, {W}: positions of the eyes, not straight above or below a target.
        observation_model: noise of a hold.

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
    sigmas = np.array([observation_model.ray_sigma_rad, observation_model.elevation_sigma_rad])
    variance = sigmas**2 + (observation_model.body_sigma_m / distance[..., None]) ** 2
    gained: Array = np.einsum("pnij,pnik,pni->pnjk", slopes, slopes, 1.0 / variance)
    return gained


def log_det_information(information_of_pose: Array) -> Array:
    """Return -log det of the covariance of (x, y, yaw) with an unknown elevation bias.

    Args:
        information_of_pose: ... x 4 x 4, of (x, y, yaw, bias).
    """
    _, whole = np.linalg.slogdet(information_of_pose)
    return np.asarray(whole - np.log(information_of_pose[..., 3, 3]), dtype=np.float64)


def next_target(
    lamps_m: Sequence[Vec3],
    visits: Sequence[int],
    observation_model: ObservationModel,
    *,
    floor_m: float = 0.0,
    place_m: tuple[float, float] | None = None,
) -> int:
    """Return the index of the lamp to point at next.

    A lamp that was not visited is preferred to one that was; among equals the first.

    Args:
        lamps_m: positions of the lamps, {W}.
        visits: number of holds at each.
        observation_model: noise of a hold.
        floor_m: height of the floor in {W}.
        place_m: x and y of the person. None if unknown: anywhere in the room.
    """
    lamps, counts = np.array(lamps_m, dtype=np.float64), np.array(visits)
    places = _room(lamps) if place_m is None else np.array([place_m])
    eyes = np.column_stack([places, np.full(len(places), floor_m + observation_model.eyes_m)])
    gained = fisher_information(lamps, eyes, observation_model)
    sofar = np.einsum("n,pnij->pij", counts, gained) + prior(observation_model)
    after = sofar[:, None] + gained  # places x lamps
    if not counts.any():  # of the best pair, the more informative one by itself
        pairs = log_det_information(after[:, :, None] + gained[:, None, :]).mean(axis=0)
        np.fill_diagonal(pairs, -np.inf)
        best = np.unravel_index(int(np.argmax(pairs)), pairs.shape) if len(lamps) > 1 else (0, 0)
        alone = log_det_information(after).mean(axis=0)
        return int(max(sorted(int(index) for index in best), key=lambda index: float(alone[index])))
    gains = log_det_information(after).mean(axis=0)
    fewest = counts == counts.min()
    return int(np.argmax(np.where(fewest, gains, -np.inf)))


def prior(observation_model: ObservationModel) -> Array:
    """Return the prior information (4 x 4) about (x, y, yaw, bias)."""
    return np.diag([VAGUE_M**-2, VAGUE_M**-2, VAGUE_RAD**-2, observation_model.bias_sigma_rad**-2])


def _room(lamps: Array) -> Array:
    """Return possible positions of people (p x 2), evenly over the room but not close to a lamp."""
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
    observation_model: ObservationModel,
    *,
    floor_m: float = 0.0,
) -> int:
    """Return the index of the lamp that makes the yaw of a known pose most certain.

    Mostly that is a far one at eye height, since an uncertain position turns it less. After that one, a lamp
    in another direction separates position and yaw.

    Args:
        lamps_m: positions of the lamps, {W}, at least one.
        place_m: x and y of the person.
        covariance: 3 x 3, of x, y, yaw.
        observation_model: noise of a hold.
        floor_m: height of the floor in {W}.
    """
    lamps = np.array(lamps_m, dtype=np.float64)
    eyes = np.array([[*place_m, floor_m + observation_model.eyes_m]])
    gained: Array = fisher_information(lamps, eyes, observation_model)[0][:, :3, :3]
    left = np.linalg.solve(np.eye(3) + covariance @ gained, np.broadcast_to(covariance, gained.shape))
    near: Array = np.linalg.norm(lamps[:, :2] - eyes[0, :2], axis=1)
    return (
        int(np.argmin(np.where(near >= NEAREST_M, left[:, 2, 2], np.inf))) if near.max() >= NEAREST_M else 0
    )
