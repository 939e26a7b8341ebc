"""The beam that follows a cursor: its owner, its motion and brightness, and the DMX values of the head.

Pure: calls pass the time.
"""

import math
from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.dmx.stream import UNIVERSE_SLOTS
from pointit.services.led_driver.output.spotlight.config import SpotlightConfig
from pointit.services.led_driver.output.spotlight.head import HOME, Angles, HeadLimits, HeadMounting, moved

DARK: Rgb = (0, 0, 0)
FULL = 255


@dataclass(frozen=True, slots=True)
class BeamState:
    """Angles and colour of the fixture at one time."""

    angles: Angles
    color: Rgb
    """Colour of the beam; black if it is dark."""


class Beam:
    """Turns the head towards its target within range and speed."""

    def __init__(self, mounting: HeadMounting, limits: HeadLimits, dark_beyond_rad: float = math.pi) -> None:
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
        red, green, blue = (round(FULL * (value / FULL) ** self._config.gamma) for value in color)
        return (red, green, blue)


def _share(angle_rad: float, range_deg: float, *, inverted: bool) -> float:
    """Return the share of an axis's range, 0 to 1, at an angle from its middle."""
    share = angle_rad / math.radians(range_deg)
    return min(max(0.5 - share if inverted else 0.5 + share, 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class BeamAim:
    """A person's cursor, which the beam may follow."""

    user: str
    point_m: Vec3
    """{W}."""
    color: Rgb


class BeamOwnership:
    """Cursors of the people who may have the beam."""

    def __init__(self, user: str = "") -> None:
        """Reserve the beam for `user`. `""`: for the user who started pointing last."""
        self._user = user
        self._aims: dict[str, BeamAim] = {}
        """In the order in which the people began to point."""

    def set_cursor(self, user: str, point_m: Vec3 | None, color: Rgb) -> None:
        """Set the place of `user`'s cursor. None: they point at nothing."""
        if self._user not in ("", user):
            return
        if point_m is None:
            self._aims.pop(user, None)
        else:
            self._aims[user] = BeamAim(user, point_m, color)

    @property
    def aim(self) -> BeamAim | None:
        """The cursor that the beam follows, or None if nobody points."""
        return next(reversed(self._aims.values()), None)
