"""The running localizer's verdict on the pointings of one window or of several lamps."""

from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.estimation.mounting import mounting_fault
from pointit.services.localizer.estimation.sample_blocks import blocks
from pointit.services.localizer.verification.following import followed
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
