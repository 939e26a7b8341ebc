"""Report on a person's pointing offset from pointings at lamps; pure."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from rich.text import Text

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, Anchor, PointingOffset
from pointit.services.pointing.offset import OffsetFit, OffsetSighting, fit, sighting
from pointit.services.pointing.pointer import apply

STEADY_RAD = math.radians(3.0)
"""Spread of the rays about their mean above which a pointing does not count."""
DRIFT_FROM = 4
"""Number of pointings needed to estimate a drift of the IMU."""
DRIFT_OVER_S = 8.0
"""Minimum time between the first and the last of them."""
MAX_DROPPED = 1.0 / 3.0
"""Share of dropped pointings above which the pose is wrong, not the person's pointing."""
SCATTER_RAD = math.radians(20.0)
"""Rms of all azimuths about their mean above which the pose must be wrong."""


@dataclass(frozen=True, kw_only=True)
class AnchorResidual:
    """One pointing at a lamp, with the person's errors before and after correction, rad.

    Target minus ray; azimuths without the mean of all pointings, which is the heading of the pose. None if
    not measured.
    """

    lamp: str
    azimuth_before_rad: float | None = None
    azimuth_after_rad: float | None = None
    elevation_before_rad: float | None = None
    elevation_after_rad: float | None = None
    is_used: bool
    why_not: str = ""
    not_accepted: str = ""
    """Reason why the localizer did not correct the pose by it, or `""`. It may count nevertheless."""


def in_one_pose(anchors: Sequence[Anchor]) -> list[Anchor]:
    """Return `anchors` relative to the pose before the first, without the corrections by each.

    The IMU's drift meanwhile, a constant rate, is removed if it can be estimated: the median of the slopes
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


def _turn(seen: OffsetSighting) -> float:
    return vector.wrap(seen.target_azimuth_rad - seen.azimuth_rad)


def assess(anchors: Sequence[Anchor], now_ns: int) -> tuple[OffsetFit, list[AnchorResidual]]:
    """Return the offset fitted to `anchors`, and the residual of each."""
    steady = [anchor for anchor in anchors if anchor.target_m and anchor.spread_rad <= STEADY_RAD]
    sightings = [seen for seen in map(sighting, in_one_pose(steady)) if seen is not None]
    offset_fit = fit(sightings, now_ns)
    rows: list[AnchorResidual] = []
    index = 0
    for anchor in anchors:
        if anchor not in steady:
            rows.append(AnchorResidual(lamp=anchor.target_id, is_used=False, why_not=anchor.reason))
            continue
        rows.append(_row(anchor, sightings[index], offset_fit, is_used=index not in offset_fit.dropped))
        index += 1
    return offset_fit, rows


def _row(anchor: Anchor, seen: OffsetSighting, offset_fit: OffsetFit, *, is_used: bool) -> AnchorResidual:
    azimuth = vector.wrap(_turn(seen) - offset_fit.heading_rad)
    elevation = seen.target_elevation_rad - seen.elevation_rad
    by_azimuth = by_elevation = 0.0
    if offset_fit.offset is not None:
        world = seen.azimuth_rad + offset_fit.heading_rad
        by_azimuth, by_elevation = apply(offset_fit.offset, world, seen.elevation_rad)
    return AnchorResidual(
        lamp=anchor.target_id,
        azimuth_before_rad=azimuth,
        azimuth_after_rad=vector.wrap(azimuth - by_azimuth),
        elevation_before_rad=elevation,
        elevation_after_rad=elevation - by_elevation,
        is_used=is_used,
        why_not="" if is_used else "far from the others",
        not_accepted="" if anchor.accepted else anchor.reason or "no reason given",
    )


def rejection_reason(rows: Sequence[AnchorResidual]) -> str:
    """Return the evidence in `rows` that the pose is wrong, so that no offset is stored, or `""`."""
    measured = [row for row in rows if row.azimuth_before_rad is not None]
    dropped = sum(not row.is_used for row in measured)
    if dropped > MAX_DROPPED * len(measured):
        return f"{dropped} of {len(measured)} pointings exceed the error of a person"
    azimuths = [row.azimuth_before_rad for row in rows if row.azimuth_before_rad is not None]
    if not azimuths:
        return ""
    mean = math.atan2(sum(map(math.sin, azimuths)), sum(map(math.cos, azimuths)))
    rms = math.sqrt(statistics.fmean(vector.wrap(azimuth - mean) ** 2 for azimuth in azimuths))
    if rms <= SCATTER_RAD:
        return ""
    return f"the directions scatter by {math.degrees(rms):.0f}° about their mean"


def table_row(row: AnchorResidual) -> dict[str, Any]:
    """Return `row` for a program, in degrees, or None if not measured."""
    return {
        "lamp": row.lamp,
        "azimuth_before_deg": _degrees(row.azimuth_before_rad),
        "azimuth_after_deg": _degrees(row.azimuth_after_rad),
        "elevation_before_deg": _degrees(row.elevation_before_rad),
        "elevation_after_deg": _degrees(row.elevation_after_rad),
        "used": "yes" if row.is_used else f"no: {row.why_not}",
        "not_accepted": row.not_accepted,
    }


def shown_row(row: AnchorResidual) -> dict[str, Any]:
    """Return `row` for people: degrees too far right and too low."""
    counts = "yes" if row.is_used else f"no: {row.why_not}"
    if row.is_used and row.not_accepted:
        counts = f"yes, but the localizer did not correct the pose by it: {row.not_accepted}"
    return {
        "lamp": row.lamp,
        "too_far_right": _tenths(row.azimuth_before_rad),
        "corrected": _tenths(row.azimuth_after_rad),
        "too_low": _tenths(row.elevation_before_rad),
        "corrected_": _tenths(row.elevation_after_rad),
        "counts": counts,
    }


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else round(math.degrees(angle_rad), 2)


def _tenths(angle_rad: float | None) -> Text | None:
    return (
        None
        if angle_rad is None
        else Text(f"{round(math.degrees(angle_rad), 1) + 0.0:.1f}°", justify="right")
    )


def describe(offset: PointingOffset) -> str:
    """Return the effect of an offset as a clause."""
    up_deg = math.degrees(offset.elevation[0])
    text = f"the rays are turned {'up' if up_deg >= 0 else 'down'} by {abs(up_deg):.1f}°"
    if offset.rung == "polynomial":
        text += " in the middle, and differently elsewhere (a polynomial in azimuth and elevation)"
    many = "pointing" if offset.anchors == 1 else "pointings"
    left_deg = math.degrees(offset.sigma_rad)
    return f"{text}; fitted from {offset.anchors} {many}, {left_deg:.1f}° (1 sigma) is left"
