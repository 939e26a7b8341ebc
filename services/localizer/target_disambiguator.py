"""Choice of the robot that is followed, by the fits of the rays to each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pointit.runtime.config.parameters import set_option
from pointit.services.localizer.estimation.estimator import Refusal, Solution

MEANT = 0.9
"""Probability from which a robot is chosen; below it the choice is ambiguous."""

SWITCH_AFTER = 2
"""Number of consecutive solutions in which another robot must reach that probability."""


@dataclass(frozen=True)
class RobotFit:
    """Fit of the rays to one robot."""

    object_id: str
    result: Solution | Refusal
    probability: float = 0.0
    """Probability of this robot among all."""


def rank_by_posterior(
    results: Sequence[tuple[str, Solution | Refusal]], independent: float, ray_sigma_rad: float
) -> list[RobotFit]:
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
    residuals_rad = [result.residual_rad for _, result in results]
    least_rad = min((residual for residual in residuals_rad if residual is not None), default=0.0)
    variance = max(ray_sigma_rad**2, 0.5 * least_rad**2)

    # Likelihoods relative to the best, which keeps the exponents small
    likelihoods: list[float] = []
    for residual_rad in residuals_rad:
        if residual_rad is None:
            likelihoods.append(0.0)
            continue
        excess = residual_rad**2 - least_rad**2
        likelihoods.append(math.exp(-0.5 * independent * excess / variance))

    total = math.fsum(likelihoods)
    fits: list[RobotFit] = []
    for (object_id, result), likelihood in zip(results, likelihoods, strict=True):
        probability = likelihood / total if total else 0.0
        fits.append(RobotFit(object_id, result, probability))
    return sorted(fits, key=_fit_order)


class TargetDisambiguator:
    """Chooses a robot, and keeps the choice until another robot is clearly meant."""

    def __init__(self, object_id: str = "") -> None:
        """Start without a choice; `object_id` is the robot to name meanwhile."""
        self.object_id = object_id
        """The chosen robot, or the one that fits best while the choice is ambiguous."""
        self._decided = False
        self._streak = 0

    def choose(self, fits: Sequence[RobotFit]) -> Solution | Refusal:
        """Return the result for the chosen of `fits`, the best first, or a refusal if that is ambiguous."""
        best = fits[0]
        current = next((fit for fit in fits if fit.object_id == self.object_id), None)
        if not self._decided or current is None:
            return self._choose_anew(fits)
        if current is best or _are_near(current.result, best.result):
            self._streak = 0
            return current.result
        if best.probability <= current.probability:  # it fits, but cannot be solved just now
            return current.result

        # Another robot fits better. It must do so clearly, and several times in a row.
        share = best.probability / (best.probability + current.probability)
        self._streak = self._streak + 1 if share >= MEANT else 0
        if self._streak < SWITCH_AFTER:
            return _undecided(current.object_id, best)
        return self._choose_anew(fits)

    def _choose_anew(self, fits: Sequence[RobotFit]) -> Solution | Refusal:
        """Choose a robot; robots that give the same pose count as one."""
        best = fits[0]
        self.object_id = best.object_id
        self._decided = False
        self._streak = 0
        if isinstance(best.result, Refusal):
            return best.result
        others = [fit for fit in fits[1:] if not _are_near(best.result, fit.result)]
        others_probability = math.fsum(fit.probability for fit in others)
        if others and others_probability > 1.0 - MEANT:
            likeliest_other = max(others, key=lambda fit: fit.probability)
            return _undecided(best.object_id, likeliest_other)
        self._decided = True
        return best.result


def _undecided(object_id: str, other: RobotFit) -> Refusal:
    return Refusal(
        f"two robots move alike, {object_id} and {other.object_id}: make one of them move differently, "
        f"or name one by {set_option('localizer', 'robot_id', object_id)}",
        other.result.residual_rad,
    )


def _are_near(result: Solution | Refusal, other: Solution | Refusal) -> bool:
    if isinstance(result, Refusal) or isinstance(other, Refusal):
        return False
    return result.is_near(other)


def _fit_order(fit: RobotFit) -> tuple[bool, float]:
    """Sort key: solutions before refusals, small residuals first."""
    residual_rad = fit.result.residual_rad
    if residual_rad is None:
        residual_rad = math.inf
    return isinstance(fit.result, Refusal), residual_rad
