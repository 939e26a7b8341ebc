"""The direction of a press at a card: the mean of the rays before it, if the arm was still."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import PointingRay

PRESS_RAYS_S = 0.4
"""Time before a press of which the rays are averaged, s."""
MIN_RAYS = 3
MAX_SPREAD_RAD = math.radians(2.5)
"""Rms angle of the rays around their mean from which the arm moves. A hand shakes by 0.4°, and an arm that
turns evenly at 22°/s has it."""
MAX_RAYS = 100


class NoMovementError(RefusedError):
    """No movement of the person arrives. It is over with the next ray."""


class WaitingError(RefusedError):
    """The home does not answer, so that a press has to wait."""


@dataclass(frozen=True)
class PressDirection:
    """Direction of a press, {H}.

    Attributes:
        azimuth_rad: of the mean ray.
        elevation_rad: the same.
        eyes_m: height of the eyes.
        spread_rad: rms angle of the rays around their mean.
    """

    azimuth_rad: float
    elevation_rad: float
    eyes_m: float
    spread_rad: float

    @property
    def mean(self) -> Vec3:
        """Return the unit vector."""
        level = math.cos(self.elevation_rad)
        return (
            level * math.cos(self.azimuth_rad),
            level * math.sin(self.azimuth_rad),
            math.sin(self.elevation_rad),
        )


class PressRays:
    """The newest rays of a person."""

    def __init__(self) -> None:
        """Begin without any."""
        self._rays: deque[tuple[float, PointingRay]] = deque(maxlen=MAX_RAYS)

    def add(self, now_s: float, ray: PointingRay) -> None:
        """Append a ray that was received at `now_s`."""
        self._rays.append((now_s, ray))

    def direction_at(self, now_s: float, user: str) -> PressDirection:
        """Return the direction of a press of `user` at `now_s`.

        Raises:
            NoMovementError: If there are no new rays.
            RefusedError: If the arm moves.
        """
        rays = [ray for received_s, ray in self._rays if now_s - received_s <= PRESS_RAYS_S]
        if len(rays) < MIN_RAYS:
            raise NoMovementError(
                f"no movement of {user} arrives: keep the phone's page open and allow its motion sensors, or "
                "switch the wristband on"
            )
        directions = np.array([ray.direction for ray in rays])
        mean = directions.mean(axis=0)
        mean /= max(float(np.linalg.norm(mean)), 1e-9)
        chords = np.linalg.norm(directions - mean, axis=1)
        spread_rad = float(np.sqrt(np.mean(chords**2)))
        if spread_rad > MAX_SPREAD_RAD:
            raise RefusedError("your arm moved: hold it still on the lamp, then press")
        x, y, z = mean.tolist()
        return PressDirection(
            azimuth_rad=math.atan2(y, x),
            elevation_rad=math.atan2(z, math.hypot(x, y)),
            eyes_m=rays[-1].origin_m[2],
            spread_rad=spread_rad,
        )
