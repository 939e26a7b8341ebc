"""Probability of each referent of a word, the choice to act or ask, and the times of words.

A gesture's arm arrives near its word, mostly a little before it (Levelt, Richardson and La Heij 1985), and
the recogniser dates the word with an error of its own. So each stay of the arm belongs to the word with a
probability by its times (`stays`), and none of them with the rest. For each stay a target has the density of
people's aim without feedback around its outline, as in method `estimate`. What was not seen speaks for and
against nothing.

No word ends after it has arrived. Arrivals tell nothing of a clock that is behind, as recognisers are slow.
But arms arrive about their words: the median time between them tells of clocks in both directions.
"""

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Environment,
    Message,
    Referent,
    Referents,
    RobotState,
    Speech,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.person import Deictic, ReferentKind
from pointit.services.listener.stays import PointingMemory, Stay, TimingModel, chances, stays_of

M = TypeVar("M", bound=Message)

SURE = 0.85
"""Probability from which what is most probable is taken as meant."""
ASKED = 0.25
"""Probability from which a candidate is asked about."""
EACH = 0.5
"""Probability from which one of `these` is taken as meant: each is, or is not, whatever the others are."""
EITHER = 0.6
"""Probability of two candidates together from which the person is asked which one is meant."""
REACTION_S = 0.3
"""Time from seeing the light of a candidate to the answer to it, s."""
MAX_REPORT_AGE_S = 3.0
"""Time after the last list of a tracker, or report of a robot, after which what it told is gone, s."""
CHEST_M = 1.2
"""Height of a person's middle, m."""
PERSON_M = (0.5, 0.5, 1.2)
"""Extent of a person who is pointed at, m."""
MAX_TARGETS = 2000
"""Limit of targets that are considered."""
ROBOT_TRACKER = "robot."
"""Beginning of the names of trackers that list one robot, which reports its state, too."""

USUAL_WAY_RAD = math.radians(39.0)
"""Way of the arm from which `sideways_rad` holds; for a shorter one it is less in proportion."""
BENT_ARM_FACTOR = 2.5
FIELD_SR = math.radians(80.0) * math.radians(50.0)
"""Solid angle over which rays spread that are meant for none of the targets."""
MAX_CANDIDATES = 8
"""Largest number of candidates of a reply, and four times as many of `these`."""
MIN_PROBABILITY = 0.005
"""Least probability of a candidate of a reply."""
SWEPT = 0.3
"""The same of `these`: a ray that swept between two of them does not count for both."""
OF_PLACES: dict[Deictic, float] = {"": 0.25, "this": 0.1, "that": 0.1, "here": 0.9, "there": 0.98}
"""Share of places and directions in what is not one of the targets."""
NEARER = 0.7
"""Exponent of the distance by which `this` prefers what is near, and `that` what is far."""
BY_DISTANCE: dict[Deictic, float] = {"this": -NEARER, "these": -NEARER, "here": -NEARER, "that": NEARER}
OWN_PLACE = 0.5
"""Probability before the rays that `here` is the speaker's own place, if no target is meant."""
NO_RAYS = "no rays at that time: the person did not point, or is not localized"

MAX_AHEAD_S = 0.3
"""Time by which words may end after they arrive, s."""
UTTERANCES = 5
"""Number of utterances whose arrival decides."""
WORDS = 24
"""Number of deictic words whose gestures decide."""
TYPICAL_S = -0.2
"""Median time from a word to the arrival of the arm, s, with a clock that is right. It scatters by 0.08 s, of
simulated people (docs/decisions/finished-experiments.md)."""
EARLIEST_S = -0.42
"""Least median of a clock that is not named, s: of simulated ones that are right less than 1 of 60 is named,
of those that are 0.5 s off 9 of 10."""
LATEST_S = 0.03
"""Largest median of a clock that is not named, s."""
REMEDY = "synchronize it, or send the site's time"
WINDOW_S = 1.5
"""Time about a word in which its gesture is searched, s: wider than for its meaning."""
CLOCK_MODEL = TimingModel(lag_sigma_s=0.8, held=0.0)
"""Times of gestures about words of an unknown clock."""


class Decision(NamedTuple):
    """Next step for a word: act, ask which one is meant, or refuse."""

    do: Literal["act", "ask", "refuse"]
    candidates: Sequence[Referent]
    """The referents, or those to ask about, the most probable first. Empty if refused.

    Their probabilities are those among what fits.
    """


def decide(
    found: Referents,
    kinds: Sequence[str] = (),
    names: Collection[str] | None = None,
    *,
    several: bool = False,
) -> Decision:
    """Return the next step for a word with these referents.

    Only `kinds` fit, or any if empty, and only `names`, or any if None. Candidates that do not fit are
    excluded by what was said, and the others become more probable, but not more than they are beside `none`.
    A word that may mean `several` has independent candidates: it acts on each by itself, and never asks.
    """
    kept = [one for one in found.candidates if not kinds or one.kind in kinds]
    fitting = [one for one in kept if names is None or one.name in names]
    if several:
        certain = [one for one in fitting if one.probability >= EACH]
        return Decision("act" if certain else "refuse", certain)
    total = found.none + sum(one.probability for one in fitting)
    if not fitting or total <= 0.0:
        return Decision("refuse", ())
    chances = [min(one.probability / total, 1.0) for one in fitting]
    fitting = [
        one.model_copy(update={"probability": chance}) for one, chance in zip(fitting, chances, strict=True)
    ]
    if chances[0] >= SURE:
        return Decision("act", fitting[:1])
    if chances[0] < ASKED or sum(chances[:2]) < EITHER:
        return Decision("refuse", ())
    return Decision("ask", fitting[: 2 if len(chances) > 1 and chances[1] >= (1.0 - SURE) / 2.0 else 1])


@dataclass(frozen=True, kw_only=True)
class ReferentTarget:
    """Something in the room that a word may refer to, at one time."""

    kind: ReferentKind
    name: str
    center_m: Vec3
    size_m: Vec3
    """Extent: the larger one of the floor twice, then upwards."""


@dataclass
class Room:
    """The newest that is known of the room."""

    things: frozenset[str] = frozenset()
    objects: dict[str, TrackedObjects] = field(default_factory=dict[str, TrackedObjects])
    robots: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    poses: dict[str, UserPose] = field(default_factory=dict[str, UserPose])

    def on_map(self, environment: Environment) -> None:
        """Update the names of things."""
        self.things = frozenset(thing.id for thing in environment.things)

    def on_absence(self, user: str) -> None:
        """Forget a person who has left."""
        self.poses.pop(user, None)

    def targets(self, user: str, at_ns: int, now_ns: int) -> list[ReferentTarget]:
        """Return the targets for words of `user`, at their positions at `at_ns`, extrapolated by velocity."""
        targets = [*self._objects(at_ns, now_ns), *self._robots(at_ns, now_ns)]
        targets += [
            ReferentTarget(
                kind="person", name=name, center_m=_raised(pose.position_m, CHEST_M), size_m=PERSON_M
            )
            for name, pose in self.poses.items()
            if name != user
        ]
        return targets[:MAX_TARGETS]

    def _objects(self, at_ns: int, now_ns: int) -> list[ReferentTarget]:
        targets: list[ReferentTarget] = []
        for tracker, listed in _recent(self.objects, now_ns).items():
            if tracker.startswith(ROBOT_TRACKER) and tracker.removeprefix(ROBOT_TRACKER) in self.robots:
                continue
            for one in listed.objects:
                wide_m = max(one.size_m[:2]) if one.size_m else one.length_m
                high_m = one.size_m[2] if one.size_m else 0.0
                passed_s = (at_ns - listed.stamp_ns) / NS_PER_S
                targets.append(
                    ReferentTarget(
                        kind="thing" if one.id in self.things else "object",
                        name=one.id,
                        center_m=vector.add(one.position_m, vector.scale(one.velocity_mps, passed_s)),
                        size_m=(wide_m, wide_m, high_m),
                    )
                )
        return targets

    def _robots(self, at_ns: int, now_ns: int) -> list[ReferentTarget]:
        targets: list[ReferentTarget] = []
        for name, state in _recent(self.robots, now_ns).items():
            passed_s = (at_ns - state.stamp_ns) / NS_PER_S
            center_m = vector.add(state.position_m, vector.scale(state.velocity_mps, passed_s))
            wide_m = 2.0 * state.radius_m
            targets.append(
                ReferentTarget(kind="robot", name=name, center_m=center_m, size_m=(wide_m, wide_m, wide_m))
            )
        return targets


def _recent(messages: Mapping[str, M], now_ns: int) -> dict[str, M]:
    return {
        name: each
        for name, each in messages.items()
        if abs(now_ns - each.stamp_ns) <= MAX_REPORT_AGE_S * NS_PER_S
    }


def _raised(place_m: Vec3, by_m: float) -> Vec3:
    return place_m[0], place_m[1], place_m[2] + by_m


@dataclass(frozen=True, kw_only=True)
class ReferentModel(TimingModel):
    """Constants, fitted on other people than those of `docs/decisions/finished-experiments.md`."""

    sideways_rad: float = math.radians(4.2)
    """Standard deviation of people's aim sideways after a usual way of the arm (pointing.md §3)."""
    pose_rad: float = math.radians(1.5)
    """Standard deviation of what does not grow with the way, sideways."""
    upwards_rad: float = math.radians(3.9)
    """Standard deviation upwards, mostly between people."""
    low_rad: float = math.radians(3.0)
    """Mean by which people point lower than what they mean."""
    bent_arm_share: float = 0.02
    """Share of gestures with a bent arm and the like, which are less exact by `BENT_ARM_FACTOR`."""
    any_target: float = 0.8
    """Probability before the rays that one of the targets is meant."""


MODEL = ReferentModel()


@dataclass(frozen=True, kw_only=True)
class Spoken:
    """A deictic word and who said it."""

    at_ns: int
    """Its middle."""
    word: Deictic = ""
    others_ns: Sequence[int] = ()
    """Middles of the other deictic words of the sentence."""
    within_s: float = 1.0
    """Time before and after the words in which rays count."""
    user: str = ""
    own_m: Vec3 | None = None
    """Place of the speaker, or None if unknown."""
    yaw_sigma_rad: float = 0.0
    """Uncertainty of the direction of their rays, as after the yaw of the wrist has drifted."""

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return the first and last time of rays that count."""
        within_ns = round(self.within_s * NS_PER_S)
        times_ns = (self.at_ns, *(() if self.word == "these" else self.others_ns))
        return min(times_ns) - within_ns, max(times_ns) + within_ns


def referents(
    cursors: Sequence[Cursor], targets: Sequence[ReferentTarget], spoken: Spoken, model: ReferentModel = MODEL
) -> Referents:
    """Return the candidates for a word, with their probabilities.

    Args:
        cursors: rays of its span, in the order of their times, each with origin and direction in {W}.
        targets: what the person may mean, where it is at that time.
        spoken: the word.
        model: constants.
    """
    if not cursors:
        return _without_rays(spoken)
    origins = np.array([cursor.origin_m for cursor in cursors], dtype=np.float64)
    directions = np.array([cursor.direction for cursor in cursors], dtype=np.float64)
    times_s = np.array([(cursor.stamp_ns - spoken.at_ns) / NS_PER_S for cursor in cursors])
    if spoken.word == "these":
        return _swept(targets, _densities(origins, directions, targets, model), model)
    stays = stays_of(times_s, directions, model)
    words_s = sorted((0.0, *((each - spoken.at_ns) / NS_PER_S for each in spoken.others_ns)))
    shares = np.array(chances(stays, words_s, words_s.index(0.0), model))
    means = [slice(stay.first, stay.last + 1) for stay in stays]
    sights = np.array([directions[each].mean(axis=0) for each in means])
    ways = np.minimum(np.array([stay.way_rad for stay in stays]) / USUAL_WAY_RAD, 1.0)
    sideways = np.hypot(math.hypot(model.pose_rad, spoken.yaw_sigma_rad), model.sideways_rad * ways)
    at = np.array([origins[each].mean(axis=0) for each in means])
    flat = 1.0 / FIELD_SR
    unseen = 1.0 - float(shares.sum())
    likelihoods = _densities(at, sights, targets, model, sideways) @ shares + unseen * flat
    priors = _priors(targets, origins, spoken.word) * model.any_target
    weights = priors * likelihoods
    rest = (1.0 - float(priors.sum())) * flat
    own = rest * OWN_PLACE if spoken.word == "here" and spoken.own_m is not None else 0.0
    total = float(weights.sum()) + rest
    candidates = [
        Referent(kind=one.kind, name=one.name, probability=min(float(w) / total, 1.0), place_m=one.center_m)
        for one, w in zip(targets, weights, strict=True)
    ]
    best = int(np.argmax(shares))
    if shares[best] > 0.0:
        share = (rest - own) * OF_PLACES[spoken.word] * float(shares[best]) / total
        candidates.append(_place(cursors, stays[best], share))
    if own and spoken.own_m is not None:
        candidates.append(
            Referent(kind="place", name=spoken.user, probability=own / total, place_m=spoken.own_m)
        )
    return _ranked(candidates, len(cursors))


def _without_rays(spoken: Spoken) -> Referents:
    if spoken.word != "here" or spoken.own_m is None:
        return Referents(message=NO_RAYS)
    own = Referent(kind="place", name=spoken.user, probability=OWN_PLACE, place_m=spoken.own_m)
    return Referents(candidates=(own,), none=1.0 - OWN_PLACE, message=NO_RAYS)


def _ranked(candidates: list[Referent], rays: int) -> Referents:
    candidates.sort(key=lambda one: -one.probability)
    kept = tuple(one for one in candidates[:MAX_CANDIDATES] if one.probability >= MIN_PROBABILITY)
    none = 1.0 - math.fsum(one.probability for one in kept)
    return Referents(candidates=kept, none=min(max(none, 0.0), 1.0), rays=rays)


def _densities(
    origins: Array,
    directions: Array,
    targets: Sequence[ReferentTarget],
    model: ReferentModel,
    sideways_rad: Array | None = None,
) -> Array:
    """Return the density of each ray if each target is meant, shape (targets, rays), 1/sr."""
    if not targets:
        return np.zeros((0, len(origins)))
    sideways = np.full(len(origins), model.sideways_rad) if sideways_rad is None else sideways_rad
    reach = np.array([one.center_m for one in targets])[:, None, :] - origins[None, :, :]
    flat_m = np.hypot(reach[..., 0], reach[..., 1])
    range_m = np.maximum(np.hypot(flat_m, reach[..., 2]), 0.05)
    sizes = np.array([one.size_m for one in targets])
    wide = np.arctan(sizes[:, 0, None] / 2.0 / range_m)
    high = np.arctan(sizes[:, 2, None] / 2.0 / range_m)
    elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1]))
    turn = np.arctan2(reach[..., 1], reach[..., 0]) - np.arctan2(directions[:, 1], directions[:, 0])
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    right = np.maximum(np.abs(turn) * np.cos(elevation) - wide, 0.0) / sideways
    up = np.arctan2(reach[..., 2], flat_m) - elevation - model.low_rad
    up = np.maximum(np.abs(up) - high, 0.0) / model.upwards_rad
    root = math.sqrt(2.0 * math.pi)
    squares = right**2 + up**2
    exact = np.exp(-0.5 * squares) / (2.0 * wide + root * sideways) / (2.0 * high + root * model.upwards_rad)
    spread = root * BENT_ARM_FACTOR
    inexact = np.exp(-0.5 * squares / BENT_ARM_FACTOR**2) / (2.0 * wide + spread * sideways)
    inexact = inexact / (2.0 * high + spread * model.upwards_rad)
    densities: Array = (1.0 - model.bent_arm_share) * exact + model.bent_arm_share * inexact
    return densities


def _priors(targets: Sequence[ReferentTarget], origins: Array, word: Deictic) -> Array:
    """Return the share of each target before the rays. They add up to 1."""
    if not targets:
        return np.zeros(0)
    ranges_m = np.linalg.norm(np.array([one.center_m for one in targets]) - origins.mean(axis=0), axis=1)
    weights: Array = np.maximum(ranges_m, 0.3) ** BY_DISTANCE.get(word, 0.0)
    shares: Array = weights / weights.sum()
    return shares


def _place(cursors: Sequence[Cursor], stay: Stay, probability: float) -> Referent:
    """Return the place on a surface where the arm stayed, or the mere direction."""
    here = cursors[(stay.first + stay.last) // 2]
    points_m = [
        cursor.point_m
        for cursor in cursors[stay.first : stay.last + 1]
        if cursor.point_m is not None and _surface(cursor) == _surface(here)
    ]
    if here.point_m is None or not points_m:
        return Referent(kind="direction", name="", probability=probability)
    x, y, z = np.array(points_m).mean(axis=0).tolist()
    return Referent(kind="place", name=here.surface_id, probability=probability, place_m=(x, y, z))


def _surface(cursor: Cursor) -> tuple[str, str, str]:
    return cursor.surface, cursor.solid, cursor.surface_id


def _swept(targets: Sequence[ReferentTarget], densities: Array, model: ReferentModel) -> Referents:
    """Return all that the rays swept over, each with the probability that it is among what is meant."""
    rays = densities.shape[1]
    if not targets:
        return Referents(rays=rays)
    weights = model.any_target / len(targets) * densities
    nearest = (weights / (weights.sum(axis=0) + (1.0 - model.any_target) / FIELD_SR)).max(axis=1)
    candidates = [
        Referent(kind=one.kind, name=one.name, probability=float(chance), place_m=one.center_m)
        for one, chance in zip(targets, nearest, strict=True)
        if chance >= SWEPT
    ]
    candidates.sort(key=lambda one: -one.probability)
    none = math.prod(1.0 - one.probability for one in candidates)
    return Referents(candidates=tuple(candidates[: 4 * MAX_CANDIDATES]), none=none, rays=rays)


class RecogniserClock:
    """Compares times of words with their arrival and with gestures."""

    def __init__(self) -> None:
        self._ahead_s = deque[float](maxlen=UTTERANCES)
        self._lags_s = deque[float](maxlen=WORDS)
        self._asked = deque[Spoken](maxlen=WORDS)
        """Words whose gestures may still come."""

    def on_speech(self, speech: Speech, now_ns: int) -> None:
        """Compare with the arrival of `speech`."""
        if speech.words and speech.is_final:
            self._ahead_s.append((speech.words[-1].end_ns - now_ns) / NS_PER_S)

    def on_word(self, spoken: Spoken) -> None:
        """Note a word that is asked about; it is looked at later."""
        if spoken.word not in ("", "these") and all(each.at_ns != spoken.at_ns for each in self._asked):
            self._asked.append(spoken)

    def compare(self, memory: PointingMemory, now_ns: int) -> bool:
        """Compare words with gestures that are complete by now. Return True if there was any."""
        window_ns = round(WINDOW_S * NS_PER_S)
        has_compared = False
        while self._asked:
            spoken = self._asked[0]
            times_ns = (spoken.at_ns, *spoken.others_ns)
            if max(times_ns) + window_ns > now_ns:
                break
            self._asked.popleft()
            cursors = memory.between(min(times_ns) - window_ns, max(times_ns) + window_ns)
            if not cursors:
                continue
            times_s = np.array([(each.stamp_ns - spoken.at_ns) / NS_PER_S for each in cursors])
            directions = np.array([each.direction for each in cursors], dtype=np.float64)
            stays = stays_of(times_s, directions, CLOCK_MODEL)
            words_s = sorted((each - spoken.at_ns) / NS_PER_S for each in times_ns)
            shares = chances(stays, words_s, words_s.index(0.0), CLOCK_MODEL)
            begin_s = stays[int(np.argmax(shares))].begin_s
            if max(shares) > 0.0 and math.isfinite(begin_s):
                self._lags_s.append(begin_s)
                has_compared = True
        return has_compared

    @property
    def problem(self) -> str:
        """Return a sentence on the recogniser's clock, or `""` if it may be right."""
        ahead_s = max(self._ahead_s, default=0.0)
        if ahead_s > MAX_AHEAD_S:
            return f"words end {ahead_s:.1f} s after they arrive: the recogniser's clock is ahead; {REMEDY}"
        lag_s = median(self._lags_s) if len(self._lags_s) == WORDS else TYPICAL_S
        if EARLIEST_S <= lag_s <= LATEST_S:
            return ""
        which, side = ("later", "behind") if lag_s > LATEST_S else ("earlier", "ahead")
        off = f"arms arrive about {abs(lag_s - TYPICAL_S):.1f} s {which} about words than they should"
        return f"{off}: the recogniser's clock is {side}, or it dates words wrongly; {REMEDY}"
