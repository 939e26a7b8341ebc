"""Positions of lamps by pointing at them from two places, of which only the walk between them is known.

`paced_model` has the least squares. Presses can be wrong: the person meant another lamp, exchanged two,
or has hardly walked. So the length of the walk is estimated under two priors, of a walk as it was
asked for and of less than a step. A lamp without which the others fit much better is named, and so are two
lamps whose presses from one place, exchanged, fit better or as well (`exchanged_presses`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from pointit.runtime.errors import RefusedError
from pointit.scan.exchanged_presses import Exchange, find_exchanges
from pointit.scan.paced_model import (
    FIRST,
    SECOND,
    TO_THE_LEFT_RAD,
    PacedModel,
    PacedRay,
    PacedRoom,
    PacedTarget,
    Walk,
)

HARDLY_WALKED = Walk(
    length_m=0.4, length_sigma_m=0.3, azimuth_rad=TO_THE_LEFT_RAD, azimuth_sigma_rad=math.radians(60.0)
)
HARDLY_WALKED_ODDS = 0.1
"""Prior odds that somebody has hardly walked."""
MIN_WALK_M = 1.0
"""Length of the walk below which distances of lamps are not learned."""
MIN_GAIN = 18.0
"""Decrease of the sum of squares without a lamp, from which that lamp contradicts the others."""
JUDGED = 3
"""Number of lamps from which one of them can contradict the others."""
EXCHANGED_GAIN = 12.0
"""Decrease of the sum of squares with two lamps exchanged, from which they contradict each other."""
UNSURE_GAIN = -3.0
"""The same from which both are unsure."""
DO_NOT_MEET = "the presses from the two places do not meet: was it another lamp?"


@dataclass(frozen=True)
class _Fit:
    """A model of presses under a walk, with its solution and the logarithm of its evidence."""

    walk: Walk
    model: PacedModel
    solution: Any
    log_evidence: float


def locate_paced(rays: Sequence[PacedRay], walk: Walk | None = None) -> PacedRoom:
    """Return the lamps of `rays`, which are those of `paced_ray`, one or more for each lamp and place.

    Args:
        rays: presses at `FIRST`, and at `SECOND` if the person has walked there.
        walk: what is known about the walk. None: the usual one, or less than a step.

    Raises:
        RefusedError: If there is no press at the first place.
    """
    if not any(ray.place == FIRST for ray in rays):
        raise RefusedError("nobody has pointed at anything from the first place yet")
    walks = [Walk(), HARDLY_WALKED] if walk is None else [walk]
    if not any(ray.place == SECOND for ray in rays):
        del walks[1:]

    # Only the last press of each lamp at each place is judged
    last_rays = {(ray.target, ray.place): ray for ray in rays}
    judged_rays = [replace(ray, azimuth_sigma_rad=ray.judged_sigma_rad) for ray in last_rays.values()]
    judged = _fits(judged_rays, walks)[0]
    judged_room = judged.model.room(judged.solution)
    reasons = {name: target.reason for name, target in judged_room.targets.items()}
    exchanges = find_exchanges(judged_rays, judged.walk, judged.solution, judged_room)
    is_exchange_plain = bool(exchanges) and exchanges[0].gain > EXCHANGED_GAIN
    if not is_exchange_plain:
        contradicting = _contradicting(judged_rays, judged.walk, judged.solution, judged_room)
        if contradicting:
            reasons[contradicting] = DO_NOT_MEET

    # Positions and directions: each press by its own scatter, under both walks
    room = _mixed_room(_fits(rays, walks))
    for name, target in room.targets.items():
        room.targets[name] = replace(target, reason=reasons[name])
    for exchange in exchanges:
        _note_exchange(room, exchange)
    return room


def _note_exchange(room: PacedRoom, exchange: Exchange) -> None:
    for name, other in (exchange.pair, exchange.pair[::-1]):
        target = room.targets[name]
        if exchange.gain > EXCHANGED_GAIN:
            room.targets[name] = replace(target, reason=DO_NOT_MEET, other=other)
        elif exchange.gain > UNSURE_GAIN:
            room.targets[name] = replace(target, is_unsure=True, other=target.other or other)


def _fits(rays: Sequence[PacedRay], walks: Sequence[Walk]) -> list[_Fit]:
    """Return the fits of `rays` under each walk, that with the most evidence first."""
    fits: list[_Fit] = []
    for walk in walks:
        model = PacedModel(rays, walk)
        solution = model.fit()
        log_odds = math.log(HARDLY_WALKED_ODDS) if walk is HARDLY_WALKED else 0.0
        fits.append(_Fit(walk, model, solution, model.log_evidence(solution) + log_odds))
    return sorted(fits, key=lambda fit: -fit.log_evidence)


def _mixed_room(fits: Sequence[_Fit]) -> PacedRoom:
    """Return the room of the first of `fits`. Its standard deviations are those of all, by their evidence."""
    room = fits[0].model.room(fits[0].solution)
    odds = [math.exp(fit.log_evidence - fits[0].log_evidence) for fit in fits]
    shares = [each / sum(odds) for each in odds]
    rooms = [room, *(fit.model.room(fit.solution) for fit in fits[1:])]
    walk_variance = sum(
        share * (each.walk_sigma_m**2 + (each.walk_m - room.walk_m) ** 2)
        for share, each in zip(shares, rooms, strict=True)
    )
    targets: dict[str, PacedTarget] = {}
    for name, target in room.targets.items():
        variance = 0.0
        for share, each in zip(shares, rooms, strict=True):
            distance_m = math.dist(each.targets[name].position_m, target.position_m)
            variance += share * (each.targets[name].sigma_m ** 2 + distance_m**2)
        targets[name] = replace(target, sigma_m=math.sqrt(variance))
    return replace(room, targets=targets, walk_sigma_m=math.sqrt(walk_variance))


def _contradicting(rays: Sequence[PacedRay], walk: Walk, solution: Any, room: PacedRoom) -> str:
    """Return the lamp without which the others fit much better, or `""`.

    A wrong press bends the walk and the drift, so that its own residuals need not be the largest.
    """
    if len(room.places_m) < 2 or len(room.targets) < JUDGED:
        return ""
    gains: dict[str, float] = {}
    for name in room.targets:
        others = [ray for ray in rays if ray.target != name]
        if any(ray.place == SECOND for ray in others):
            without = PacedModel(others, walk).fit()
            gains[name] = 2.0 * float(solution.cost - without.cost)
    if not gains:
        return ""
    worst = max(gains, key=gains.__getitem__)
    return worst if gains[worst] > MIN_GAIN else ""
