"""Reference for closed forms and trees: the miss of every one of many points."""

import math

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.cloud_tree import CloudMeasure
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

STEP_M, LENGTH_M = 0.05, 8.0
"""Spacing of `samples`."""


def misses(points: Array, origin: Vec3, direction: Vec3, measure: CloudMeasure) -> Array:
    """Return the miss of every point; `samples` by distances to all points of the ray."""
    reach = points - np.array(origin)
    d = np.array(direction)
    along: Array = reach @ d
    across: Array = np.linalg.norm(np.cross(d, reach), axis=1)
    if measure == "angle":
        angles: Array = np.arctan2(across, along)
        return angles
    if measure == "metres":
        distances: Array = np.hypot(across, np.minimum(along, 0.0))
        return distances
    count = math.ceil(LENGTH_M / STEP_M)
    on_ray = np.linspace(0.0, LENGTH_M, count + 1)[:, None] * d
    return np.asarray(np.min([np.linalg.norm(reach - place, axis=1) for place in on_ray], axis=0))
