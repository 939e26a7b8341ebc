"""Advice for a person who points past everything: in which direction the next thing is."""

import math
from typing import Protocol

from pointit.geometry import vector
from pointit.geometry.polyline import Hit
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Feedback, Passed
from pointit.schemas.base import FARTHEST
from pointit.schemas.cues import SIGNS
from pointit.services.pui.surfaces import PLACES, Surface

LOOK_NS = NS_PER_S // 10
"""Minimum time between searches for the nearest thing, so that passing costs little more than a hit, ns."""

PASSING_TIMEOUT_NS = 3 * NS_PER_S // 2
"""Time of continuous pointing past everything before the cue, ns. Sweeps from thing to thing are shorter."""

AGAIN_NS = 6 * NS_PER_S
"""Minimum time between two cues, ns."""

HINT_NS = 60 * NS_PER_S
"""Time of pointing past everything, without a hit in between, before the hint to localize again, ns."""

REST_RAD = math.radians(-55.0)
"""Elevation of the ray below which the arm rests. There is no cue then."""

STEP_DEG = 5


class Things(Protocol):
    """Pointable things, such as `Surfaces`."""

    def nearest(self, origin_m: Vec3, direction: Vec3, /) -> tuple[Surface, Hit] | None:
        """Return the thing with the smallest angle to the ray, or None if the ray meets a hidden thing."""
        ...


class Passing:
    """State of one person who points past everything."""

    def __init__(self, things: Things) -> None:
        self._things = things
        self._passed: Passed | None = None
        self._looked_ns = 0
        self._since_ns: int | None = None
        self._cued_ns: int | None = None
        self._cues = 0
        self._missed_ns = 0
        self.hint = ""
        """Last message to a person who has missed everything for `HINT_NS`, else `""`."""

    def end(self) -> None:
        """Reset: the ray meets something, or the person stopped pointing."""
        self._since_ns = None
        self._missed_ns = 0
        self.hint = ""

    def miss(self, origin_m: Vec3, direction: Vec3, stamp_ns: int) -> Passed | None:
        """Return the thing nearest to a ray that passes everything, or None while the arm rests."""
        if vector.elevation(direction) < REST_RAD:
            self._since_ns = None
            return None
        if self._since_ns is None or stamp_ns < self._since_ns:
            self._since_ns = stamp_ns
            self._looked_ns = stamp_ns - LOOK_NS
        if 0 <= stamp_ns - self._looked_ns < LOOK_NS:
            return self._passed

        self._looked_ns = stamp_ns
        self._missed_ns += LOOK_NS
        self._passed = None
        nearest = self._things.nearest(origin_m, direction)
        if nearest is None:
            return None
        surface, hit = nearest
        if not is_in_range(hit.point_m):
            return None

        is_long = stamp_ns - self._since_ns >= PASSING_TIMEOUT_NS
        self._passed = _passed(surface, hit, origin_m, direction, is_long=is_long)
        if is_long and self._missed_ns > HINT_NS:
            self.hint = self._passed.text
        return self._passed

    def cue(self, stamp_ns: int) -> Feedback | None:
        """Return the cue with the direction to the nearest thing, if it is due."""
        passed = self._passed
        if self._since_ns is None or passed is None or not passed.text:
            return None
        if self._cued_ns is not None and 0 <= stamp_ns - self._cued_ns < AGAIN_NS:
            return None
        self._cued_ns = stamp_ns
        self._cues += 1
        sign = SIGNS["target"]._asdict()
        sign["color"] = None
        sign["target_id"] = passed.surface_id
        return Feedback(
            stamp_ns=stamp_ns,
            seq=self._cues,
            cue="target",
            text=passed.text,
            turn_rad=(passed.right_rad, passed.up_rad),
            **sign,
        )


def is_in_range(point_m: Vec3) -> bool:
    """Return True if a message can hold the point."""
    x, y, z = point_m
    return -FARTHEST <= x <= FARTHEST and -FARTHEST <= y <= FARTHEST and -FARTHEST <= z <= FARTHEST


def _passed(surface: Surface, hit: Hit, origin_m: Vec3, direction: Vec3, *, is_long: bool) -> Passed:
    to_thing = vector.subtract(hit.point_m, origin_m)
    right_rad = vector.wrap(vector.azimuth(direction) - vector.azimuth(to_thing))
    up_rad = vector.elevation(to_thing) - vector.elevation(direction)
    text = ""
    if is_long:
        name = f"{surface.kind} {surface.id}"
        text = words(name, right_rad, up_rad, vector.elevation(to_thing))
    kind, solid = PLACES[surface.kind]
    return Passed(
        surface=kind,
        solid=solid,
        surface_id=surface.id,
        point_m=hit.point_m,
        position_m=hit.position_m,
        right_rad=right_rad,
        up_rad=up_rad,
        text=text,
    )


def words(name: str, right_rad: float, up_rad: float, elevation_rad: float) -> str:
    """Return a message with the direction in which to turn from the ray to the thing `name`.

    Args:
        name: name of the nearest thing.
        right_rad: turn of azimuth to the right that meets it.
        up_rad: turn of elevation upwards that meets it.
        elevation_rad: elevation of the thing: the higher, the less a turn of azimuth moves the ray.
    """
    sideways_rad = right_rad * math.cos(elevation_rad)
    turn = "left"
    side = "right"
    if right_rad > 0.0:
        turn = "right"
        side = "left"
    if abs(sideways_rad) > math.pi / 2.0:
        return f"{name} is behind you: turn around by your {turn}"
    if abs(sideways_rad) > abs(up_rad):
        return f"you point {_about(sideways_rad)} to the {side} of {name}: turn {turn}"
    if up_rad > 0.0:
        return f"you point {_about(up_rad)} below {name}: raise your arm"
    return f"you point {_about(up_rad)} above {name}: lower your arm"


def _about(angle_rad: float) -> str:
    """Return the size of an angle as text, in steps that a trembling hand does not change."""
    steps = round(abs(math.degrees(angle_rad)) / STEP_DEG)
    return f"{max(STEP_DEG, STEP_DEG * steps)}°"
