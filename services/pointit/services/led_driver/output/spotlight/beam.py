"""Motion and brightness of the beam that follows a cursor. Pure: calls pass the time."""

import math
from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.spotlight.head import HOME, Angles, Limits, Mounting, moved

DARK: Rgb = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class BeamState:
    """Angles and colour of the fixture at one time."""

    angles: Angles
    color: Rgb
    """Colour of the beam; black if it is dark."""


class Beam:
    """Turns the head towards its target within range and speed."""

    def __init__(self, mounting: Mounting, limits: Limits, dark_beyond_rad: float = math.pi) -> None:
        """Create a dark beam at home.

        Args:
            mounting: pose of the fixture.
            limits: range and speed of its axes.
            dark_beyond_rad: angle between beam and target above which the beam is dark; pi: never.
        """
        self._mounting = mounting
        self._limits = limits
        self._dark_beyond_rad = dark_beyond_rad
        self._angles = HOME
        self._end = HOME
        self._color = DARK
        self._at_s = 0.0
        self.in_reach = True
        """False if the head cannot turn to its target."""

    @property
    def moves(self) -> bool:
        """True if the head has not reached its target."""
        return self._angles != self._end

    def aim(self, point_m: Vec3 | None, color: Rgb, now_s: float) -> None:
        """Turn to `point_m` in {W} from `now_s` on, in `color`. Without a point: stop and be dark."""
        self._advance(now_s)
        end = None if point_m is None else self._mounting.angles(point_m, self._angles, self._limits)
        self.in_reach = point_m is None or end is not None
        self._end = self._angles if end is None else end
        self._color = DARK if end is None else color

    def state(self, now_s: float) -> BeamState:
        """Return angles and colour at `now_s`, which must not be before the last call's."""
        self._advance(now_s)
        beam, wanted = self._mounting.beam(self._angles), self._mounting.beam(self._end)
        is_far = vector.angle_between(beam, wanted) > self._dark_beyond_rad
        return BeamState(self._angles, DARK if is_far else self._color)

    def _advance(self, now_s: float) -> None:
        self._angles = moved(self._angles, self._end, self._limits, max(now_s - self._at_s, 0.0))
        self._at_s = now_s
