"""Angles of a moving head that a person turns by keys. Pure."""

import math
import re

from pointit.services.led_driver.output.spotlight.head import HOME, Angles, Limits

LARGEST_STEP_RAD, SMALLEST_STEP_RAD = math.radians(16.0), math.radians(0.0625)
FIRST_STEP_RAD = math.radians(4.0)

KEY = re.compile(rb"\x1b[\[O]([ABCD])|([-+=]|[ \r\n])")
"""An arrow as terminals send it, or another key in use."""

ARROWS = {b"A": (0, 1), b"B": (0, -1), b"C": (1, 0), b"D": (-1, 0)}
"""Steps of pan and tilt by up, down, right, left."""


class ManualAim:
    """The angles, from home on, within the limits of the head."""

    def __init__(self, limits: Limits) -> None:
        """Begin at home."""
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
