"""Where the nearest thing is when a ray passes everything by: at once for a mark, later in words; pure."""

import math
from typing import Protocol

from pointit.geometry import vector
from pointit.geometry.closest import Hit
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Feedback, Passed
from pointit.schemas.cues import SIGNS
from pointit.services.pui.shapes import PLACES, Surface

LOOK_NS = NS_PER_S // 10
"""The nearest thing is looked for at most this often, so that passing costs little more than meeting."""

PATIENCE_NS = 3 * NS_PER_S // 2
"""Time of pointing past without a break until the person is told; sweeps from thing to thing are shorter."""

AGAIN_NS = 6 * NS_PER_S
"""Least time between two cues."""

REST_RAD = math.radians(-55.0)
"""Below this elevation of the ray the arm rests; nobody is told then."""

STEP_DEG = 5


class Things(Protocol):
    """What can be pointed at; `Surfaces` is one."""

    def nearest(self, origin_m: Vec3, direction: Vec3, /) -> tuple[Surface, Hit] | None:
        """Return the thing with the smallest angle to the ray, or None if the ray meets a hidden thing."""
        ...


class Passing:
    """Follows one person who points past everything."""

    def __init__(self, things: Things) -> None:
        self._things = things
        self._passed: Passed | None = None
        self._looked_ns = 0
        self._since_ns: int | None = None
        self._cued_ns: int | None = None
        self._cues = 0

    def end(self) -> None:
        """Forget it: the ray meets something, or nobody points."""
        self._since_ns = None

    def miss(self, origin_m: Vec3, direction: Vec3, stamp_ns: int) -> Passed | None:
        """Return the thing nearest to a ray that passes everything by, or None while the arm rests."""
        if vector.elevation(direction) < REST_RAD:
            self._since_ns = None
            return None
        if self._since_ns is None or stamp_ns < self._since_ns:
            self._since_ns, self._looked_ns = stamp_ns, stamp_ns - LOOK_NS
        if not 0 <= stamp_ns - self._looked_ns < LOOK_NS:
            self._looked_ns = stamp_ns
            found = self._things.nearest(origin_m, direction)
            is_long = stamp_ns - self._since_ns >= PATIENCE_NS
            self._passed = None if found is None else _passed(*found, origin_m, direction, is_long=is_long)
        return self._passed

    def cue(self, stamp_ns: int) -> Feedback | None:
        """Return the cue that tells the person where the nearest thing is, if it is time for one."""
        passed = self._passed
        if self._since_ns is None or passed is None or not passed.text:
            return None
        if self._cued_ns is not None and 0 <= stamp_ns - self._cued_ns < AGAIN_NS:
            return None
        self._cued_ns = stamp_ns
        self._cues += 1
        sign = SIGNS["target"]
        return Feedback(
            stamp_ns=stamp_ns,
            seq=self._cues,
            cue="target",
            text=passed.text,
            chime=sign.chime,
            haptic_ms=sign.haptic_ms,
            target_id=passed.surface_id,
            turn_rad=(passed.right_rad, passed.up_rad),
        )


def _passed(surface: Surface, hit: Hit, origin_m: Vec3, direction: Vec3, *, is_long: bool) -> Passed:
    to = vector.subtract(hit.point_m, origin_m)
    right_rad = vector.wrap(vector.azimuth(direction) - vector.azimuth(to))
    up_rad = vector.elevation(to) - vector.elevation(direction)
    kind, solid = PLACES[surface.kind]
    name = f"{surface.kind} {surface.id}"
    return Passed(
        surface=kind,
        solid=solid,
        surface_id=surface.id,
        point_m=hit.point_m,
        position_m=hit.position_m,
        right_rad=right_rad,
        up_rad=up_rad,
        text=words(name, right_rad, up_rad, vector.elevation(to)) if is_long else "",
    )


def words(name: str, right_rad: float, up_rad: float, elevation_rad: float) -> str:
    """Return where a person points who passes the thing called `name`, and what to do.

    Args:
        name: of the nearest thing.
        right_rad: azimuth to turn to the right to meet it.
        up_rad: elevation to turn up to meet it.
        elevation_rad: of the thing: the higher, the less a turn of azimuth moves the ray.
    """
    sideways_rad = right_rad * math.cos(elevation_rad)
    there, here = ("right", "left") if right_rad > 0.0 else ("left", "right")
    if abs(sideways_rad) > math.pi / 2.0:
        return f"{name} is behind you: turn around by your {there}"
    if abs(sideways_rad) > abs(up_rad):
        return f"you point {_about(sideways_rad)} to the {here} of {name}: turn {there}"
    if up_rad > 0.0:
        return f"you point {_about(up_rad)} below {name}: raise your arm"
    return f"you point {_about(up_rad)} above {name}: lower your arm"


def _about(angle_rad: float) -> str:
    """Return the size of an angle for reading, in steps that a trembling hand does not change."""
    return f"{max(STEP_DEG, STEP_DEG * round(abs(math.degrees(angle_rad)) / STEP_DEG))}°"
