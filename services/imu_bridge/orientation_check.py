"""Whether the orientations of a sensor come from a hand: one place for a device and for a phone's page.

A hand trembles. Values that would show it, but stay equal, come from a table or a sensor that gives none.
"""

import math

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion

Values = tuple[float, ...]

FROZEN_S = 5.0
"""Time with one and the same orientation after which a device may have frozen, s. On people's arms it was at
most 0.2 s, and 1.2 s with radio loss (recordings of 7 people). Raw values are never the same for long."""
FINE = 1e-3
"""Smallest step of a quaternion's number seen from a device that shows the tremor of any arm. One with two
decimals is not judged."""
RAW = 6
"""Number of values of a raw reading."""
MIN_TILT_RAD = 0.2
"""Turn of a phone since its azimuth stands still, rad, from which an arm would have turned aside, too."""
AZIMUTH_STEP_RAD = 1e-3
"""Change of an azimuth that is one, rad. Browsers round angles to 0.1°."""
MIN_LEVEL = 0.2
"""Least level part of an axis that has an azimuth."""


class FrozenCheck:
    """Time for which a sensor has sent the same values."""

    def __init__(self, *, is_fine: bool = False) -> None:
        """Begin. `is_fine`: the sensor is known to show the tremor of any arm, which others show first."""
        self._is_fine = is_fine
        self.restart()
        self._is_step_wanted = True

    def restart(self) -> None:
        """Begin again, as after a new connection."""
        self._values: Values = ()
        self._begin_s = math.inf
        self._last_s = -math.inf
        self._finest = math.inf

    def on_values(self, values: Values, now_s: float) -> None:
        """Note values."""
        self._last_s = now_s
        if values == self._values:
            return
        if self._is_step_wanted and len(values) == len(self._values):
            self._is_step_wanted = False
            changes = [abs(new - old) for new, old in zip(values, self._values, strict=True)]
            self._finest = min(self._finest, max(changes))
        self._values = values
        self._begin_s = now_s

    def on_report(self) -> None:
        """Measure the next step, one for each report."""
        self._is_step_wanted = True

    @property
    def frozen_s(self) -> float:
        """Return the time with the same values, s, or 0 if that says nothing or is short."""
        same_s = self._last_s - self._begin_s
        shows_tremor = self._is_fine or self._finest < FINE or len(self._values) == RAW
        return same_s if shows_tremor and same_s > FROZEN_S else 0.0


class AzimuthCheck:
    """Whether a phone's azimuth stands still while the phone turns, as without gyroscope and compass.

    The azimuth is that of the axis to its top, from which the browser's angle `alpha` is counted (W3C,
    Device Orientation and Motion).
    """

    def __init__(self) -> None:
        """Begin without an orientation."""
        self._azimuth_rad = math.nan
        self._begin: Quaternion = rotation.IDENTITY
        self._begin_s = math.inf
        self._turn_rad = 0.0
        self._last_s = -math.inf

    def on_orientation(self, orientation: Quaternion, now_s: float) -> None:
        """Note an orientation, world_from_phone."""
        self._last_s = now_s
        top = rotation.rotate(orientation, (0.0, 1.0, 0.0))
        if math.hypot(top[0], top[1]) < MIN_LEVEL:
            return
        azimuth_rad = vector.azimuth(top)
        step_rad = abs(vector.wrap(azimuth_rad - self._azimuth_rad))
        # Turned over its top or bottom, the azimuth is the opposite one
        has_turned = not min(step_rad, abs(math.pi - step_rad)) < AZIMUTH_STEP_RAD  # also if there was none
        if has_turned:
            self._azimuth_rad = azimuth_rad
            self._begin = orientation
            self._begin_s = now_s
            self._turn_rad = 0.0
            return
        self._turn_rad = max(self._turn_rad, rotation.angle_between(self._begin, orientation))

    @property
    def still_s(self) -> float:
        """Return the time for which the azimuth stands still though the phone turns, s, or 0."""
        still_s = self._last_s - self._begin_s
        return still_s if still_s > FROZEN_S and self._turn_rad > MIN_TILT_RAD else 0.0
