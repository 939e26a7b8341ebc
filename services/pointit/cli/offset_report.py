"""What pointings at lamps tell of a person, for people; pure."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, Anchor, PointingOffset
from pointit.services.pointing import correction
from pointit.services.pointing.offset import OffsetFit, Sighting, fit, sighting

STEADY_RAD = math.radians(3.0)
"""Spread of the rays about their mean above which a pointing does not count."""
DRIFT_FROM = 4
"""Pointings that a drift of the IMU can be told from."""
DRIFT_OVER_S = 8.0
"""How far the first and the last of them must be apart."""


@dataclass(frozen=True)
class Pointing:
    """One pointing at a lamp, with what the person's errors were and what is left of them, rad.

    Azimuths without what is common to all pointings: that is the heading of the pose.
    """

    lamp: str
    azimuth_before_rad: float
    azimuth_after_rad: float
    elevation_before_rad: float
    elevation_after_rad: float
    is_used: bool
    why_not: str = ""


def in_one_pose(anchors: Sequence[Anchor]) -> list[Anchor]:
    """Return `anchors` as they are in the pose before the first, as if each had not set it right.

    An IMU's drift meanwhile, a constant rate, is taken out where it can be told: the median of the slopes
    between all pairs (Theil and Sen).
    """
    if not anchors:
        return []
    first = anchors[0]
    same = [
        anchor.model_copy(update={"position_m": first.position_m, "yaw_rad": first.yaw_rad})
        for anchor in anchors
    ]
    times_s = [(anchor.stamp_ns - first.stamp_ns) / NS_PER_S for anchor in same]
    if len(same) < DRIFT_FROM or max(times_s) - min(times_s) < DRIFT_OVER_S:
        return same
    turned = [0.0 if seen is None else _turn(seen) for seen in map(sighting, same)]
    slopes = [
        vector.wrap(turned[b] - turned[a]) / (times_s[b] - times_s[a])
        for a, b in combinations(range(len(same)), 2)
        if times_s[b] - times_s[a] > 1.0
    ]
    rate_radps = statistics.median(slopes) if slopes else 0.0
    return [
        anchor.model_copy(update={"yaw_rad": anchor.yaw_rad + rate_radps * time_s})
        for anchor, time_s in zip(same, times_s, strict=True)
    ]


def _turn(seen: Sighting) -> float:
    return vector.wrap(seen.target_azimuth_rad - seen.azimuth_rad)


def assess(anchors: Sequence[Anchor], now_ns: int) -> tuple[OffsetFit, list[Pointing]]:
    """Return the offset that `anchors` tell, and what became of each."""
    steady = [anchor for anchor in anchors if anchor.target_m and anchor.spread_rad <= STEADY_RAD]
    sightings = [seen for seen in map(sighting, in_one_pose(steady)) if seen is not None]
    fitted = fit(sightings, now_ns)
    rows: list[Pointing] = []
    index = 0
    for anchor in anchors:
        if anchor not in steady:
            rows.append(Pointing(anchor.target_id, 0.0, 0.0, 0.0, 0.0, is_used=False, why_not=anchor.reason))
            continue
        rows.append(_row(anchor.target_id, sightings[index], fitted, is_used=index not in fitted.dropped))
        index += 1
    return fitted, rows


def _row(lamp: str, seen: Sighting, fitted: OffsetFit, *, is_used: bool) -> Pointing:
    azimuth = vector.wrap(_turn(seen) - fitted.heading_rad)
    elevation = seen.target_elevation_rad - seen.elevation_rad
    by_azimuth = by_elevation = 0.0
    if fitted.offset is not None:
        world = seen.azimuth_rad + fitted.heading_rad
        by_azimuth, by_elevation = correction.apply(fitted.offset, world, seen.elevation_rad)
    return Pointing(
        lamp=lamp,
        azimuth_before_rad=azimuth,
        azimuth_after_rad=vector.wrap(azimuth - by_azimuth),
        elevation_before_rad=elevation,
        elevation_after_rad=elevation - by_elevation,
        is_used=is_used,
        why_not="" if is_used else "far from the others",
    )


def table_row(row: Pointing) -> dict[str, Any]:
    """Return `row` for a table or a program, in degrees."""
    return {
        "lamp": row.lamp,
        "azimuth_before_deg": round(math.degrees(row.azimuth_before_rad), 2),
        "azimuth_after_deg": round(math.degrees(row.azimuth_after_rad), 2),
        "elevation_before_deg": round(math.degrees(row.elevation_before_rad), 2),
        "elevation_after_deg": round(math.degrees(row.elevation_after_rad), 2),
        "used": "yes" if row.is_used else f"no: {row.why_not}",
    }


def describe(offset: PointingOffset) -> str:
    """Return in one clause what an offset does."""
    up_deg = math.degrees(offset.elevation[0])
    text = f"the rays are turned {'up' if up_deg >= 0 else 'down'} by {abs(up_deg):.1f}°"
    if offset.rung == "polynomial":
        text += " in the middle, and otherwise elsewhere (a polynomial in azimuth and elevation)"
    many = "pointing" if offset.anchors == 1 else "pointings"
    left_deg = math.degrees(offset.sigma_rad)
    return f"{text}; fitted from {offset.anchors} {many}, {left_deg:.1f}° (1 sigma) is left"
