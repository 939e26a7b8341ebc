"""Reaches for things in rooms: how often the right one fires, a wrong one, or none, and how soon."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, Hover, SelectionEvent, Strip, Thing
from pointit.services.pui.surfaces import Surfaces
from pointit.services.pui.tracked_objects import PERIOD_S, TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.user_sim.body import OpenLoopError
from pointit.services.user_sim.config import AimConfig, ArmConfig

Vector = NDArray[np.float64]
MissKind = Literal["strip", "nothing"]

RATE_HZ = 50.0
LOST_S = 0.9
"""Time without any light after which a person tries beside."""
SEARCH_DEG = ((0, 5), (0, -5), (5, 0), (-5, 0), (0, 10), (0, -10))
"""Directions in which a person searches, right and up."""
SEARCH_RAD = tuple((math.radians(right), math.radians(up)) for right, up in SEARCH_DEG)
HALFWAY = 0.6
"""Share of the way from the thing that is shown to the one that is meant by which a person corrects."""
POSE_RAD = (math.radians(1.5), math.radians(0.7))
"""Standard deviation of the error of the pose at the eyes: sideways by yaw and place, upwards by place."""
EYES_M: Vec3 = (0.0, 0.0, 1.64)
LIMIT_S = 8.0
"""Time after which a reach counts as nothing."""
PERSON = "person"
MISS_KINDS: tuple[MissKind, ...] = get_args(MissKind)
HOLDS_S: dict[MissKind, tuple[float, float]] = {"strip": (2.0, 6.0), "nothing": (1.0, 4.0)}
"""Times for which people hold what is no thing."""
BESIDE_RAD = math.radians(20.0)
"""Angle from the middle of every thing beyond which a point is nothing: people err by up to 10 degrees."""
START_NS = 1_000 * NS_PER_S


class ArmReach:
    """Azimuth and elevation of the ray of one person, who begins somewhere and reaches for a target."""

    def __init__(
        self,
        eyes_m: Vec3,
        targets_m: dict[str, Vec3],
        goal: str,
        rng: np.random.Generator,
        begin: "ArmReach | None" = None,
        *,
        bias_deg: float | None = None,
    ) -> None:
        """Begin where the reach `begin` ended, or with the arm low somewhere before the person.

        `bias_deg` is the person's mean elevation error, random if None.
        """
        self._rng = rng
        self._aim = AimConfig(elevation_bias_deg=bias_deg)
        self._arm = ArmConfig()
        if begin is None:
            self.errors = OpenLoopError(self._aim, 0.0, rng)
        else:
            self.errors = begin.errors
        self._pose = np.array([rng.normal(0.0, sigma) for sigma in POSE_RAD])
        self._at = {name: angles(vector.subtract(at_m, eyes_m)) for name, at_m in targets_m.items()}
        self._goal = goal
        self._corrected = np.zeros(2)

        # how still this person holds the arm
        usual_hold = np.radians([self._arm.hold_yaw_sd_deg, self._arm.hold_pitch_sd_deg])
        stillness = math.exp(rng.normal(0.0, self._arm.hold_spread))
        self._hold = usual_hold * stillness
        self._noise = np.zeros(2)
        self._tries = 0

        # where it starts: drawn even if not needed, so that all else stays the same
        low = np.radians([rng.uniform(-30.0, 30.0), rng.uniform(-40.0, -20.0)])
        self.now: Vector = low if begin is None else begin.now
        self.took_s = self._reach_s()
        self._move(0.0, self.took_s)
        self._look_s = self.took_s + self._aim.reaction_s
        self._lit_s = self._look_s
        self._shown: list[tuple[float, str | None]] = []

    def _reach_s(self) -> float:
        """Return the duration of the reach by Fitts' law with the scatter of people, and draw its error."""
        amplitude = float(np.linalg.norm(self._at[self._goal] - self.now))
        self.errors.draw(amplitude)
        width_rad = math.radians(self._arm.reach_width_deg)
        difficulty_bits = math.log2(amplitude / width_rad + 1.0)
        usual_s = self._arm.reach_base_s + self._arm.reach_per_bit_s * difficulty_bits
        spread = math.exp(self._rng.normal(0.0, self._arm.reach_spread))
        return usual_s * (spread * self._arm.reach_with_cursor)

    @property
    def rest(self) -> Vector:
        """Return the azimuth and elevation to which the arm moves, rad."""
        return self._to

    def see(self, time_s: float, shown: str | None) -> None:
        """Note the thing whose light shows that it is pointed at."""
        self._shown.append((time_s, shown))

    def direction(self, time_s: float) -> Vec3:
        """Return the unit direction of the ray at `time_s`."""
        share = (time_s - self._from_s) / self._took_s
        share = min(max(share, 0.0), 1.0)
        done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # least jerk

        # an arm that is held wanders: a first-order autoregression
        keep = math.exp(-1.0 / RATE_HZ / self._arm.hold_correlation_s)
        step = self._hold * math.sqrt(1.0 - keep * keep)
        self._noise = keep * self._noise + step * self._rng.standard_normal(2)
        course = self._from + (self._to - self._from) * done
        self.now = course + self._noise
        azimuth, elevation = self.now.tolist()
        return vector.direction(azimuth, elevation)

    def correct(self, time_s: float) -> None:
        """Move on if the light that was seen a moment ago is not that of the goal."""
        if time_s < self._look_s:
            return
        # what they see is a moment old, and must stay for half a period
        seen_s = time_s - self._aim.visual_delay_s
        seen = [shown for at_s, shown in self._shown if at_s <= seen_s]
        steady_count = round(self._aim.correction_period_s * RATE_HZ / 2)
        steady = seen[-steady_count:]
        shown = steady[-1] if steady else None
        if shown == self._goal:
            self._lit_s = time_s
        elif shown is None:
            if time_s - self._lit_s > LOST_S:
                self._search(time_s)
        elif steady.count(shown) == len(steady):
            spread = 1.0 + self._aim.correction_spread * float(self._rng.standard_normal())
            offset = self._at[self._goal] - self._at[shown]
            self._corrected += HALFWAY * spread * offset
            self._again(time_s)

    def _search(self, time_s: float) -> None:
        """Move beside the last aim, for this one time."""
        beside_rad = SEARCH_RAD[self._tries % len(SEARCH_RAD)]
        self._tries += 1
        self._corrected += beside_rad
        self._again(time_s)
        self._corrected -= beside_rad

    def _again(self, time_s: float) -> None:
        self._move(time_s, self._aim.correction_s)
        self._look_s = time_s + self._aim.correction_s + self._aim.correction_period_s
        self._lit_s = self._look_s

    def _move(self, time_s: float, took_s: float) -> None:
        self._from = self.now - self._noise
        self._from_s = time_s
        self._took_s = took_s
        aim = self._at[self._goal] + self.errors.now_rad
        self._to: Vector = aim + self._pose + self._corrected


def angles(sight: Vec3) -> Vector:
    """Return azimuth and elevation, rad."""
    return np.array([vector.azimuth(sight), vector.elevation(sight)])


@dataclass(frozen=True, kw_only=True)
class ThingRow:
    """Boxes in a row before a person."""

    name: str
    count: int
    size_m: float
    apart_m: float
    away_m: float
    height_m: float = 1.4
    lit: bool = True
    bias_deg: float | None = None
    """Mean elevation error of all people, e.g. 0 with calibrated offsets. Each has their own if None."""

    def environment(self) -> Environment:
        """Return the map."""
        middle = (self.count - 1) / 2.0
        size_m = (self.size_m, self.size_m, self.size_m)
        things: list[Thing] = []
        for index in range(self.count):
            name = f"t{index}"
            beside_m = (index - middle) * self.apart_m
            center_m = (self.away_m, beside_m, self.height_m)
            lamp = name if self.lit else ""
            things.append(Thing(id=name, center_m=center_m, size_m=size_m, lamp=lamp))
        return Environment(stamp_ns=0, name=self.name, things=tuple(things))


def _rows() -> tuple[ThingRow, ...]:
    """Return large boxes and small ones, each with and without light, and people who are calibrated."""
    large = ThingRow(
        name=".4 m boxes .7 m apart, 2.6 m away, light", count=4, size_m=0.4, apart_m=0.7, away_m=2.6
    )
    small = ThingRow(
        name=".15 m boxes .2 m apart, 1.5 m away, light", count=5, size_m=0.15, apart_m=0.2, away_m=1.5
    )
    large_unlit = replace(large, name=".4 m boxes .7 m apart, 2.6 m away, no light", lit=False)
    small_unlit = replace(small, name=".15 m boxes .2 m apart, 1.5 m away, no light", lit=False)
    calibrated = replace(large_unlit, name=f"{large_unlit.name}, offset calibrated", bias_deg=0.0)
    return large, large_unlit, small, small_unlit, calibrated


ROWS = _rows()


@dataclass(frozen=True)
class ReachResult:
    """End of one reach."""

    end: Literal["right", "wrong", "nothing"]
    took_s: float
    confidence: float | None


@dataclass(frozen=True)
class Share:
    """Share of the reaches that ended in one way, with its 95 % interval (Wilson)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        """Return the share."""
        return self.count / self.of

    @property
    def interval(self) -> tuple[float, float]:
        """Return the bounds of the interval."""
        bounds = binomtest(self.count, self.of).proportion_ci(method="wilson")
        return float(bounds.low), float(bounds.high)


@dataclass(frozen=True, kw_only=True)
class ReachRow:
    """All reaches of a row."""

    name: str
    right: Share
    wrong: Share
    nothing: Share
    median_s: float
    p90_s: float
    stated: float
    """Mean probability stated of what fired."""


def row_of(row: ThingRow, results: Sequence[ReachResult]) -> ReachRow:
    """Return the shares of reaches at which the right thing fired, a wrong one or none."""
    ends = Counter(result.end for result in results)
    took_s = [result.took_s for result in results if result.end == "right"]
    confidences = [result.confidence for result in results if result.confidence is not None]
    # without any, NaN and no warning of numpy
    took_s = took_s or [math.nan]
    confidences = confidences or [math.nan]
    count = len(results)
    return ReachRow(
        name=row.name,
        right=Share(ends["right"], count),
        wrong=Share(ends["wrong"], count),
        nothing=Share(ends["nothing"], count),
        median_s=float(np.median(took_s)),
        p90_s=float(np.percentile(took_s, 90)),
        stated=float(np.mean(confidences)),
    )


def reaches(config: SelectorConfig, piece: tuple[ThingRow, int, int]) -> list[ReachResult]:
    """Return the results of one person each, for `count` seeds from the first on."""
    row, first, count = piece
    seeds = range(first, first + count)
    return [reach(row, config, seed) for seed in seeds]


def reach(row: ThingRow, config: SelectorConfig, seed: int) -> ReachResult:
    """Return the result of one person's reach for one thing of `row`."""
    rng = np.random.default_rng([seed, row.count])
    environment = row.environment()
    # drawn before anything else of this person
    index, person = begin(row, rng)
    goal = environment.things[index].id
    engine = SelectionEngine(config, lambda _record: None)
    engine.on_map(environment)
    listed_s = -math.inf
    for time_s in _times():
        now_ns = START_NS + round(time_s * NS_PER_S)
        if time_s - listed_s >= PERIOD_S:
            engine.on_objects(TRACKER, listing(environment, now_ns))
            listed_s = time_s
        if row.lit:
            person.correct(time_s)
        cursor = Cursor(stamp_ns=now_ns, origin_m=EYES_M, direction=person.direction(time_s))
        for output in engine.on_cursor(PERSON, cursor):
            message = output.message
            if isinstance(message, Hover):
                person.see(time_s, message.object_id or None)
            elif isinstance(message, SelectionEvent) and message.event == "selected":
                if message.object_id == goal:
                    return ReachResult("right", time_s, message.confidence)
                return ReachResult("wrong", time_s, message.confidence)
    return ReachResult("nothing", LIMIT_S, None)


def begin(row: ThingRow, rng: np.random.Generator) -> tuple[int, ArmReach]:
    """Return the index of the thing that a person means, and their reach for it."""
    places_m = {thing.id: thing.center_m for thing in row.environment().things}
    index = int(rng.integers(row.count))
    goal = list(places_m)[index]
    return index, ArmReach(EYES_M, places_m, goal, rng, bias_deg=row.bias_deg)


def wrong_selections(config: SelectorConfig, piece: tuple[MissKind, int, float]) -> int:
    """Return the number of firings for a person who points elsewhere: at a strip below, or at nothing.

    They move away from things that light up, as those do who see a wrong one.
    """
    kind, seed, minutes = piece
    rng = np.random.default_rng([seed, 7])
    row = ROWS[0]
    ends_m = ((row.away_m, 1.5, 0.9), (row.away_m, -1.5, 0.9))
    strip = Strip(id="below", line_m=ends_m, pixels=180)
    environment = row.environment().model_copy(update={"strips": (strip,)})
    surfaces = Surfaces(environment)
    engine = SelectionEngine(config, lambda _record: None)
    engine.on_map(environment)
    places_m = {thing.id: thing.center_m for thing in environment.things}

    # one reach after the other, for points that are no things
    fired = 0
    begun_s = 0.0
    listed_s = -math.inf
    reach = None
    while begun_s < minutes * 60.0:
        targets_m = {**places_m, "point": _miss_point(kind, row, rng)}
        reach = ArmReach(EYES_M, targets_m, "point", rng, reach)
        hold_s = float(rng.uniform(*HOLDS_S[kind]))
        samples = round((reach.took_s + hold_s) * RATE_HZ)
        for index in range(samples):
            reach_s = index / RATE_HZ
            time_s = begun_s + reach_s
            now_ns = START_NS + round(time_s * NS_PER_S)
            if time_s - listed_s >= PERIOD_S:
                engine.on_objects(TRACKER, listing(environment, now_ns))
                listed_s = time_s
                engine.tick(now_ns)
            reach.correct(reach_s)
            cursor = _cursor(surfaces, reach.direction(reach_s), now_ns)
            for output in engine.on_cursor(PERSON, cursor):
                message = output.message
                if isinstance(message, Hover):
                    reach.see(reach_s, message.object_id or "point")
                elif isinstance(message, SelectionEvent):
                    fired += message.event == "selected"
        begun_s += samples / RATE_HZ
    return fired


def _miss_point(kind: MissKind, row: ThingRow, rng: np.random.Generator) -> Vec3:
    """Return a point of the strip, or one beside all things by more than people err."""
    if kind == "strip":
        beside_m = float(rng.uniform(-1.5, 1.5))
        return (row.away_m, beside_m, 0.9)
    return point_beside(row, rng)


def point_beside(row: ThingRow, rng: np.random.Generator) -> Vec3:
    """Return a point beside all things by more than people err."""
    sights = [vector.subtract(thing.center_m, EYES_M) for thing in row.environment().things]
    while True:
        azimuth = math.radians(rng.uniform(-40.0, 40.0))
        elevation = math.radians(rng.uniform(-30.0, 30.0))
        direction = vector.direction(azimuth, elevation)
        point_m = vector.add(EYES_M, vector.scale(direction, row.away_m))
        sight = vector.subtract(point_m, EYES_M)
        aside_rad = (vector.angle_between(thing, sight) for thing in sights)
        if all(angle > BESIDE_RAD for angle in aside_rad):
            return point_m


def _cursor(surfaces: Surfaces, direction: Vec3, now_ns: int) -> Cursor:
    cursor = Cursor(stamp_ns=now_ns, origin_m=EYES_M, direction=direction)
    surface_hit = surfaces.hit_test(EYES_M, direction)
    if surface_hit is None:
        return cursor
    surface, hit = surface_hit
    if surface.kind != "strip":
        return cursor
    return Cursor(
        stamp_ns=now_ns,
        surface="strip",
        surface_id=surface.id,
        point_m=hit.point_m,
        position_m=hit.position_m,
        miss_m=hit.miss_m,
        miss_rad=hit.miss_rad,
        range_m=hit.range_m,
        origin_m=EYES_M,
        direction=direction,
    )


def _times() -> Iterator[float]:
    samples = round(LIMIT_S * RATE_HZ)
    return (index / RATE_HZ for index in range(samples))
