"""Pointings at known places that do not fit the pose: what to make of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.anchor_measurement import AnchorMeasurement
from pointit.services.localizer.drift.model import Array

AGREED: Literal["agreed"] = "agreed"
"""They say the same: the pose is wrong, not they."""
DRIFTED: Literal["drifted"] = "drifted"
"""They grow evenly: the drift is faster than was believed."""
SCATTERED: Literal["scattered"] = "scattered"
"""They fit neither the pose nor each other."""

Verdict = Literal["agreed", "drifted", "scattered", ""]


@dataclass(frozen=True)
class Rejected:
    """A pointing beyond the gate."""

    sight: AnchorMeasurement
    azimuth_error_rad: float
    """Target less ray."""
    elevation_error_rad: float
    azimuth_variance: float
    elevation_variance: float


def judge_rejected(
    doubts: Sequence[Rejected],
    gate: float,
    rate_sigma_radps: float,
    *,
    since_ns: int,
    believe_after: int,
    despair_after: int,
) -> Verdict:
    """Return what rejected pointings in a row mean together; nothing yet when they are too few.

    Args:
        doubts: in order of time, the newest last.
        gate: sigmas within which two agree.
        rate_sigma_radps: how uncertain the drift between them is.
        since_ns: when the pose was last told to be right.
        believe_after: so many that agree are believed.
        despair_after: so many are too many.
    """
    newest, before = doubts[-1], doubts[-believe_after:-1]
    if len(doubts) >= believe_after:
        if all(_is_step(newest, other, gate, rate_sigma_radps) for other in before):
            return AGREED
        if all(_is_ramp(newest, other, gate, since_ns) for other in before):
            return DRIFTED
    return SCATTERED if len(doubts) >= despair_after else ""


def _is_step(a: Rejected, b: Rejected, gate: float, rate_sigma_radps: float) -> bool:
    """Return True if the pose is beside by the same in both."""
    drifted = rate_sigma_radps * (a.sight.stamp_ns - b.sight.stamp_ns) / NS_PER_S
    step = math.remainder(a.azimuth_error_rad - b.azimuth_error_rad, math.tau)
    allowed = gate * math.sqrt(a.azimuth_variance + b.azimuth_variance + drifted**2)
    return abs(step) <= allowed and _is_level(a, b, gate)


def _is_ramp(a: Rejected, b: Rejected, gate: float, since_ns: int) -> bool:
    """Return True if the yaw has gone beside evenly since `since_ns`."""
    earlier_ns = b.sight.stamp_ns - since_ns
    if earlier_ns <= 0:
        return False
    grown = (a.sight.stamp_ns - since_ns) / earlier_ns
    ramp = math.remainder(a.azimuth_error_rad - grown * b.azimuth_error_rad, math.tau)
    allowed = gate * math.sqrt(a.azimuth_variance + grown**2 * b.azimuth_variance)
    return abs(ramp) <= allowed and _is_level(a, b, gate)


def _is_level(a: Rejected, b: Rejected, gate: float) -> bool:
    step = a.elevation_error_rad - b.elevation_error_rad
    return abs(step) <= gate * math.sqrt(a.elevation_variance + b.elevation_variance)


def sentence(doubt: Rejected, allowed: Array, decided: Verdict) -> str:
    """Return what a technician should know of a pointing beyond the gate, one sentence.

    Args:
        doubt: the newest.
        allowed: how far off azimuth and elevation might have been (2), rad.
        decided: what was made of it.
    """
    azimuth, elevation = math.degrees(doubt.azimuth_error_rad), math.degrees(doubt.elevation_error_rad)
    if abs(doubt.azimuth_error_rad) > allowed[0]:
        side = "left" if azimuth > 0 else "right"
        off = f"the target was {abs(azimuth):.0f}° to the {side} of the ray"
        limit = math.degrees(float(allowed[0]))
    else:
        off = f"the target was {abs(elevation):.0f}° {'above' if elevation > 0 else 'below'} the ray"
        limit = math.degrees(float(allowed[1]))
    if decided == AGREED:
        return f"{off}, as those before tell: the IMU was turned or the person moved, and the pose follows"
    if decided == DRIFTED:
        return f"{off}, more each time: the IMU drifts faster than was believed, and the pose follows"
    if decided == SCATTERED:
        return f"{off} and those before fit neither the pose nor each other; localize again"
    return f"{off} where at most {limit:.0f}° is believed; point at that target again, arm straight"
