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
"""Minimum probability of a candidate that is taken as meant."""
ASKED = 0.25
"""Minimum probability of a candidate that is asked about."""
EACH = 0.5
"""Minimum probability of each of `these` that is taken as meant: it is or is not, whatever the others are."""
EITHER = 0.6
"""Minimum probability of two candidates together at which the person is asked which one is meant."""
REACTION_S = 0.3
"""Time from seeing the light of a candidate to the answer to it, s."""
MAX_REPORT_AGE_S = 3.0
"""Time after the last list of a tracker, or report of a robot, after which that is out of date, s."""
CHEST_M = 1.2
"""Height of a person's middle, m."""
PERSON_M = (0.5, 0.5, 1.2)
"""Extent of a person who is pointed at, m."""
MAX_TARGETS = 2000
"""Limit of targets that are considered."""
ROBOT_TRACKER = "robot."
"""Prefix of the names of trackers that list one robot, which reports its state, too."""

USUAL_WAY_RAD = math.radians(39.0)
"""Way of the arm from which `sideways_rad` holds. For a shorter one it is less in proportion."""
BENT_ARM_FACTOR = 2.5
FIELD_SR = math.radians(80.0) * math.radians(50.0)
"""Solid angle over which rays spread that are meant for none of the targets."""
MAX_CANDIDATES = 8
"""Largest number of candidates of a reply, and four times as many of `these`."""
MIN_PROBABILITY = 0.005
"""Minimum probability of a candidate of a reply."""
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
"""Smallest median of a clock that is not named, s: of simulated ones that are right less than 1 of 60 is
named, of those that are 0.5 s off 9 of 10."""
LATEST_S = 0.03
"""Largest median of a clock that is not named, s."""
REMEDY = "synchronize it, or send the site's time"
WINDOW_S = 1.5
"""Time about a word in which its gesture is searched, s: wider than for its meaning."""
CLOCK_MODEL = TimingModel(lag_sigma_s=0.8, held=0.0)
"""Times of gestures about words of an unknown clock."""


class WordDecision(NamedTuple):
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
) -> WordDecision:
    """Return the next step for a word with these referents.

    Only `kinds` fit, or any if empty, and only `names`, or any if None. Candidates that do not fit are
    excluded by what was said, and the others become more probable, but not more than they are beside `none`.
    A word that may mean `several` has independent candidates: it acts on each by itself, and never asks.
    """
    # Candidates that fit. One of several is judged by itself
    fitting = [candidate for candidate in found.candidates if _fits(candidate, kinds, names)]
    if several:
        certain = [candidate for candidate in fitting if candidate.probability >= EACH]
        return WordDecision("act" if certain else "refuse", certain)

    # Their probabilities among themselves and none
    total = found.none + sum(candidate.probability for candidate in fitting)
    if not fitting or total <= 0.0:
        return WordDecision("refuse", ())
    chances = [min(candidate.probability / total, 1.0) for candidate in fitting]
    rescaled: list[Referent] = []
    for candidate, chance in zip(fitting, chances, strict=True):
        rescaled.append(candidate.model_copy(update={"probability": chance}))

    # Act if one is sure, ask about one or two, or refuse
    if chances[0] >= SURE:
        return WordDecision("act", rescaled[:1])
    two_together = sum(chances[:2])
    if chances[0] < ASKED or two_together < EITHER:
        return WordDecision("refuse", ())
    count = 1
    min_second = (1.0 - SURE) / 2.0
    if len(chances) > 1 and chances[1] >= min_second:
        count = 2
    return WordDecision("ask", rescaled[:count])


def _fits(candidate: Referent, kinds: Sequence[str], names: Collection[str] | None) -> bool:
    """Return True if a candidate is of one of `kinds`, unless that is empty, and in `names`, unless None."""
    if kinds and candidate.kind not in kinds:
        return False
    return names is None or candidate.name in names


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
    """The latest state of the room."""

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
        targets = self._object_targets(at_ns, now_ns)
        targets += self._robot_targets(at_ns, now_ns)
        for name, pose in self.poses.items():
            if name == user:
                continue
            x, y, z = pose.position_m
            chest_m = (x, y, z + CHEST_M)
            target = ReferentTarget(kind="person", name=name, center_m=chest_m, size_m=PERSON_M)
            targets.append(target)
        return targets[:MAX_TARGETS]

    def _object_targets(self, at_ns: int, now_ns: int) -> list[ReferentTarget]:
        targets: list[ReferentTarget] = []
        for tracker, message in _recent(self.objects, now_ns).items():
            # a robot that reports its state is a target of that kind
            if tracker.startswith(ROBOT_TRACKER) and tracker.removeprefix(ROBOT_TRACKER) in self.robots:
                continue
            passed_s = (at_ns - message.stamp_ns) / NS_PER_S
            for tracked in message.objects:
                wide_m = tracked.length_m
                high_m = 0.0
                if tracked.size_m:
                    wide_m = max(tracked.size_m[:2])
                    high_m = tracked.size_m[2]
                kind: ReferentKind = "thing" if tracked.id in self.things else "object"
                center_m = _extrapolated(tracked.position_m, tracked.velocity_mps, passed_s)
                size_m = (wide_m, wide_m, high_m)
                target = ReferentTarget(kind=kind, name=tracked.id, center_m=center_m, size_m=size_m)
                targets.append(target)
        return targets

    def _robot_targets(self, at_ns: int, now_ns: int) -> list[ReferentTarget]:
        targets: list[ReferentTarget] = []
        for name, state in _recent(self.robots, now_ns).items():
            passed_s = (at_ns - state.stamp_ns) / NS_PER_S
            diameter_m = 2.0 * state.radius_m
            center_m = _extrapolated(state.position_m, state.velocity_mps, passed_s)
            size_m = (diameter_m, diameter_m, diameter_m)
            target = ReferentTarget(kind="robot", name=name, center_m=center_m, size_m=size_m)
            targets.append(target)
        return targets


def _recent(messages: Mapping[str, M], now_ns: int) -> dict[str, M]:
    """Return the messages that are not out of date."""
    max_age_ns = MAX_REPORT_AGE_S * NS_PER_S
    return {
        name: message for name, message in messages.items() if abs(now_ns - message.stamp_ns) <= max_age_ns
    }


def _extrapolated(position_m: Vec3, velocity_mps: Vec3, passed_s: float) -> Vec3:
    return vector.add(position_m, vector.scale(velocity_mps, passed_s))


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
    """Time of its middle, ns."""
    word: Deictic = ""
    others_ns: Sequence[int] = ()
    """Times of the middles of the other deictic words of the sentence, ns."""
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
        times_ns = [self.at_ns]
        if self.word != "these":  # they are swept over during their own word
            times_ns += self.others_ns
        return min(times_ns) - within_ns, max(times_ns) + within_ns


def referents(
    cursors: Sequence[Cursor], targets: Sequence[ReferentTarget], spoken: Spoken, model: ReferentModel = MODEL
) -> Referents:
    """Return the candidates for a word, with their probabilities.

    Args:
        cursors: rays of its span, in the order of their times, each with origin and direction in {W}.
        targets: what the person may mean, at its position at that time.
        spoken: the word.
        model: constants.
    """
    if not cursors:
        return _without_rays(spoken)
    origins = np.array([cursor.origin_m for cursor in cursors], dtype=np.float64)
    times_s, directions = _rays(cursors, spoken.at_ns)
    if spoken.word == "these":
        densities = _densities(origins, directions, targets, model)
        return _swept(targets, densities, model)

    # Stays of the arm, and the probability of each that it belongs to the word
    stays = stays_of(times_s, directions, model)
    others_s = [(other_ns - spoken.at_ns) / NS_PER_S for other_ns in spoken.others_ns]
    words_s = sorted([0.0, *others_s])
    which = words_s.index(0.0)
    shares = np.array(chances(stays, words_s, which, model))

    # Mean ray of each stay, less exact after a longer way of the arm
    mean_origins = np.array([stay.mean(origins) for stay in stays])
    mean_directions = np.array([stay.mean(directions) for stay in stays])
    ways_rad = np.array([stay.way_rad for stay in stays])
    ways = np.minimum(ways_rad / USUAL_WAY_RAD, 1.0)
    constant_rad = math.hypot(model.pose_rad, spoken.yaw_sigma_rad)
    sideways_rad = np.hypot(constant_rad, model.sideways_rad * ways)

    # Weight of each target, and of the rest: what was not seen speaks for nothing
    flat = 1.0 / FIELD_SR
    unseen = 1.0 - float(shares.sum())
    densities = _densities(mean_origins, mean_directions, targets, model, sideways_rad)
    likelihoods = densities @ shares + unseen * flat
    priors = _priors(targets, origins, spoken.word) * model.any_target
    weights = priors * likelihoods
    rest = (1.0 - float(priors.sum())) * flat
    total = float(weights.sum()) + rest
    candidates: list[Referent] = []
    for target, weight in zip(targets, weights, strict=True):
        probability = min(float(weight) / total, 1.0)
        candidates.append(_target_candidate(target, probability))

    # Part of the rest is a place: where the speaker is, or where they point
    own = 0.0
    if spoken.word == "here" and spoken.own_m is not None:
        own = rest * OWN_PLACE
    best = int(np.argmax(shares))
    if shares[best] > 0.0:
        weight_of_places = (rest - own) * OF_PLACES[spoken.word]
        probability = weight_of_places * float(shares[best]) / total
        candidates.append(_place(cursors, stays[best], probability))
    if own and spoken.own_m is not None:
        candidates.append(_own_place(spoken.user, spoken.own_m, own / total))
    return _ranked(candidates, len(cursors))


def _rays(cursors: Sequence[Cursor], at_ns: int) -> tuple[Array, Array]:
    """Return times since `at_ns`, s, and directions (n x 3) of rays."""
    times_s = [(cursor.stamp_ns - at_ns) / NS_PER_S for cursor in cursors]
    directions = [cursor.direction for cursor in cursors]
    return np.array(times_s), np.array(directions, dtype=np.float64)


def _own_place(user: str, place_m: Vec3, probability: float) -> Referent:
    return Referent(kind="place", name=user, probability=probability, place_m=place_m)


def _target_candidate(target: ReferentTarget, probability: float) -> Referent:
    return Referent(kind=target.kind, name=target.name, probability=probability, place_m=target.center_m)


def _without_rays(spoken: Spoken) -> Referents:
    """Return the speaker's own place if the word may mean it, else no candidates."""
    if spoken.word != "here" or spoken.own_m is None:
        return Referents(message=NO_RAYS)
    own = _own_place(spoken.user, spoken.own_m, OWN_PLACE)
    return Referents(candidates=(own,), none=1.0 - OWN_PLACE, message=NO_RAYS)


def _ranked(candidates: list[Referent], rays: int) -> Referents:
    """Return the most probable candidates of a word. `rays`: number of rays."""
    candidates.sort(key=lambda candidate: -candidate.probability)
    most_probable: list[Referent] = []
    for candidate in candidates[:MAX_CANDIDATES]:
        if candidate.probability >= MIN_PROBABILITY:
            most_probable.append(candidate)
    none = 1.0 - math.fsum(candidate.probability for candidate in most_probable)
    none = min(max(none, 0.0), 1.0)  # beyond by a rounding error at most
    return Referents(candidates=tuple(most_probable), none=none, rays=rays)


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
    sideways = sideways_rad
    if sideways is None:
        sideways = np.full(len(origins), model.sideways_rad)

    # Targets as seen from the eyes: centre, and half width and height
    centers_m = np.array([target.center_m for target in targets])
    reach = centers_m[:, None, :] - origins[None, :, :]
    x = reach[..., 0]
    y = reach[..., 1]
    z = reach[..., 2]
    flat_m = np.hypot(x, y)
    range_m = np.maximum(np.hypot(flat_m, z), 0.05)
    sizes = np.array([target.size_m for target in targets])
    halves_m = sizes[:, :, None] / 2.0
    wide = np.arctan(halves_m[:, 0] / range_m)
    high = np.arctan(halves_m[:, 2] / range_m)

    # Angles from the ray to their outline, in standard deviations
    u, v, w = directions.T
    azimuth = np.arctan2(v, u)
    elevation = np.arctan2(w, np.hypot(u, v))
    turn = np.arctan2(y, x) - azimuth
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    right = np.abs(turn) * np.cos(elevation)
    right = np.maximum(right - wide, 0.0) / sideways
    up = np.arctan2(z, flat_m) - elevation - model.low_rad
    up = np.maximum(np.abs(up) - high, 0.0) / model.upwards_rad
    squares = right**2 + up**2

    # Flat on the target, normal around it. Some gestures are less exact
    root = math.sqrt(2.0 * math.pi)
    effective_width = 2.0 * wide + root * sideways
    effective_height = 2.0 * high + root * model.upwards_rad
    exact = np.exp(-0.5 * squares) / effective_width / effective_height
    spread = root * BENT_ARM_FACTOR
    effective_width = 2.0 * wide + spread * sideways
    effective_height = 2.0 * high + spread * model.upwards_rad
    bent_arm = np.exp(-0.5 * squares / BENT_ARM_FACTOR**2)
    inexact = bent_arm / effective_width / effective_height
    share = model.bent_arm_share
    densities: Array = (1.0 - share) * exact + share * inexact
    return densities


def _priors(targets: Sequence[ReferentTarget], origins: Array, word: Deictic) -> Array:
    """Return the share of each target before the rays. They add up to 1."""
    if not targets:
        return np.zeros(0)
    centers_m = np.array([target.center_m for target in targets])
    ranges_m = np.linalg.norm(centers_m - origins.mean(axis=0), axis=1)
    exponent = BY_DISTANCE.get(word, 0.0)
    weights: Array = np.maximum(ranges_m, 0.3) ** exponent
    shares: Array = weights / weights.sum()
    return shares


def _place(cursors: Sequence[Cursor], stay: Stay, probability: float) -> Referent:
    """Return the place on a surface where the arm stayed, or the mere direction."""
    middle = cursors[(stay.first + stay.last) // 2]
    points_m: list[Vec3] = []
    for cursor in cursors[stay.first : stay.last + 1]:
        if cursor.point_m is not None and _surface(cursor) == _surface(middle):
            points_m.append(cursor.point_m)
    if middle.point_m is None or not points_m:
        return Referent(kind="direction", name="", probability=probability)
    mean_m = np.array(points_m).mean(axis=0)
    x, y, z = mean_m.tolist()
    return Referent(kind="place", name=middle.surface_id, probability=probability, place_m=(x, y, z))


def _surface(cursor: Cursor) -> tuple[str, str, str]:
    """Return the key of the surface that a cursor is on."""
    return cursor.surface, cursor.solid, cursor.surface_id


def _swept(targets: Sequence[ReferentTarget], densities: Array, model: ReferentModel) -> Referents:
    """Return all targets that the rays swept over, each with the probability that it is one of `these`."""
    rays = densities.shape[1]
    if not targets:
        return Referents(rays=rays)

    # Probability of each target by the ray that was nearest to it
    weights = model.any_target / len(targets) * densities
    none_weight = (1.0 - model.any_target) / FIELD_SR
    probabilities = weights / (weights.sum(axis=0) + none_weight)
    candidates: list[Referent] = []
    for target, probability in zip(targets, probabilities.max(axis=1), strict=True):
        if probability >= SWEPT:
            candidates.append(_target_candidate(target, float(probability)))
    candidates.sort(key=lambda candidate: -candidate.probability)
    none = math.prod(1.0 - candidate.probability for candidate in candidates)
    most_probable = candidates[: 4 * MAX_CANDIDATES]
    return Referents(candidates=tuple(most_probable), none=none, rays=rays)


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
            last_word = speech.words[-1]
            self._ahead_s.append((last_word.end_ns - now_ns) / NS_PER_S)

    def on_word(self, spoken: Spoken) -> None:
        """Note a word that is asked about. `compare` uses it later."""
        if spoken.word in ("", "these"):
            return
        is_known = any(asked.at_ns == spoken.at_ns for asked in self._asked)
        if not is_known:
            self._asked.append(spoken)

    def compare(self, memory: PointingMemory, now_ns: int) -> bool:
        """Compare words with gestures that are complete by now. Return True if there was any."""
        window_ns = round(WINDOW_S * NS_PER_S)
        has_compared = False
        while self._asked:
            spoken = self._asked[0]
            times_ns = (spoken.at_ns, *spoken.others_ns)
            first_ns = min(times_ns) - window_ns
            last_ns = max(times_ns) + window_ns
            if last_ns > now_ns:
                break
            self._asked.popleft()
            cursors = memory.between(first_ns, last_ns)
            if not cursors:
                continue

            # The stay that most probably belongs to the word, if its beginning was seen
            times_s, directions = _rays(cursors, spoken.at_ns)
            stays = stays_of(times_s, directions, CLOCK_MODEL)
            words_s = sorted((word_ns - spoken.at_ns) / NS_PER_S for word_ns in times_ns)
            shares = chances(stays, words_s, words_s.index(0.0), CLOCK_MODEL)
            best = stays[int(np.argmax(shares))]
            if max(shares) > 0.0 and math.isfinite(best.begin_s):
                self._lags_s.append(best.begin_s)
                has_compared = True
        return has_compared

    @property
    def problem(self) -> str:
        """Return a sentence on the recogniser's clock, or `""` if it may be right."""
        ahead_s = max(self._ahead_s, default=0.0)
        if ahead_s > MAX_AHEAD_S:
            return f"words end {ahead_s:.1f} s after they arrive: the recogniser's clock is ahead; {REMEDY}"
        if len(self._lags_s) < WORDS:  # too few to judge
            return ""
        lag_s = median(self._lags_s)
        if EARLIEST_S <= lag_s <= LATEST_S:
            return ""
        order = "earlier"
        clock_error = "ahead"
        if lag_s > LATEST_S:
            order = "later"
            clock_error = "behind"
        error_s = abs(lag_s - TYPICAL_S)
        symptom = f"arms arrive about {error_s:.1f} s {order} about words than they should"
        return f"{symptom}: the recogniser's clock is {clock_error}, or it dates words wrongly; {REMEDY}"
