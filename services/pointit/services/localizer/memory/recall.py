"""Solver with the memory of the person as its prior, which may be wrong; pure."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pointit.schemas import Gaussian, LearntPointing
from pointit.services.localizer.estimation import estimator
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, SolverSettings
from pointit.services.localizer.memory.learning import bias, recalled

WRONG = 0.05
"""Probability that a memory is wrong: somebody else has the device, or it has slipped."""

TELLING = 1e-6
"""Least share of a prior's information that rays must add to tell anything about it."""


@dataclass(frozen=True, kw_only=True)
class RecalledSettings(SolverSettings):
    """Settings whose priors are a person's."""

    people: SolverSettings
    """The settings of people in general."""

    def forgotten(self) -> SolverSettings:
        """Return these settings with the priors of people in general."""
        return SolverSettings(**_values(self, bias(self.people)))


def recall(trust: SolverSettings, learnt: LearntPointing | None, now_ns: int) -> SolverSettings:
    """Return `trust` with what is remembered of the person as its priors."""
    if learnt is None:
        return trust
    return RecalledSettings(**_values(trust, recalled(learnt, trust, now_ns)), people=trust)


def solve(
    pointings: Pointings, trust: SolverSettings, *, floor_m: float = 0.0, start: Solution | None = None
) -> Solution | Refusal:
    """Return the result of `estimator.solve`, with a memory as the prior as far as the rays agree with it.

    The covariance, and the sigma of the bias, have both poses, with and without the memory, by their
    probabilities: a wrong memory must neither shift nor refuse a pose, nor make it look certain.
    """
    if not isinstance(trust, RecalledSettings):
        return estimator.solve(pointings, trust, floor_m=floor_m, start=start)
    forgotten = trust.forgotten()
    known = estimator.solve(pointings, trust, floor_m=floor_m, start=start)
    general = estimator.solve(pointings, forgotten.unlimited(), floor_m=floor_m, start=start)
    if isinstance(known, Solution) and isinstance(general, Solution):
        both = _combined(known, general, _wrong(trust, forgotten, general))
        if trust.accepts(both):
            return both
    return estimator.solve(pointings, forgotten, floor_m=floor_m, start=start)


def _values(settings: SolverSettings, prior: Gaussian) -> dict[str, Any]:
    values = {field.name: getattr(settings, field.name) for field in fields(SolverSettings)}
    values.update(bias_rad=prior.mean, bias_sigma_rad=prior.sigma)
    return values


def _wrong(trust: SolverSettings, forgotten: SolverSettings, general: Solution) -> float:
    """Return the probability that the memory is wrong, by Bayes' rule, from the pose without it."""
    odds = WRONG / (1.0 - WRONG) * _evidence_ratio(bias(trust), bias(forgotten), bias(general))
    return odds / (1.0 + odds)


def _evidence_ratio(memory: Gaussian, people: Gaussian, posterior: Gaussian) -> float:
    """Return the likelihood ratio of `people` to `memory`; `posterior` is that with `people` as its prior."""
    told = posterior.sigma**-2 - people.sigma**-2  # information of the rays alone
    if told < TELLING * people.sigma**-2:
        return 1.0
    mean = (posterior.mean / posterior.sigma**2 - people.mean / people.sigma**2) / told
    seen = Gaussian(mean=mean, sigma=told**-0.5)
    return math.exp(_log_evidence(people, seen) - _log_evidence(memory, seen))


def _log_evidence(prior: Gaussian, seen: Gaussian) -> float:
    variance = prior.sigma**2 + seen.sigma**2
    return -0.5 * (math.log(variance) + (seen.mean - prior.mean) ** 2 / variance)


def _combined(known: Solution, general: Solution, wrong: float) -> Solution:
    """Return the likelier pose with the uncertainty of both; `general` is right with probability `wrong`."""
    best, other, share = (known, general, wrong) if wrong < 0.5 else (general, known, 1.0 - wrong)
    off = np.array([other.x_m - best.x_m, other.y_m - best.y_m, 0.0])
    off[2] = math.remainder(other.yaw_rad - best.yaw_rad, math.tau)
    spread = (1.0 - share) * best.covariance + share * (other.covariance + np.outer(off, off))
    apart = other.bias_rad - best.bias_rad
    bias_variance = (1.0 - share) * best.bias_sigma_rad**2 + share * (other.bias_sigma_rad**2 + apart**2)
    return replace(best, covariance=spread, bias_sigma_rad=math.sqrt(bias_variance))
