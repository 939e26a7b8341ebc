"""Probability of each thing, robot, person or place that a word may refer to.

The apex of a gesture comes near its word, mostly a little before it (Levelt, Richardson and La Heij 1985),
and the recogniser dates the word with an error of its own. So the apex is one of the rays around the word,
with a probability by its time and by how slowly the arm moves then: staying counts more than passing. For
each such ray a target has the density of people's aim without feedback around its outline, as in method
`estimate`. What no ray shows, since it is missing or the arm was moving, speaks for and against nothing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Referent, Referents
from pointit.schemas.person import Deictic
from pointit.services.listener.surroundings import Target

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ReferentModel:
    """Constants of the model, fitted on other simulated people than `pointit evaluate referents` reports."""

    lag_s: float = -0.1
    """Mean time from the middle of the word to the apex; negative: the apex is earlier."""
    lag_sigma_s: float = 0.35
    """Standard deviation of that, of people (0.3) and recognisers (0.2)."""
    slow_radps: float = math.radians(25.0)
    """Angular speed at which a ray counts half."""
    sideways_rad: float = math.radians(3.5)
    """Standard deviation of people's aim without feedback, sideways."""
    upwards_rad: float = math.radians(3.5)
    low_rad: float = math.radians(1.5)
    """Mean by which people point lower than what they mean."""
    any_target: float = 0.75
    """Probability before the rays that one of the targets is meant."""
    field_sr: float = math.radians(80.0) * math.radians(50.0)
    """Solid angle over which rays spread that are meant for none of the targets."""


MODEL = ReferentModel()
LISTED = 8
"""Number of candidates of a reply, at most."""
LEAST = 0.005
"""Least probability of a candidate of a reply."""
STEP_S = 0.1
"""Longest time for which a ray stands."""
OF_PLACES: dict[Deictic, float] = {
    "": 0.25,
    "this": 0.1,
    "that": 0.1,
    "here": 0.6,
    "there": 0.6,
    "these": 0.1,
}
"""Share of places and directions in what is not one of the targets."""
NEARER = 0.7
"""Exponent of the distance by which `this` prefers what is near, and `that` what is far."""
BY_NEARNESS: dict[Deictic, float] = {"this": -NEARER, "these": -NEARER, "here": -NEARER, "that": NEARER}
OWN_PLACE = 0.5
"""Probability before the rays that `here` is the speaker's own place."""
AROUND_S = 0.25
"""Half the time about the apex over which the place of a cursor is averaged, s."""


def referents(
    cursors: Sequence[Cursor],
    targets: Sequence[Target],
    at_ns: int,
    *,
    word: Deictic = "",
    others_ns: Sequence[int] = (),
    own_m: Vec3 | None = None,
    user: str = "",
    model: ReferentModel = MODEL,
) -> Referents:
    """Return what a word spoken at `at_ns` may refer to.

    Args:
        cursors: rays about the word, in the order of their times, each with origin and direction in {W}.
        targets: that the person may mean.
        at_ns: middle of the word.
        word: that was spoken.
        others_ns: middles of the other deictic words: each ray counts for the word that is nearest in time.
        own_m: place of the speaker, to which `here` may refer.
        user: the speaker.
        model: constants.
    """
    if not cursors:
        own = () if word != "here" or own_m is None else (_own(user, own_m, OWN_PLACE),)
        return Referents(candidates=own, none=1.0 - sum(one.probability for one in own), message=NO_RAYS)
    origins = np.array([cursor.origin_m for cursor in cursors], dtype=np.float64)
    directions = np.array([cursor.direction for cursor in cursors], dtype=np.float64)
    times_s = np.array([(cursor.stamp_ns - at_ns) / NS_PER_S for cursor in cursors])
    apex = _apex_weights(times_s, directions, [(each - at_ns) / NS_PER_S for each in others_ns], model)
    unseen = max(0.0, 1.0 - float(apex.sum()))
    flat = 1.0 / model.field_sr
    densities = _densities(origins, directions, targets, model)  # (targets, rays), 1/sr
    if word == "these":
        return _swept(targets, densities, apex, flat, model)
    likelihoods = densities @ apex + unseen * flat
    priors = _priors(targets, origins, word) * model.any_target
    weights = priors * likelihoods
    rest = (1.0 - float(priors.sum())) * flat
    own = rest * OWN_PLACE if word == "here" and own_m is not None else 0.0
    rest -= own
    on_place, place = _place(cursors, times_s, apex)
    places = (rest * OF_PLACES[word]) * on_place
    total = float(weights.sum()) + rest + own
    found = [
        Referent(kind=one.kind, name=one.name, probability=min(float(w) / total, 1.0), place_m=one.center_m)
        for one, w in zip(targets, weights, strict=True)
    ]
    if place is not None:
        found.append(place.model_copy(update={"probability": places / total}))
    if own_m is not None and own:
        found.append(_own(user, own_m, own / total))
    return _sorted(found, len(cursors))


NO_RAYS = "no rays at that time: the person did not point, or is not localized"


def _own(user: str, own_m: Vec3, probability: float) -> Referent:
    return Referent(kind="place", name=user, probability=probability, place_m=own_m)


def _sorted(found: list[Referent], rays: int) -> Referents:
    found.sort(key=lambda one: -one.probability)
    kept = tuple(one for one in found[:LISTED] if one.probability >= LEAST)
    none = max(0.0, 1.0 - math.fsum(one.probability for one in kept))
    return Referents(candidates=kept, none=min(none, 1.0), rays=rays)


def _apex_weights(
    times_s: Floats, directions: Floats, others_s: Sequence[float], model: ReferentModel
) -> Floats:
    """Return the probability of each ray to be the apex; the rest to 1 is that none of them is."""
    after_s = np.clip(np.diff(times_s, append=times_s[-1] + 0.02), 0.0, STEP_S)
    own = _lag_density(times_s, model)
    weights = own * after_s
    if others_s:
        among = own + sum(_lag_density(times_s - other_s, model) for other_s in others_s)
        weights = weights * own / np.maximum(among, 1e-12)
    speeds = _speeds(times_s, directions)
    slowness = 1.0 / (1.0 + (speeds / model.slow_radps) ** 2)
    weights = weights * slowness
    seen: Floats = weights / max(float(weights.sum()), 1.0)
    return seen


def _lag_density(times_s: Floats, model: ReferentModel) -> Floats:
    z = (times_s - model.lag_s) / model.lag_sigma_s
    density: Floats = np.exp(-0.5 * z * z) / (model.lag_sigma_s * math.sqrt(2.0 * math.pi))
    return density


def _speeds(times_s: Floats, directions: Floats) -> Floats:
    """Return the angular speed at each ray over about 0.1 s on both sides, rad/s."""
    first = np.maximum(np.searchsorted(times_s, times_s - 0.1), 0)
    last = np.minimum(np.searchsorted(times_s, times_s + 0.1, side="right") - 1, len(times_s) - 1)
    chords = np.linalg.norm(directions[last] - directions[first], axis=1)
    angles: Floats = 2.0 * np.arcsin(np.clip(chords / 2.0, 0.0, 1.0))
    speeds: Floats = angles / np.maximum(times_s[last] - times_s[first], 0.02)
    return speeds


def _densities(
    origins: Floats, directions: Floats, targets: Sequence[Target], model: ReferentModel
) -> Floats:
    """Return the density of each ray if each target is meant, shape (targets, rays), 1/sr."""
    if not targets:
        return np.zeros((0, len(origins)))
    reach = np.array([one.center_m for one in targets])[:, None, :] - origins[None, :, :]
    flat_m = np.hypot(reach[..., 0], reach[..., 1])
    range_m = np.maximum(np.hypot(flat_m, reach[..., 2]), 0.05)
    sizes = np.array([one.size_m for one in targets])
    wide = np.arctan(sizes[:, 0, None] / 2.0 / range_m)
    high = np.arctan(sizes[:, 2, None] / 2.0 / range_m)
    elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1]))
    turn = np.arctan2(reach[..., 1], reach[..., 0]) - np.arctan2(directions[:, 1], directions[:, 0])
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    right = np.maximum(np.abs(turn) * np.cos(elevation) - wide, 0.0)
    up = np.arctan2(reach[..., 2], flat_m) - elevation - model.low_rad
    up = np.maximum(np.abs(up) - high, 0.0)
    root = math.sqrt(2.0 * math.pi)
    area = (2.0 * wide + root * model.sideways_rad) * (2.0 * high + root * model.upwards_rad)
    exponents = -0.5 * ((right / model.sideways_rad) ** 2 + (up / model.upwards_rad) ** 2)
    found: Floats = np.exp(exponents) / area
    return found


def _priors(targets: Sequence[Target], origins: Floats, word: Deictic) -> Floats:
    """Return the share of each target before the rays. They add up to 1."""
    if not targets:
        return np.zeros(0)
    ranges_m = np.linalg.norm(np.array([one.center_m for one in targets]) - origins.mean(axis=0), axis=1)
    weights: Floats = np.maximum(ranges_m, 0.3) ** BY_NEARNESS.get(word, 0.0)
    shares: Floats = weights / weights.sum()
    return shares


def _place(cursors: Sequence[Cursor], times_s: Floats, apex: Floats) -> tuple[float, Referent | None]:
    """Return the share of the apex that is known, and the place or direction there."""
    seen = float(apex.sum())
    if seen <= 0.0:
        return 0.0, None
    near = np.abs(times_s[:, None] - times_s[None, :]) <= AROUND_S
    middle = int(np.argmax(near @ apex))
    here = cursors[middle]
    points_m: list[Vec3] = []
    weights: list[float] = []
    for cursor, is_near, weight in zip(cursors, near[middle].tolist(), apex.tolist(), strict=True):
        if is_near and weight > 0.0 and cursor.point_m is not None and _is_same(cursor, here):
            points_m.append(cursor.point_m)
            weights.append(weight)
    if here.point_m is None or not points_m:
        return seen, Referent(kind="direction", name="", probability=0.0)
    x, y, z = np.average(np.array(points_m), axis=0, weights=weights).tolist()
    return seen, Referent(kind="place", name=here.surface_id, probability=0.0, place_m=(x, y, z))


def _is_same(one: Cursor, other: Cursor) -> bool:
    return (one.surface, one.solid, one.surface_id) == (other.surface, other.solid, other.surface_id)


def _swept(
    targets: Sequence[Target], densities: Floats, apex: Floats, flat: float, model: ReferentModel
) -> Referents:
    """Return all that the rays swept over, each with the probability that it is among what is meant."""
    if not targets:
        return Referents(rays=len(apex))
    prior = model.any_target / len(targets)
    one_of = prior * densities
    shares = one_of / (one_of.sum(axis=0) + (1.0 - model.any_target) * flat)
    times = np.minimum(apex / max(float(apex.max()), 1e-12), 1.0) ** 0.25  # far from the word counts little
    chances = (shares * times).max(axis=1)
    found = [
        Referent(kind=one.kind, name=one.name, probability=float(chance), place_m=one.center_m)
        for one, chance in zip(targets, chances, strict=True)
    ]
    found.sort(key=lambda one: -one.probability)
    kept = tuple(one for one in found if one.probability >= 0.25)[: 4 * LISTED]
    none = math.prod(1.0 - one.probability for one in kept)
    return Referents(candidates=kept, none=none, rays=len(apex))
