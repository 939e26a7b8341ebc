"""Identification of the robot that a person follows, by the fit of the rays (pointing.md §4)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pointit.services.localizer.estimation.estimator import Refusal, Solution

MEANT = 0.9
"""Probability from which a robot is chosen; below it the choice is ambiguous."""

SWITCH_AFTER = 2
"""Number of consecutive solutions in which another robot must reach that probability."""


@dataclass(frozen=True)
class Fit:
    """Fit of the rays to one robot."""

    object_id: str
    result: Solution | Refusal
    probability: float = 0.0
    """Probability of this robot among all."""


def rank_by_posterior(
    results: Sequence[tuple[str, Solution | Refusal]], independent: float, ray_sigma_rad: float
) -> list[Fit]:
    """Return the fits with their posterior probabilities under equal priors, the best first.

    The likelihood of residuals of N independent pointings, r² being their mean square (sideways and upwards
    together), is exp(-N r² / 2 sigma²). Sigma is that of one axis, so that r² of the followed robot is 2
    sigma² or less, as the pose is fitted. It is the assumed sigma of rays that follow a target; if even the
    best fit misses by more, half its r² replaces sigma², so that inaccurate pointing is more ambiguous.

    Args:
        results: of the same rays, one a robot, with its id.
        independent: N; the samples of half a second count as one.
        ray_sigma_rad: sigma of one pointing, sideways or upwards.
    """
    known = [result.residual_rad for _, result in results if result.residual_rad is not None]
    least = min(known, default=0.0)
    variance = max(ray_sigma_rad**2, 0.5 * least**2)
    weights = [
        0.0
        if result.residual_rad is None
        else math.exp(-0.5 * independent * (result.residual_rad**2 - least**2) / variance)
        for _, result in results
    ]
    total = math.fsum(weights)
    fits = [
        Fit(object_id, result, weight / total if total else 0.0)
        for (object_id, result), weight in zip(results, weights, strict=True)
    ]
    return sorted(fits, key=_fit_order)


class TargetDisambiguator:
    """Chooses a robot, and keeps the choice until another robot is clearly meant."""

    def __init__(self, object_id: str = "") -> None:
        """Start without a choice; `object_id` is the robot to name meanwhile."""
        self.object_id = object_id
        """The chosen robot, or the one that fits best while the choice is ambiguous."""
        self._decided = False
        self._streak = 0

    def choose(self, fits: Sequence[Fit]) -> Solution | Refusal:
        """Return the result for the chosen of `fits`, the best first, or a refusal if that is ambiguous."""
        best = fits[0]
        current = next((fit for fit in fits if fit.object_id == self.object_id), None)
        if not self._decided or current is None:
            return self._first(fits)
        if current is best or _are_near(current.result, best.result):
            self._streak = 0
            return current.result
        if best.probability <= current.probability:  # it fits, but cannot be solved just now
            return current.result
        share = best.probability / (best.probability + current.probability)
        self._streak = self._streak + 1 if share >= MEANT else 0
        if self._streak < SWITCH_AFTER:
            return _undecided(current.object_id, best)
        return self._first(fits)

    def _first(self, fits: Sequence[Fit]) -> Solution | Refusal:
        """Choose a robot; robots that give the same pose count as one."""
        best = fits[0]
        self.object_id, self._decided, self._streak = best.object_id, False, 0
        if isinstance(best.result, Refusal):
            return best.result
        others = [fit for fit in fits[1:] if not _are_near(best.result, fit.result)]
        if others and math.fsum(fit.probability for fit in others) > 1.0 - MEANT:
            return _undecided(best.object_id, max(others, key=lambda fit: fit.probability))
        self._decided = True
        return best.result


def _undecided(object_id: str, other: Fit) -> Refusal:
    return Refusal(
        f"two robots move alike, {object_id} and {other.object_id}: make one of them move differently, "
        "or set robot_id",
        other.result.residual_rad,
    )


def _are_near(one: Solution | Refusal, other: Solution | Refusal) -> bool:
    return isinstance(one, Solution) and isinstance(other, Solution) and one.is_near(other)


def _fit_order(fit: Fit) -> tuple[bool, float]:
    """Sort key: solutions before refusals, small residuals first."""
    residual_rad = fit.result.residual_rad
    return isinstance(fit.result, Refusal), math.inf if residual_rad is None else residual_rad
