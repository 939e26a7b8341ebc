"""The running localizer's verdict on the pointings of one window or of several lamps."""

import math
from dataclasses import replace

from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.estimation.mounting import mounting_fault
from pointit.services.localizer.estimation.sample_blocks import blocks
from pointit.services.localizer.verification.following import doubt, followed
from pointit.services.localizer.verification.holds import held

LIMITS = SolverSettings()
"""The localizer's own priors and limits, as configured by default."""


def judged(pointings: Pointings, trust: SolverSettings = LIMITS) -> Solution | Refusal:
    """Return the pose that the localizer takes from `pointings`, or its refusal."""
    if not len(pointings):
        return solve(pointings, trust)
    if blocks(pointings).is_still:
        return held(pointings, trust)
    found = followed(pointings, trust)
    wrong = mounting_fault(pointings, found, trust, 0.0)
    return Refusal(wrong, found.residual_rad) if wrong else found


def refusal_message(pointings: Pointings, found: Solution, trust: SolverSettings = LIMITS) -> str:
    """Return why the localizer refuses `found` although it is certain, or `""`."""
    if blocks(pointings).is_still:
        result = held(pointings, replace(trust, max_position_sigma_m=math.inf, max_yaw_sigma_rad=math.inf))
        return result.reason if isinstance(result, Refusal) else ""
    return doubt(pointings, found, trust) or mounting_fault(pointings, found, trust, 0.0)
