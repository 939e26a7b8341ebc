"""Systematic errors of a person's pointing, from one localization to the next; pure.

A Kalman filter of their elevation bias. Between two localizations it changes by what changes between the
sessions of a person, and slowly decays to what is known of people in general (Ornstein-Uhlenbeck). The
posterior of a localization that had the memory as its prior is the new memory: nothing counts twice.

A poor localization must teach nothing, and a wrong one must not be averaged: only a well-determined bias
counts, and a contradiction widens the memory, so that the next localizations decide.
"""

import math

from pointit.schemas import NS_PER_S, Gaussian, LearntPointing
from pointit.services.localizer.estimation.solution import Solution, SolverSettings

DECAY_S = 60 * 86_400.0
"""Time in which the deviation of a person from people in general decays to 1/e: two months."""

WELL_DETERMINED = 0.25
"""Posterior sigma, as a share of that of people in general, up to which it is learnt. The bias of
recorded people who follow a robot has 0.3 to 0.6 after 3 s, below 0.25 after 5 s, 0.1 to 0.2 after 10 s."""

CONTRADICTION = 2.0
"""Number of sigmas beyond which a localization contradicts the memory, which then teaches nothing new."""


SESSION_SIGMA_RAD = math.radians(2.0)
"""Standard deviation of the bias from one session of a person to the next, so the least sigma of a memory."""


def recalled(learnt: LearntPointing, trust: SolverSettings, now_ns: int) -> Gaussian:
    """Return mean and sigma of the bias to be expected now, never surer than `SESSION_SIGMA_RAD`."""
    people = bias(trust)
    aged = _aged(learnt, people, now_ns)
    sigma = people.sigma if aged is None else math.hypot(aged.sigma, SESSION_SIGMA_RAD)
    return people if aged is None or sigma >= people.sigma else Gaussian(mean=aged.mean, sigma=sigma)


def learn(
    learnt: LearntPointing | None, found: Solution, trust: SolverSettings, mounting: str, now_ns: int
) -> LearntPointing | None:
    """Return the memory after a localization, of which it was the prior, or None if nothing is known."""
    before, after = _aged(learnt, bias(trust), now_ns), _learnt(learnt, found, trust, now_ns)
    if after == before:
        return learnt
    if after is None:
        return None
    count = 0 if learnt is None else learnt.localizations
    return LearntPointing(
        mounting=mounting, elevation_bias_rad=after, localizations=count + 1, learnt_ns=now_ns
    )


def contradicts(prior: Gaussian, posterior: Gaussian) -> bool:
    """Return True if what was found is too far from what was expected.

    The step of a Kalman filter from prior to posterior has the variance by which the prior's falls. A
    posterior that is less certain than the prior had another one.
    """
    variance = abs(prior.sigma**2 - posterior.sigma**2)
    return (posterior.mean - prior.mean) ** 2 > CONTRADICTION**2 * max(variance, 1e-12)


def bias(source: Solution | SolverSettings) -> Gaussian:
    """Return the elevation bias that a solution has found or settings expect."""
    return Gaussian(mean=source.bias_rad, sigma=source.bias_sigma_rad)


def _learnt(
    learnt: LearntPointing | None, found: Solution, trust: SolverSettings, now_ns: int
) -> Gaussian | None:
    people, posterior = bias(trust), bias(found)
    aged = _aged(learnt, people, now_ns)
    if learnt is not None and aged is not None:
        prior = recalled(learnt, trust, now_ns)
        if contradicts(prior, posterior):
            sigma = math.hypot(prior.sigma, posterior.mean - prior.mean)
            return Gaussian(mean=prior.mean, sigma=sigma) if sigma < people.sigma else None
    return posterior if posterior.sigma <= WELL_DETERMINED * people.sigma else aged


def _aged(learnt: LearntPointing | None, people: Gaussian, now_ns: int) -> Gaussian | None:
    """Return the memory as it has decayed until now, or None if there is none."""
    before = None if learnt is None else learnt.elevation_bias_rad
    if learnt is None or before is None or before.sigma >= people.sigma:
        return None
    left = math.exp(-max(now_ns - learnt.learnt_ns, 0) / NS_PER_S / DECAY_S)
    variance = people.sigma**2 + left**2 * (before.sigma**2 - people.sigma**2)
    return Gaussian(mean=people.mean + left * (before.mean - people.mean), sigma=math.sqrt(variance))
