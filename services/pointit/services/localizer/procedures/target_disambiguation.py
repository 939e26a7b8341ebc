"""Which of several robots a person follows: the one that fits the rays, once it is clear (pointing.md §4)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pointit.services.localizer.estimation.estimator import Refusal, Solution

MEANT = 0.9
"""A robot as probable as this is meant; with less nobody knows which it is."""

SWITCH_AFTER = 2
"""So many tries in a row another robot must be as probable as that beside the one that is followed."""


@dataclass(frozen=True)
class Fit:
    """How well the rays fit one robot."""

    object_id: str
    result: Solution | Refusal
    probability: float = 0.0
    """That this one is meant, of all there are."""


def rank_by_posterior(
    results: Sequence[tuple[str, Solution | Refusal]], independent: float, ray_sigma_rad: float
) -> list[Fit]:
    """Return the fits with their probabilities, the best first; none is likelier beforehand.

    The likelihood of residuals of N independent pointings, r² being their mean square (sideways and upwards
    together), is exp(-N r² / 2 sigma²). Sigma is that of one axis, so that r² of who is followed is 2 sigma²
    or less, as the pose is fitted. It is what is believed of rays that follow something; where even the best
    misses by more, half its r² takes the place of sigma²: who points badly leaves more doubt.

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
    total = sum(weights)
    fits = [
        Fit(object_id, result, weight / total if total else 0.0)
        for (object_id, result), weight in zip(results, weights, strict=True)
    ]
    return sorted(fits, key=_worth)


class TargetDisambiguator:
    """Decides, and keeps to what was decided until another robot is clearly meant."""

    def __init__(self, object_id: str = "") -> None:
        """Begin undecided; `object_id` is the robot to name meanwhile."""
        self.object_id = object_id
        """Which is meant, or fits best as long as nobody knows."""
        self._decided = False
        self._streak = 0

    def choose(self, fits: Sequence[Fit]) -> Solution | Refusal:
        """Return the result for the robot that is meant, or why nobody knows which it is.

        Args:
            fits: the best first, at least one.
        """
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
        """Decide, nothing being decided; robots from which the same place follows are one."""
        best = fits[0]
        self.object_id, self._decided, self._streak = best.object_id, False, 0
        if isinstance(best.result, Refusal):
            return best.result
        others = [fit for fit in fits[1:] if not _are_near(best.result, fit.result)]
        if others and sum(fit.probability for fit in others) > 1.0 - MEANT:
            return _undecided(best.object_id, max(others, key=lambda fit: fit.probability))
        self._decided = True
        return best.result


def _undecided(object_id: str, other: Fit) -> Refusal:
    return Refusal(
        f"two robots move alike, {object_id} and {other.object_id}: have one of them move otherwise, "
        "or set robot_id",
        other.result.residual_rad,
    )


def _are_near(one: Solution | Refusal, other: Solution | Refusal) -> bool:
    return isinstance(one, Solution) and isinstance(other, Solution) and one.is_near(other)


def _worth(fit: Fit) -> tuple[bool, float]:
    """Order solutions before refusals, small residuals first."""
    residual_rad = fit.result.residual_rad
    return isinstance(fit.result, Refusal), math.inf if residual_rad is None else residual_rad
