"""Rays from recorded arms, by the model of the service `pointing`."""

from collections.abc import Iterable, Sequence

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.array_types import Array
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures
from pointit.services.pointing.pointer import ArmRay

STATURE_M = 1.835
"""Stature of the default body measures, from which others are scaled."""


def scaled_body(stature_m: float) -> BodyMeasures:
    """Return the default body measures, scaled to a person `stature_m` tall."""
    factor = stature_m / STATURE_M
    measures = BodyMeasures().model_dump()
    for name in measures:
        measures[name] *= factor
    return BodyMeasures.model_validate(measures)


def eye_height_m(body: BodyMeasures) -> float:
    """Return the height of the eyes."""
    return body.footprint_to_neck_m + body.neck_to_eyes_m


def eye_finger_rays(orientations: Iterable[Quaternion], body: BodyMeasures) -> tuple[Array, Array]:
    """Return origins and directions (n x 3 each, {H}) of straight arms, whose x axes point to the finger."""
    quaternions = np.array(list(orientations), dtype=np.float64)
    # reshaped, since no orientation at all makes an array of shape (0,)
    origins, directions = ArmRay(body).rays(quaternions.reshape(-1, 4))
    if np.isnan(directions).any():
        raise ValueError("a finger at the eyes points nowhere")
    return origins, directions


def along(direction: Sequence[float]) -> Quaternion:
    """Return the orientation of an arm that points in `direction`, without roll."""
    x, y, z = direction
    arm: Vec3 = (float(x), float(y), float(z))
    azimuth_rad = vector.azimuth(arm)
    elevation_rad = vector.elevation(arm)
    return rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)
