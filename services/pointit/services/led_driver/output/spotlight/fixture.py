"""Values of the DMX channels of a moving head. Pure."""

import math

from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.dmx.stream import UNIVERSE_SLOTS
from pointit.services.led_driver.output.spotlight.beam import DARK, BeamState
from pointit.services.led_driver.output.spotlight.config import SpotlightConfig

FULL = 255


class Fixture:
    """The channels of one fixture in its universe."""

    def __init__(self, config: SpotlightConfig) -> None:
        """Create with the fixture's channels."""
        self._config = config
        self._empty = bytearray(UNIVERSE_SLOTS)
        for number, value in config.fixed_channels.items():
            self._set(self._empty, number, value)

    def slots(self, state: BeamState) -> bytes:
        """Return all values of the universe."""
        config, channels = self._config, self._config.channels
        slots = bytearray(self._empty)
        pan = _share(state.angles.pan_rad, config.pan_range_deg, inverted=config.invert_pan)
        tilt = _share(state.angles.tilt_rad, config.tilt_range_deg, inverted=False)
        self._set_axis(slots, channels.pan, channels.pan_fine, pan)
        self._set_axis(slots, channels.tilt, channels.tilt_fine, tilt)
        self._set(slots, channels.dimmer, 0 if state.color == DARK else FULL)
        for number, value in zip(
            (channels.red, channels.green, channels.blue), self._linear(state.color), strict=True
        ):
            self._set(slots, number, value)
        return bytes(slots)

    def _set_axis(self, slots: bytearray, coarse: int, fine: int, share: float) -> None:
        if fine:
            high, low = divmod(round(share * 0xFFFF), 256)
            self._set(slots, coarse, high)
            self._set(slots, fine, low)
        else:
            self._set(slots, coarse, round(share * FULL))

    def _set(self, slots: bytearray, number: int, value: int) -> None:
        if number:
            slots[self._config.address + number - 2] = value

    def _linear(self, color: Rgb) -> Rgb:
        """Return the values that look like `color`."""
        red, green, blue = (round(FULL * (value / FULL) ** self._config.gamma) for value in color)
        return (red, green, blue)


def _share(angle_rad: float, range_deg: float, *, inverted: bool) -> float:
    """Return the share of an axis's range, 0 to 1, at an angle from its middle."""
    share = angle_rad / math.radians(range_deg)
    return min(max(0.5 - share if inverted else 0.5 + share, 0.0), 1.0)
