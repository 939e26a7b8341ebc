"""Timed frame of rigid bodies by their names, as every motion capture system gives it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3

MAX_POSITION_M = 1000.0
"""Limit of a coordinate, m. Unseen bodies may have NaN or 1e20."""
ARRIVAL_SIGMA_S = 0.02
"""1 sigma of the time of exposure if the server states no times of a known clock, s."""


class BodySample(NamedTuple):
    """A rigid body in a frame."""

    id: int
    position_m: Vec3
    orientation_xyzw: Quaternion
    error_m: float
    """Mean distance of the markers from the model, m."""
    is_tracked: bool
    measured: int | None
    """Number of its markers that cameras saw, or None if the frame does not tell."""


@dataclass(frozen=True)
class TimedFrame:
    """The named bodies of one frame, and the time of its exposure."""

    stamp_ns: int
    sigma_s: float
    """1 sigma of `stamp_ns`, s."""
    bodies: tuple[tuple[str, BodySample], ...]
    up: str = "y"
    """Axis of the stream that points up, `y` or `z`, unless the configuration states another."""


def body_sample(
    number: int,
    position_m: Sequence[float],
    orientation_xyzw: Sequence[float],
    error_m: float,
    *,
    is_tracked: bool = True,
) -> BodySample:
    """Return a body; one whose values are not finite, too large or no rotation is not tracked."""
    (x, y, z), length = position_m, math.hypot(*orientation_xyzw)
    if not (all(abs(each) < MAX_POSITION_M for each in (x, y, z)) and 0.9 < length < 1.1):
        return BodySample(number, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.0, is_tracked=False, measured=None)
    qx, qy, qz, qw = (each / length for each in orientation_xyzw)
    error_m = error_m if math.isfinite(error_m) else 0.0
    return BodySample(number, (x, y, z), (qx, qy, qz, qw), error_m, is_tracked, measured=None)
