"""Geometry of a moving head: angles at which its beam meets a point, their motion, turning by keys. Pure.

The fixture's frame {F} has its origin where both axes cross, and z along the pan axis from the base to the
head. At pan 0 and tilt 0, the middles of both ranges, the beam leaves along z. Tilt turns it about y, and pan
then about z.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3

POLE_RAD = 1e-6
"""Angle to the pan axis below which any pan will do."""
NEAREST_M = 1e-3
"""Distance from the fixture below which a point has no direction."""
LARGEST_STEP_RAD, SMALLEST_STEP_RAD = math.radians(16.0), math.radians(0.0625)
FIRST_STEP_RAD = math.radians(4.0)
KEY = re.compile(rb"\x1b[\[O]([ABCD])|([-+=]|[ \r\n])")
"""An arrow as terminals send it, or another key in use."""
ARROWS = {b"A": (0, 1), b"B": (0, -1), b"C": (1, 0), b"D": (-1, 0)}
"""Steps of pan and tilt by up, down, right, left."""


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles of both axes from the middle of their range, rad."""

    pan_rad: float
    tilt_rad: float

    def mirrored(self) -> "Angles":
        """Return the angles of a head whose pan turns the other way round."""
        return Angles(-self.pan_rad, self.tilt_rad)


HOME = Angles(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class HeadLimits:
    """Range and speed of both axes."""

    pan_range_rad: float
    """Whole range, symmetric about 0."""
    tilt_range_rad: float
    pan_speed_radps: float
    tilt_speed_radps: float

    def allow(self, angles: Angles) -> bool:
        """Return True if the head can turn to `angles`."""
        return (
            abs(angles.pan_rad) <= self.pan_range_rad / 2.0
            and abs(angles.tilt_rad) <= self.tilt_range_rad / 2.0
        )

    def duration_s(self, start: Angles, end: Angles) -> float:
        """Return the time that the head takes from `start` to `end`, s."""
        return max(
            abs(end.pan_rad - start.pan_rad) / self.pan_speed_radps,
            abs(end.tilt_rad - start.tilt_rad) / self.tilt_speed_radps,
        )


@dataclass(frozen=True, slots=True)
class HeadMounting:
    """Pose of the fixture in the room."""

    position_m: Vec3
    """Place where both axes cross, {W}."""
    world_from_fixture: Quaternion

    @staticmethod
    def from_degrees(position_m: Vec3, yaw_deg: float, pitch_deg: float, roll_deg: float) -> "HeadMounting":
        """Return the pose whose rotation is roll about x, then pitch about y, then yaw about z of {W}."""
        yaw = rotation.from_yaw(math.radians(yaw_deg))
        pitch = rotation.from_axis_angle((0.0, 1.0, 0.0), math.radians(pitch_deg))
        roll = rotation.from_axis_angle((1.0, 0.0, 0.0), math.radians(roll_deg))
        return HeadMounting(position_m, rotation.multiply(yaw, rotation.multiply(pitch, roll)))

    def beam(self, angles: Angles) -> Vec3:
        """Return the direction of the beam at `angles`, {W}."""
        return rotation.rotate(self.world_from_fixture, direction(angles))

    def angles(self, point_m: Vec3, start: Angles, limits: HeadLimits) -> Angles | None:
        """Return the angles at which the beam meets `point_m`, those reached soonest from `start`.

        None if the point is out of range, or at the fixture itself.
        """
        offset = vector.subtract(point_m, self.position_m)
        if vector.norm(offset) < NEAREST_M:
            return None
        x, y, z = rotation.rotate(rotation.inverse(self.world_from_fixture), offset)
        level = math.hypot(x, y)
        tilt_rad = math.atan2(level, z)
        pan_rad = start.pan_rad if tilt_rad < POLE_RAD else math.atan2(y, x)
        choices = [
            Angles(pan, tilt)
            for turned, tilt in ((pan_rad, tilt_rad), (pan_rad + math.pi, -tilt_rad))
            for pan in _turns(turned, limits.pan_range_rad)
        ]
        allowed = [choice for choice in choices if limits.allow(choice)]
        return min(allowed, key=lambda choice: limits.duration_s(start, choice), default=None)


def direction(angles: Angles) -> Vec3:
    """Return the direction of the beam at `angles`, {F}."""
    level = math.sin(angles.tilt_rad)
    return (level * math.cos(angles.pan_rad), level * math.sin(angles.pan_rad), math.cos(angles.tilt_rad))


def _turns(pan_rad: float, range_rad: float) -> Iterable[float]:
    """Return the angles equal to `pan_rad` but for whole turns, within the range."""
    first = math.ceil((-range_rad / 2.0 - pan_rad) / math.tau)
    last = math.floor((range_rad / 2.0 - pan_rad) / math.tau)
    return (pan_rad + turn * math.tau for turn in range(first, last + 1))


def moved(start: Angles, end: Angles, limits: HeadLimits, elapsed_s: float) -> Angles:
    """Return where the head is `elapsed_s` after `start` on its way to `end`.

    Both axes arrive together, so that the beam takes a smooth way.
    """
    duration_s = limits.duration_s(start, end)
    if duration_s <= elapsed_s:
        return end
    share = elapsed_s / duration_s
    return Angles(
        start.pan_rad + share * (end.pan_rad - start.pan_rad),
        start.tilt_rad + share * (end.tilt_rad - start.tilt_rad),
    )


class ManualAim:
    """The angles, from home on, within the limits of the head."""

    def __init__(self, limits: HeadLimits) -> None:
        """Start at the home position."""
        self._limits = limits
        self.step_rad = FIRST_STEP_RAD
        """Angle of one step."""
        self.angles = HOME

    def press(self, data: bytes) -> int:
        """Turn by arrows, change the step by + and -. Return how often Enter or Space is in `data`."""
        entered = 0
        for arrow, key in KEY.findall(data):
            if arrow:
                self._turn(*ARROWS[arrow])
            elif key == b"-":
                self.step_rad = max(self.step_rad / 2.0, SMALLEST_STEP_RAD)
            elif key in b"+=":
                self.step_rad = min(self.step_rad * 2.0, LARGEST_STEP_RAD)
            else:
                entered += 1
        return entered

    def _turn(self, pan: int, tilt: int) -> None:
        turned = Angles(
            self.angles.pan_rad + pan * self.step_rad, self.angles.tilt_rad + tilt * self.step_rad
        )
        if self._limits.allow(turned):
            self.angles = turned
