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
SEARCH_RAD = tuple(
    (math.radians(right), math.radians(up))
    for right, up in ((0, 5), (0, -5), (5, 0), (-5, 0), (0, 10), (0, -10))
)
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
        self.errors: OpenLoopError = OpenLoopError(self._aim, 0.0, rng) if begin is None else begin.errors
        self._pose = np.array([rng.normal(0.0, sigma) for sigma in POSE_RAD])
        self._at = {name: angles(vector.subtract(at_m, eyes_m)) for name, at_m in targets_m.items()}
        self._goal = goal
        self._corrected = np.zeros(2)
        self._hold = np.radians([self._arm.hold_yaw_sd_deg, self._arm.hold_pitch_sd_deg])
        self._hold = self._hold * math.exp(rng.normal(0.0, self._arm.hold_spread))
        self._noise = np.zeros(2)
        self._tries = 0
        low = np.radians([rng.uniform(-30.0, 30.0), rng.uniform(-40.0, -20.0)])
        self.now: Vector = low if begin is None else begin.now
        amplitude = float(np.linalg.norm(self._at[goal] - self.now))
        self.errors.draw(amplitude)
        took_s = self._arm.reach_base_s + self._arm.reach_per_bit_s * math.log2(
            amplitude / math.radians(self._arm.reach_width_deg) + 1.0
        )
        took_s *= math.exp(rng.normal(0.0, self._arm.reach_spread)) * self._arm.reach_with_cursor
        self.took_s = took_s
        self._move(0.0, took_s)
        self._look_s = self._lit_s = took_s + self._aim.reaction_s
        self._shown: list[tuple[float, str | None]] = []

    @property
    def rest(self) -> Vector:
        """Return the azimuth and elevation to which the arm moves, rad."""
        return self._to

    def see(self, time_s: float, shown: str | None) -> None:
        """Note the thing whose light shows that it is pointed at."""
        self._shown.append((time_s, shown))

    def direction(self, time_s: float) -> Vec3:
        """Return the unit direction of the ray at `time_s`."""
        share = min(max((time_s - self._from_s) / self._took_s, 0.0), 1.0)
        done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # least jerk
        keep = math.exp(-1.0 / RATE_HZ / self._arm.hold_correlation_s)
        step = self._hold * math.sqrt(1.0 - keep * keep)
        self._noise = keep * self._noise + step * self._rng.standard_normal(2)
        self.now = self._from + (self._to - self._from) * done + self._noise
        return vector.direction(float(self.now[0]), float(self.now[1]))

    def correct(self, time_s: float) -> None:
        """Move on if the light that was seen a moment ago is not that of the goal."""
        if time_s < self._look_s:
            return
        seen = [shown for at_s, shown in self._shown if at_s <= time_s - self._aim.visual_delay_s]
        steady = seen[-round(self._aim.correction_period_s * RATE_HZ / 2) :]
        shown = steady[-1] if steady else None
        if shown == self._goal:
            self._lit_s = time_s
        elif shown is not None and all(each == shown for each in steady):
            spread = 1.0 + self._aim.correction_spread * float(self._rng.standard_normal())
            self._corrected += HALFWAY * spread * (self._at[self._goal] - self._at[shown])
            self._again(time_s)
        elif shown is None and time_s - self._lit_s > LOST_S:
            self._corrected += SEARCH_RAD[self._tries % len(SEARCH_RAD)]
            self._tries += 1
            self._again(time_s)
            self._corrected -= SEARCH_RAD[(self._tries - 1) % len(SEARCH_RAD)]

    def _again(self, time_s: float) -> None:
        self._move(time_s, self._aim.correction_s)
        self._look_s = self._lit_s = time_s + self._aim.correction_s + self._aim.correction_period_s

    def _move(self, time_s: float, took_s: float) -> None:
        self._from = self.now - self._noise
        self._from_s = time_s
        self._took_s = took_s
        self._to: Vector = self._at[self._goal] + self.errors.now_rad + self._pose + self._corrected


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
        return Environment(
            stamp_ns=0,
            name=self.name,
            things=tuple(
                Thing(
                    id=f"t{index}",
                    center_m=(self.away_m, (index - (self.count - 1) / 2.0) * self.apart_m, self.height_m),
                    size_m=(self.size_m, self.size_m, self.size_m),
                    lamp=f"t{index}" if self.lit else "",
                )
                for index in range(self.count)
            ),
        )


_ROWS = tuple(
    ThingRow(
        name=f"{name}, {'light' if lit else 'no light'}", lit=lit, count=count, size_m=a, apart_m=b, away_m=c
    )
    for name, count, a, b, c in (
        (".4 m boxes .7 m apart, 2.6 m away", 4, 0.4, 0.7, 2.6),
        (".15 m boxes .2 m apart, 1.5 m away", 5, 0.15, 0.2, 1.5),
    )
    for lit in (True, False)
)
ROWS = (*_ROWS, replace(_ROWS[1], name=f"{_ROWS[1].name}, offset calibrated", bias_deg=0.0))


@dataclass(frozen=True)
class Result:
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
        found = binomtest(self.count, self.of).proportion_ci(method="wilson")
        return float(found.low), float(found.high)


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


def row_of(row: ThingRow, results: Sequence[Result]) -> ReachRow:
    """Return the shares of reaches at which the right thing fired, a wrong one or none."""
    ends = Counter(result.end for result in results)
    took_s = [result.took_s for result in results if result.end == "right"] or [math.nan]
    stated = [result.confidence for result in results if result.confidence is not None] or [math.nan]
    right, wrong, nothing = (Share(ends[end], len(results)) for end in ("right", "wrong", "nothing"))
    return ReachRow(
        name=row.name,
        right=right,
        wrong=wrong,
        nothing=nothing,
        median_s=float(np.median(took_s)),
        p90_s=float(np.percentile(took_s, 90)),
        stated=float(np.mean(stated)),
    )


def reaches(config: SelectorConfig, piece: tuple[ThingRow, int, int]) -> list[Result]:
    """Return the results of one person each, for `count` seeds from the first on."""
    row, first, count = piece
    return [reach(row, config, seed) for seed in range(first, first + count)]


def reach(row: ThingRow, config: SelectorConfig, seed: int) -> Result:
    """Return the result of one person's reach for one thing of `row`."""
    rng = np.random.default_rng([seed, row.count])
    environment = row.environment()
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
            if isinstance(output.message, Hover):
                person.see(time_s, output.message.object_id or None)
            elif isinstance(output.message, SelectionEvent) and output.message.event == "selected":
                end: Literal["right", "wrong"] = "right" if output.message.object_id == goal else "wrong"
                return Result(end, time_s, output.message.confidence)
    return Result("nothing", LIMIT_S, None)


def begin(row: ThingRow, rng: np.random.Generator) -> tuple[int, ArmReach]:
    """Return the index of the thing that a person means, and their reach for it."""
    places_m = {thing.id: thing.center_m for thing in row.environment().things}
    goal = int(rng.integers(row.count))
    return goal, ArmReach(EYES_M, places_m, list(places_m)[goal], rng, bias_deg=row.bias_deg)


def wrong_selections(config: SelectorConfig, piece: tuple[MissKind, int, float]) -> int:
    """Return the number of firings for a person who points elsewhere: at a strip below, or at nothing.

    They move away from things that light up, as those do who see a wrong one.
    """
    kind, seed, minutes = piece
    rng = np.random.default_rng([seed, 7])
    row = ROWS[0]
    strip = Strip(id="below", line_m=((row.away_m, 1.5, 0.9), (row.away_m, -1.5, 0.9)), pixels=180)
    environment = row.environment().model_copy(update={"strips": (strip,)})
    surfaces = Surfaces(environment)
    engine = SelectionEngine(config, lambda _record: None)
    engine.on_map(environment)
    places_m = {thing.id: thing.center_m for thing in environment.things}
    fired = 0
    begun_s = 0.0
    listed_s = -math.inf
    reach = None
    while begun_s < minutes * 60.0:
        reach = ArmReach(EYES_M, {**places_m, "point": _miss_point(kind, row, rng)}, "point", rng, reach)
        holds_s = reach.took_s + float(rng.uniform(*HOLDS_S[kind]))
        for index in range(round(holds_s * RATE_HZ)):
            time_s = begun_s + index / RATE_HZ
            now_ns = START_NS + round(time_s * NS_PER_S)
            if time_s - listed_s >= PERIOD_S:
                engine.on_objects(TRACKER, listing(environment, now_ns))
                listed_s = time_s
                engine.tick(now_ns)
            reach.correct(index / RATE_HZ)
            for output in engine.on_cursor(
                PERSON, _cursor(surfaces, reach.direction(index / RATE_HZ), now_ns)
            ):
                if isinstance(output.message, Hover):
                    reach.see(index / RATE_HZ, output.message.object_id or "point")
                fired += isinstance(output.message, SelectionEvent) and output.message.event == "selected"
        begun_s += round(holds_s * RATE_HZ) / RATE_HZ
    return fired


def _miss_point(kind: MissKind, row: ThingRow, rng: np.random.Generator) -> Vec3:
    """Return a point of the strip, or one beside all things by more than people err."""
    if kind == "strip":
        return (row.away_m, float(rng.uniform(-1.5, 1.5)), 0.9)
    return point_beside(row, rng)


def point_beside(row: ThingRow, rng: np.random.Generator) -> Vec3:
    """Return a point beside all things by more than people err."""
    while True:
        azimuth, elevation = (math.radians(rng.uniform(-most, most)) for most in (40.0, 30.0))
        point_m = vector.add(EYES_M, vector.scale(vector.direction(azimuth, elevation), row.away_m))
        away = (vector.subtract(thing.center_m, EYES_M) for thing in row.environment().things)
        if all(vector.angle_between(reach, vector.subtract(point_m, EYES_M)) > BESIDE_RAD for reach in away):
            return point_m


def _cursor(surfaces: Surfaces, direction: Vec3, now_ns: int) -> Cursor:
    met = surfaces.hit_test(EYES_M, direction)
    if met is None or met[0].kind != "strip":
        return Cursor(stamp_ns=now_ns, origin_m=EYES_M, direction=direction)
    surface, hit = met
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
    return (index / RATE_HZ for index in range(round(LIMIT_S * RATE_HZ)))
