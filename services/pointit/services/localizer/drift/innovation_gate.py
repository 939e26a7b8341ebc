"""Verdicts on consecutive pointings at known places that do not fit the pose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.model import AnchorMeasurement, Array

AGREED: Literal["agreed"] = "agreed"
"""All errors are the same: the pose is wrong."""
DRIFTED: Literal["drifted"] = "drifted"
"""Errors grow linearly: the drift is faster than estimated."""
SCATTERED: Literal["scattered"] = "scattered"
"""Errors fit neither the pose nor each other."""

Verdict = Literal["agreed", "drifted", "scattered", ""]


@dataclass(frozen=True)
class Rejected:
    """A pointing beyond the gate."""

    sight: AnchorMeasurement
    azimuth_error_rad: float
    """Target minus ray."""
    elevation_error_rad: float
    azimuth_variance: float
    elevation_variance: float


def judge_rejected(
    outliers: Sequence[Rejected],
    gate: float,
    rate_sigma_radps: float,
    *,
    since_ns: int,
    accept_after: int,
    reset_after: int,
) -> Verdict:
    """Return the verdict on consecutive rejected pointings, or `""` if they are too few.

    Args:
        outliers: in order of time, the newest last.
        gate: number of sigmas within which two agree.
        rate_sigma_radps: standard deviation of the drift between them.
        since_ns: time of the last confirmation of the pose.
        accept_after: number of agreeing pointings that are accepted.
        reset_after: number of contradicting pointings that make the pose uncertain.
    """
    newest, before = outliers[-1], outliers[-accept_after:-1]
    if len(outliers) >= accept_after:
        if all(_is_step(newest, other, gate, rate_sigma_radps) for other in before):
            return AGREED
        if all(_is_ramp(newest, other, gate, since_ns) for other in before):
            return DRIFTED
    return SCATTERED if len(outliers) >= reset_after else ""


def _is_step(a: Rejected, b: Rejected, gate: float, rate_sigma_radps: float) -> bool:
    """Return True if both have the same error."""
    drifted = rate_sigma_radps * (a.sight.stamp_ns - b.sight.stamp_ns) / NS_PER_S
    step = math.remainder(a.azimuth_error_rad - b.azimuth_error_rad, math.tau)
    allowed = gate * math.sqrt(a.azimuth_variance + b.azimuth_variance + drifted**2)
    return abs(step) <= allowed and _is_level(a, b, gate)


def _is_ramp(a: Rejected, b: Rejected, gate: float, since_ns: int) -> bool:
    """Return True if the yaw error has grown linearly since `since_ns`."""
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


def sentence(outlier: Rejected, allowed: Array, verdict: Verdict) -> str:
    """Return a message about a pointing beyond the gate.

    Args:
        outlier: the newest.
        allowed: limits of the azimuth and elevation errors (2), rad.
        verdict: verdict on it.
    """
    azimuth, elevation = math.degrees(outlier.azimuth_error_rad), math.degrees(outlier.elevation_error_rad)
    if abs(outlier.azimuth_error_rad) > allowed[0]:
        side = "left" if azimuth > 0 else "right"
        off = f"the target was {abs(azimuth):.0f}° to the {side} of the ray"
        limit = math.degrees(float(allowed[0]))
    else:
        off = f"the target was {abs(elevation):.0f}° {'above' if elevation > 0 else 'below'} the ray"
        limit = math.degrees(float(allowed[1]))
    if verdict == AGREED:
        return f"{off}, as in those before: the IMU was turned or the person moved, and the pose follows"
    if verdict == DRIFTED:
        return f"{off}, more each time: the IMU drifts faster than estimated, and the pose follows"
    if verdict == SCATTERED:
        return f"{off} and those before fit neither the pose nor each other; localize again"
    return f"{off} where at most {limit:.0f}° is accepted; point at that target again, arm straight"
