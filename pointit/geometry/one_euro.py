"""The 1 € filter for directions: steady while the hand rests, fast when it moves (pointing.md §2).

After Casiez, Roussel, Vogel: 1 € Filter, CHI 2012, adapted to the sphere: positions are unit vectors, a
difference is the arc between two of them, the speed is the norm of one angular velocity for both axes. So the
filter has no azimuth that could wrap and no pole, and a rotation of all inputs rotates the output.
"""

import math

from pointit.geometry import vector
from pointit.geometry.vector import Vec3

_STILL: Vec3 = (0.0, 0.0, 0.0)

SPEED_CUTOFF_HZ = 1.0
"""Cut-off of the speed itself."""
RISE_HZ_PER_DEGPS = 0.05
"""Increase of the cut-off with speed."""
RISE = math.tau * math.degrees(RISE_HZ_PER_DEGPS)
"""The same of the angular frequency, per rad/s."""
GAP_S = 0.5
"""A longer silence resets the filter, as does a step back in time."""


class OneEuro:
    """Smooths one stream of unit vectors. Stores the last input, the last output and the angular velocity."""

    def __init__(self, *, min_cutoff_hz: float = 0.7) -> None:
        """Create with the cut-off at rest. Lower is steadier and slower."""
        self._min_cutoff = math.tau * min_cutoff_hz
        self.reset()

    def reset(self) -> None:
        """Reset to the initial state: the next direction is returned unchanged."""
        self._at_s: float | None = None
        self._last_input: Vec3 = _STILL
        self._last_output: Vec3 = _STILL
        self._rate: Vec3 = _STILL
        """Low-passed angular velocity, rad/s. A vector, so that alternating noise cancels."""

    def smooth(self, direction: Vec3, at_s: float) -> Vec3:
        """Return the filtered direction at `at_s`, on the arc from the last one to `direction`.

        Args:
            direction: unit vector.
            at_s: time of capture, s, on any clock without jumps.
        """
        passed_s = None if self._at_s is None else at_s - self._at_s
        if passed_s is None or not 0.0 <= passed_s <= GAP_S:
            self._at_s = at_s
            self._last_input = direction
            self._last_output = direction
            self._rate = _STILL
            return direction
        if passed_s == 0.0:  # same time: only the position is updated
            self._last_input = direction
            return self._last_output
        self._at_s = at_s

        # Rotation since the last input. Cross and dot products are written out: this runs for every sample.
        x, y, z = direction
        ax, ay, az = self._last_input
        turn_x = ay * z - az * y
        turn_y = az * x - ax * z
        turn_z = ax * y - ay * x
        sine = math.hypot(turn_x, turn_y, turn_z)
        angle = math.atan2(sine, ax * x + ay * y + az * z)

        # Low-pass of its angular velocity. The weight is 1/(1 + 1/(2π f Δt)), here and below.
        phase = math.tau * SPEED_CUTOFF_HZ * passed_s
        weight = phase / (1.0 + phase)
        angle_per_sine = angle / sine if sine > 0.0 else 0.0
        gain = weight * angle_per_sine / passed_s
        keep = 1.0 - weight
        rate_x, rate_y, rate_z = self._rate
        rate_x = keep * rate_x + gain * turn_x
        rate_y = keep * rate_y + gain * turn_y
        rate_z = keep * rate_z + gain * turn_z
        self._rate = (rate_x, rate_y, rate_z)
        self._last_input = direction

        # The faster the hand, the higher the cut-off
        phase = (self._min_cutoff + RISE * math.hypot(rate_x, rate_y, rate_z)) * passed_s
        self._last_output = smoothed = _between(self._last_output, direction, phase / (1.0 + phase))
        return smoothed


def _between(start: Vec3, end: Vec3, share: float) -> Vec3:
    """Return the unit vector at `share` of the arc, or `end` if the two are opposite."""
    ax, ay, az = start
    bx, by, bz = end
    sine = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    cosine = ax * bx + ay * by + az * bz
    if sine < 1e-9:  # no arc, or not a unique one
        return start if cosine > 0.0 else end
    angle = math.atan2(sine, cosine)
    first = math.sin((1.0 - share) * angle) / sine
    second = math.sin(share * angle) / sine
    x = first * ax + second * bx
    y = first * ay + second * by
    z = first * az + second * bz
    return vector.normalized((x, y, z))
