"""Velocity of an AGV on its map, from the velocities that it states and the places where it was."""

import math
from typing import NamedTuple

from pointit.vda5050.agv_messages import Visualization

SHORTEST_S = 0.02
"""Shortest time from which a velocity is computed, s."""
SAME_M = 0.01
"""Distance below which two places are the same, m."""
MOVED_M = 0.2
"""Distance from which an AGV has moved although it stated that it stands, m."""


class LastPose(NamedTuple):
    """An AGV as it was seen before."""

    place: tuple[float, float]
    """On its map, m."""
    velocity: tuple[float, float]
    """On its map, m/s."""
    age_s: float


def velocity_on_map(message: Visualization, last: LastPose | None) -> tuple[float, float]:
    """Return the velocity on the map, m/s, towards where the AGV has gone since `last`.

    AGVs state its direction in their own frame, as the standard wants, or in that of the map, and some state
    no velocity at all.
    """
    position, velocity = message.agv_position, message.velocity
    forward_mps = velocity.vx if velocity else None
    if position is None or (forward_mps is None and last is None):
        return (0.0, 0.0)
    gone = (position.x - last.place[0], position.y - last.place[1]) if last else (0.0, 0.0)
    gone_m = math.hypot(*gone)
    if velocity is None or forward_mps is None:
        if last is not None and last.age_s < SHORTEST_S:
            return last.velocity
        speed_mps = gone_m / last.age_s if last else 0.0
    else:
        speed_mps = math.hypot(forward_mps, velocity.vy)
    if gone_m > SAME_M:
        return (speed_mps * gone[0] / gone_m, speed_mps * gone[1] / gone_m)
    if velocity is None or forward_mps is None or position.theta is None:
        return (0.0, 0.0)
    azimuth_rad = position.theta + math.atan2(velocity.vy, forward_mps)
    return (speed_mps * math.cos(azimuth_rad), speed_mps * math.sin(azimuth_rad))


class MapVelocity:
    """Velocity of one AGV. Some AGVs state 0 in place of a velocity that they do not know."""

    def __init__(self) -> None:
        self._zero_place: tuple[float, float] | None = None
        """Its place when it began to state the velocity 0, or None if the last one was another."""
        self._is_stated = True
        """False if it has moved since then."""

    def update(self, message: Visualization, last: LastPose | None) -> tuple[float, float]:
        """Return the velocity on the map, m/s, by `velocity_on_map`."""
        position, velocity = message.agv_position, message.velocity
        if last is None or (velocity and (velocity.vx or velocity.vy)):
            self._zero_place, self._is_stated = None, True
        if position is not None and velocity is not None and velocity.vx == velocity.vy == 0.0:
            place = (position.x, position.y)
            self._zero_place = self._zero_place or place
            self._is_stated = self._is_stated and math.dist(place, self._zero_place) <= MOVED_M
            if not self._is_stated:
                message = message.model_copy(update={"velocity": None})
        return velocity_on_map(message, last)
