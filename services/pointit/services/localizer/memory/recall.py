"""Solver with the memory of the person as its prior; without it where the rays contradict it. Pure."""

from dataclasses import dataclass, fields

from pointit.schemas import LearntPointing
from pointit.services.localizer.estimation import estimator
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, SolverSettings
from pointit.services.localizer.memory.learning import QUANTITIES, contradicts, gaussian, recalled


@dataclass(frozen=True, kw_only=True)
class RecalledSettings(SolverSettings):
    """Settings whose priors are a person's."""

    people: SolverSettings
    """The settings of people in general."""

    def contradicted(self, found: Solution) -> bool:
        """Return True if `found` is too far from what was expected of the person."""
        return any(contradicts(gaussian(each, self), gaussian(each, found)) for each in QUANTITIES)

    def forgotten(self) -> SolverSettings:
        """Return these settings with the priors of people in general."""
        values = {field.name: getattr(self, field.name) for field in fields(SolverSettings)}
        for each in QUANTITIES:
            values |= {name: getattr(self.people, name) for name in (each.name, each.sigma_name)}
        return SolverSettings(**values)


def recall(trust: SolverSettings, learnt: LearntPointing | None, now_ns: int) -> SolverSettings:
    """Return `trust` with what is remembered of the person as its priors."""
    if learnt is None:
        return trust
    values = {field.name: getattr(trust, field.name) for field in fields(SolverSettings)}
    for each in QUANTITIES:
        prior = recalled(each, learnt, trust, now_ns)
        values |= {each.name: prior.mean, each.sigma_name: prior.sigma}
    return RecalledSettings(**values, people=trust)


def solve(
    pointings: Pointings, trust: SolverSettings, *, floor_m: float = 0.0, start: Solution | None = None
) -> Solution | Refusal:
    """Return the result of `estimator.solve`; if it contradicts a memory, that without the memory.

    A wrong memory, as of a band that has slipped, must neither shift nor refuse a pose.
    """
    found = estimator.solve(pointings, trust, floor_m=floor_m, start=start)
    if not isinstance(trust, RecalledSettings):
        return found
    if isinstance(found, Solution) and not trust.contradicted(found):
        return found
    return estimator.solve(pointings, trust.forgotten(), floor_m=floor_m, start=start)
