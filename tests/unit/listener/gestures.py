"""Cursors of an arm that stays at places and moves between them."""

import math
from collections.abc import Sequence

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor
from pointit.services.listener.referents import ReferentTarget
from tests.support.bench import START_NS

EYES: Vec3 = (0.0, 0.0, 1.64)


def at_ns(time_s: float) -> int:
    return START_NS + round(time_s * NS_PER_S)


def thing(name: str, azimuth_deg: float, away_m: float = 2.5, low_deg: float = 0.0) -> ReferentTarget:
    """A box in that direction, as high as the eyes or `low_deg` below them."""
    sight = vector.direction(math.radians(azimuth_deg), math.radians(-low_deg))
    center_m = vector.add(EYES, vector.scale(sight, away_m))
    return ReferentTarget(kind="thing", name=name, center_m=center_m, size_m=(0.2, 0.2, 0.2))


def gesture(stays: Sequence[tuple[float, float, float]], rate_hz: float = 50.0) -> list[Cursor]:
    """Return the cursors of an arm, level but 3 degrees low as people are.

    Each of `stays` has the azimuth in degrees, and when it begins and ends, s.
    """
    found: list[Cursor] = []
    for step in range(math.ceil((stays[-1][2] - stays[0][1]) * rate_hz) + 1):
        time_s = stays[0][1] + step / rate_hz
        before = [stay for stay in stays if stay[1] <= time_s][-1]
        after = next((stay for stay in stays if stay[1] > time_s), before)
        share = max(0.0, (time_s - before[2]) / max(after[1] - before[2], 1e-9))
        share = min(share, 1.0) if after is not before else 0.0
        azimuth = before[0] + (after[0] - before[0]) * share
        direction = vector.direction(math.radians(azimuth), math.radians(-3.0))
        floor = vector.add(EYES, vector.scale(direction, EYES[2] / max(-direction[2], 0.01)))
        found.append(
            Cursor(
                stamp_ns=at_ns(time_s),
                solid="plane",
                surface_id="floor",
                point_m=floor,
                origin_m=EYES,
                direction=direction,
            )
        )
    return found
