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
    (x, y, z), (qx, qy, qz, qw) = position_m, orientation_xyzw
    length, limit_m = math.hypot(qx, qy, qz, qw), MAX_POSITION_M
    if not (
        -limit_m < x < limit_m and -limit_m < y < limit_m and -limit_m < z < limit_m and 0.9 < length < 1.1
    ):
        return BodySample(number, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.0, is_tracked=False, measured=None)
    turn = (qx / length, qy / length, qz / length, qw / length)
    error_m = error_m if math.isfinite(error_m) else 0.0
    return BodySample(number, (x, y, z), turn, error_m, is_tracked, measured=None)
