"""Pose of a moving head from angles at which its beam met known places. Pure."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import leastsq
from scipy.spatial.transform import Rotation

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.services.led_driver.output.spotlight import Angles, direction

MIN_PLACES = 3
"""Number of places that determine a pose; with three, up to four poses may fit."""
SAME_M = 0.05
"""Two fits whose places are closer than this are the same pose if `SAME_RAD` holds, too."""
SAME_RAD = math.radians(2.0)
"""Their largest turn."""
FITS_RAD = math.radians(0.5)
"""A pose with a mean error up to this, or up to twice that of the best pose, fits as well."""
MAX_CALLS = 1000
"""Calls of the errors after which a fit is given up."""
WRONG_RAD = math.radians(1.0)
"""Mean error above which something is wrong: a place, a range, or the direction of pan."""


@dataclass(frozen=True, slots=True)
class FittedPose:
    """A pose of the fixture, and how well it fits."""

    position_m: Vec3
    """Place where both axes cross, {W}."""
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    """Rotation of the fixture, as in `Mounting.from_degrees`."""
    is_mirrored: bool
    """True if pan turns the other way round than was assumed, which alone explains the angles."""
    error_rad: float
    """Root mean square of the angles between beam and place."""
    is_unique: bool
    """False if another pose fits as well."""


def fit_pose(angles: Sequence[Angles], places_m: Sequence[Vec3]) -> FittedPose:
    """Return the pose in which the beam at each of `angles` best meets its place.

    Args:
        angles: angles of the head, one for each place.
        places_m: at least `MIN_PLACES` in {W}, of which no three may lie on a line with each other.
    """
    # If nothing fits, pan may turn the other way round
    fits = _fits(angles, places_m)
    is_mirrored = False
    if fits[0].error_rad > WRONG_RAD:
        mirrored_angles = [measured.mirrored() for measured in angles]
        mirrored_fits = _fits(mirrored_angles, places_m)
        is_mirrored = mirrored_fits[0].error_rad < fits[0].error_rad / 2.0
        if is_mirrored:
            fits = mirrored_fits

    # The best fit is unique if all that are about as good are the same pose
    best = fits[0]
    limit_rad = max(2.0 * best.error_rad, FITS_RAD)
    is_unique = all(best.is_same(other) for other in fits if other.error_rad <= limit_rad)
    yaw, pitch, roll = best.rotation.as_euler("ZYX", degrees=True)
    x, y, z = best.position_m.tolist()
    return FittedPose(
        position_m=(x, y, z),
        yaw_deg=float(yaw),
        pitch_deg=float(pitch),
        roll_deg=float(roll),
        is_mirrored=is_mirrored,
        error_rad=best.error_rad,
        is_unique=is_unique,
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    """Local minimum of the errors."""

    error_rad: float
    position_m: Array
    rotation: Rotation

    def is_same(self, other: "_Fit") -> bool:
        distance_m = np.linalg.norm(self.position_m - other.position_m)
        difference = self.rotation.inv() * other.rotation
        return bool(distance_m < SAME_M and difference.magnitude() < SAME_RAD)


def _fits(angles: Sequence[Angles], places_m: Sequence[Vec3]) -> list[_Fit]:
    """Return the poses found from all starts, the best one first."""
    beams = np.array([direction(measured) for measured in angles])
    places = np.array(places_m, dtype=np.float64)
    fits = [_refined(start, beams, places) for start in _starts()]
    return sorted(fits, key=lambda fit: fit.error_rad)


def _starts() -> list[Rotation]:
    """Return rotations of which one is near any: standing, hanging and on its side, each turned by 90°."""
    standing = [Rotation.from_euler("z", yaw, degrees=True) for yaw in range(0, 360, 90)]
    hanging = Rotation.from_euler("x", 180.0, degrees=True)
    on_side = [Rotation.from_euler("ZY", (yaw, 90.0), degrees=True) for yaw in range(0, 360, 90)]
    starts = list(standing)
    for lean, turn in itertools.product([hanging, *on_side], standing):
        starts.append(lean * turn)
    return starts


def _refined(start: Rotation, beams: Array, places: Array) -> _Fit:
    """Return the pose that fits best near the rotation `start`."""
    rotated_beams: Array = start.apply(beams)

    def errors(pose: Array) -> Array:
        offsets = places - pose[:3]
        distances = np.linalg.norm(offsets, axis=1, keepdims=True)
        directions = offsets / np.maximum(distances, 1e-9)
        pointed = Rotation.from_rotvec(pose[3:]).apply(rotated_beams)
        return np.asarray((pointed - directions).ravel(), dtype=np.float64)

    position = _position(rotated_beams, places)
    first = np.concatenate([position, np.zeros(3)])
    result = leastsq(errors, first, maxfev=MAX_CALLS, full_output=True)
    pose = np.asarray(result[0], dtype=np.float64)

    # Errors are chords between directions; their angles are what a person can judge
    chord_vectors = errors(pose).reshape(-1, 3)
    chords: Array = np.asarray(np.linalg.norm(chord_vectors, axis=1), dtype=np.float64)
    half_sines = np.minimum(chords / 2.0, 1.0)
    angles_rad = 2.0 * np.arcsin(half_sines)
    mean_square = np.mean(angles_rad**2)
    error_rad = float(np.sqrt(mean_square))
    fitted = Rotation.from_rotvec(pose[3:]) * start
    return _Fit(error_rad, pose[:3], fitted)


def _position(beams: Array, places: Array) -> Array:
    """Return the place from which beams of these directions, {W}, pass `places` most closely."""
    projections = np.eye(3) - beams[:, :, None] * beams[:, None, :]
    matrix = projections.sum(axis=0)
    right_side = np.einsum("nij,nj->i", projections, places)
    solution = np.linalg.lstsq(matrix, right_side, rcond=None)
    return np.asarray(solution[0], dtype=np.float64)
