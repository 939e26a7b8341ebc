"""Method `estimate`: the probability that each object near the ray is meant, or none of them.

People miss what they point at by some degrees, and correct that only where they see what reacts. So an object
is shown from the first guess on; that a person stays although another one is shown would be seen as an error
of theirs, so staying makes the object that is shown more probable. It fires when it is sure, after the dwell.
"""

import math
from collections.abc import Collection
from functools import lru_cache

from pydantic import Field

from pointit.geometry import vector
from pointit.geometry.polyline import nearest_in_angle
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor
from pointit.schemas.pointing import LINES
from pointit.services.selector.methods.announcer import AnnounceConfig, Announcer
from pointit.services.selector.methods.gauge import SPEED_WINDOW_S, RaySpeedEstimator
from pointit.services.selector.seen_objects import View, VisibleObject
from pointit.services.selector.selection_methods import (
    MethodConfig,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
)

_Angles = tuple[float, float, float, float]
"""Angles from a ray to an object, rad: right and up to its nearest point, 0 if the ray is on it, and to its
centre."""
_Sight = tuple[float, float]
"""Azimuth and elevation, rad."""

SIDEWAYS_RAD = math.radians(3.5)
"""Standard deviation of people's aim without feedback, sideways (pointing.md §3)."""
UPWARDS_RAD = math.radians(3.5)
"""The same upwards: between people 2.8 degrees, within a person 1.0, and their pose."""
LOW_RAD = math.radians(1.5)
"""People point lower than what they mean; half of their mean error, since offsets may be calibrated."""
ATTENTION = 0.2
"""Probability of each object near the ray before the ray is known."""
UNIFORM_DENSITY = 0.25 / (math.radians(80.0) * math.radians(50.0))
"""Probability density of a ray that is meant for nothing, 1/rad²."""
ON_LIGHT = 0.1 / math.radians(60.0)
"""The same along a strip or belt, across which a ray misses as beside an object, 1/rad."""
RESTING_PER_S = 1.0
"""Rate at which a steady arm speaks against pointing at nothing, nats/s, up to `RESTING`."""
RESTING = 1.5
SEEN_AFTER_S = 0.45
"""Time from light to hand: a person who sees that the wrong object is shown has begun to correct that."""
SEEN_PER_S = 2.5
"""Rate at which staying speaks for the object whose light shows that it is pointed at, nats/s."""
SEEN = 1.5
"""Limit of that: who points far beside what is shown may not look at it."""
SPOKEN_AFTER_S = 1.0
"""As `SEEN_AFTER_S`, for a name: to hear and understand it takes 0.7 s, the arm follows after 0.1 s."""
SPOKEN = 3.0
"""As `SEEN`, for a name, which tells what the light of a neighbour does not."""
SMOOTHING_S = 0.12
"""Time constant of the angles to objects, which averages tremor out."""
FAST_RADPS = math.radians(40.0)
"""Speed above which nothing is shown."""
MOVED = 0.3
"""Share of the way to the next object by which an arm moves when it corrects: staying begins again."""
MAX_MOVED_RAD = math.radians(5.0)
"""The same without another object near; restless arms wander by less."""
SHOWN = 0.25
"""Probability from which an object is shown."""
MIN_SHARE = 0.7
"""Share of the most probable one's probability above which the object that is shown is kept."""
SPOKEN_SHOWN = 0.12
"""As `SHOWN`, where names are spoken: a hover that flickers cuts them off."""
MIN_SPOKEN_SHARE = 0.4
"""As `MIN_SHARE`, where names are spoken."""
SPOKEN_DWELL_S = 1.6
"""Minimum dwell time where names are spoken, s: word, hand and movement take 1.1 s."""
UNCLEAR_S = 2.5
"""Time of staying after which the person is notified of another object that is as probable."""
ALIKE = 0.5
"""Share of the most probable one's probability from which another is as probable."""
BOTH = 0.7
"""Least probability of both together."""
UNTOLD_S = 6.0
"""Least time between two such cues."""
LEFT_S = 0.3
"""Time after which an object that fired can fire again, once it is left."""
LONGEST_GAP_S = 0.25
MAX_CACHED = 4096
"""Limit of objects as seen from some eyes whose values are kept: most stand still, as do people's eyes."""
_FLAT = math.sqrt(2.0 * math.pi)


class EstimateConfig(MethodConfig):
    """Parameters of method `estimate`."""

    dwell_s: float = Field(default=1.0, gt=0, le=10, description="time on an object that selects it, s")
    announce: AnnounceConfig = Field(default=AnnounceConfig(), description="names spoken to people")
    sure: float = Field(default=0.7, ge=0.5, lt=1, description="probability from which an object is selected")


class EstimateMethod:
    """Method `estimate` for one person."""

    def __init__(self, config: EstimateConfig) -> None:
        self._config = config
        self._speed = RaySpeedEstimator(SPEED_WINDOW_S)
        self._beside: dict[str, _Angles] = {}
        """Smoothed angles from the ray to each object near it."""
        self._now: dict[str, _Angles] = {}
        """The same of the last ray alone."""
        self._stamp_ns = 0
        self._shown: str | None = None
        self._anchor: _Angles = (0.0, 0.0, 0.0, 0.0)
        """Angles to the object that is shown when staying on it began."""
        self._stays_ns = 0
        self._notified_ns: int | None = None
        """Time of the last cue that two objects are alike."""
        self._spoken: tuple[str, int] | None = None
        """Object whose name was spoken, and its time, ns. None if no names are spoken to the person."""
        self._left: dict[str, int | None] = {}
        """Objects that fired, with the time since which they are left, ns, or None."""

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        return self._left

    def latch(self, object_id: str) -> None:
        """Ignore `object_id` until it is left."""
        self._left[object_id] = None

    def set_spoken(self, object_id: str, began_ns: int) -> None:
        """Set the object whose name is spoken to the person, and the time at which it began, ns."""
        self._spoken = object_id, began_ns

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        cursor = pointing.cursor
        view = pointing.view
        now_ns = cursor.stamp_ns
        elapsed_s = max(now_ns - self._stamp_ns, 0) / NS_PER_S
        self._stamp_ns = now_ns
        if cursor.direction is None or cursor.origin_m is None or view is None:
            self._beside.clear()
            self._change_shown(None, now_ns)
            return SelectionProgress()
        if elapsed_s > LONGEST_GAP_S:
            self._speed.clear()
            self._beside.clear()
            self._change_shown(None, now_ns)
        self._speed.add(now_ns, cursor.direction)
        share = 1.0 - math.exp(-elapsed_s / SMOOTHING_S)
        logs = self._log_likelihoods(view, cursor.origin_m, cursor.direction, share)
        probabilities = self._probabilities(view, cursor, logs, now_ns)
        self._choose(view, probabilities, now_ns)
        return self._progress(pointing, view, probabilities, now_ns)

    def _log_likelihoods(self, view: View, origin_m: Vec3, direction: Vec3, share: float) -> dict[str, float]:
        """Smooth the angles to each object. Return the log of `ATTENTION` times the ray's density, 1/rad²."""
        azimuth, elevation = ray = _sight(direction)
        level = math.cos(elevation)
        before = self._beside
        self._beside = {}
        self._now = {}
        logs: dict[str, float] = {}
        for one in view.seen:
            (nearest, near_up), (center, center_up), prior = _places(one, origin_m, direction, ray)
            now = self._now[one.id] = (
                vector.wrap(azimuth - nearest) * level,
                near_up - elevation,
                vector.wrap(azimuth - center) * level,
                center_up - elevation,
            )
            a, b, c, d = before.get(one.id, now)
            right = a + share * (now[0] - a)
            up = b + share * (now[1] - b)
            self._beside[one.id] = (right, up, c + share * (now[2] - c), d + share * (now[3] - d))
            up = up - LOW_RAD if up < 0.0 else max(up - LOW_RAD, 0.0)
            logs[one.id] = prior - 0.5 * ((right / SIDEWAYS_RAD) ** 2 + (up / UPWARDS_RAD) ** 2)
        return logs

    def _probabilities(
        self, view: View, cursor: Cursor, logs: dict[str, float], now_ns: int
    ) -> dict[str, float]:
        """Return the probability of each object near the ray. The rest is that of none."""
        stayed_s = (now_ns - self._stays_ns) / NS_PER_S if self._shown is not None else 0.0
        accepted = min(SEEN_PER_S * max(stayed_s - SEEN_AFTER_S, 0.0), SEEN)
        shown = self._shown
        if shown is not None and shown in logs:
            is_lit = any(one.id == shown and one.tracked.lit for one in view.seen)
            logs[shown] += max(accepted if is_lit else 0.0, self._agreement(now_ns))
        none = math.log(UNIFORM_DENSITY) - min(RESTING_PER_S * stayed_s, RESTING)
        # who points at a line on which objects move, or that lights them, means an object
        if cursor.surface in LINES and not any(_may_be_on(one, cursor) for one in view.seen):
            across = math.log(ON_LIGHT / (_FLAT * UPWARDS_RAD)) - 0.5 * (cursor.miss_rad / UPWARDS_RAD) ** 2
            across += accepted  # they see the cursor there, too
            none = max(none, across) + math.log1p(math.exp(-abs(none - across)))
        highest = max(none, *logs.values()) if logs else none
        weights = {name: math.exp(log - highest) for name, log in logs.items()}
        total = math.fsum(weights.values()) + math.exp(none - highest)
        return {name: weight / total for name, weight in weights.items()}

    def _agreement(self, now_ns: int) -> float:
        """Return the log-likelihood ratio for the shown object of staying since its name was spoken, nats."""
        if self._spoken is None or self._spoken[0] != self._shown:
            return 0.0
        spoken_s = (now_ns - max(self._stays_ns, self._spoken[1])) / NS_PER_S
        return min(SEEN_PER_S * max(spoken_s - SPOKEN_AFTER_S, 0.0), SPOKEN)

    def _choose(self, view: View, probabilities: dict[str, float], now_ns: int) -> None:
        """Choose the object to show, and note since when the person stays on it."""
        best = max(probabilities, key=probabilities.__getitem__, default=None)
        rate = self._speed.rate()
        min_share, shown_from = (
            (MIN_SHARE, SHOWN) if self._spoken is None else (MIN_SPOKEN_SHARE, SPOKEN_SHOWN)
        )
        if best is not None and rate is not None:
            kept = self._shown
            if kept in probabilities and probabilities[kept] >= min_share * probabilities[best]:
                best = kept
            speed = view.relative_rate(best, rate)
            if speed < FAST_RADPS and probabilities[best] >= shown_from:
                self._change_shown(best, now_ns)
                moved_rad = math.dist(self._beside[best][2:], self._anchor[2:])
                jumped_rad = math.dist(self._now[best][2:], self._anchor[2:]) / 2.0  # not smoothed
                if max(moved_rad, jumped_rad) > _corrected_rad(view, best):
                    self._stays_ns = now_ns
                    self._anchor = self._beside[best]
                return
        self._change_shown(None, now_ns)

    def _change_shown(self, object_id: str | None, now_ns: int) -> None:
        if object_id != self._shown:
            self._shown = object_id
            self._stays_ns = now_ns
            self._anchor = self._beside.get(object_id or "", self._anchor)
        for name, since_ns in list(self._left.items()):
            if name == object_id:
                self._left[name] = None
            elif since_ns is None:
                self._left[name] = now_ns
            elif now_ns - since_ns >= LEFT_S * NS_PER_S:
                del self._left[name]

    def _progress(
        self, pointing: PointingSample, view: View, probabilities: dict[str, float], now_ns: int
    ) -> SelectionProgress:
        shown = self._shown
        if shown is None:
            return SelectionProgress()
        probability = probabilities[shown]
        if shown in self._left or not pointing.acts(shown):
            return SelectionProgress(shown, confidence=probability)
        dwell_s = next(one.tracked.dwell_s for one in view.seen if one.id == shown) or self._config.dwell_s
        if self._spoken is not None:
            dwell_s = max(dwell_s, SPOKEN_DWELL_S)
        stayed_s = (now_ns - self._stays_ns) / NS_PER_S
        progress = min(stayed_s / dwell_s, 1.0) * min(probability / self._config.sure, 1.0)
        if progress < 1.0:
            is_unclear = stayed_s > UNCLEAR_S and self._spoken is None
            rival = self._rival(shown, probabilities, now_ns) if is_unclear else None
            return SelectionProgress(shown, progress, None, stayed_s, probability, rival)
        self._left[shown] = None
        return SelectionProgress(shown, 1.0, shown, stayed_s, probability)

    def _rival(self, shown: str, probabilities: dict[str, float], now_ns: int) -> str | None:
        """Return the object that is about as probable as the one that is shown, now and then, or None."""
        others = {name: probability for name, probability in probabilities.items() if name != shown}
        rival = max(others, key=others.__getitem__, default=None)
        if rival is None or not ALIKE * probabilities[shown] <= others[rival]:
            return None
        was_notified = self._notified_ns is not None and now_ns - self._notified_ns < UNTOLD_S * NS_PER_S
        if was_notified or probabilities[shown] + others[rival] < BOTH:
            return None
        self._notified_ns = now_ns
        return rival


def _corrected_rad(view: View, object_id: str) -> float:
    """Return the angle from which a movement on an object may be a correction towards another one."""
    own = next(one for one in view.seen if one.id == object_id)
    apart_m = min(
        (math.dist(own.center_m, one.center_m) for one in view.seen if one is not own), default=math.inf
    )
    return min(MOVED * math.atan(apart_m / own.range_m), MAX_MOVED_RAD)


def _may_be_on(one: VisibleObject, cursor: Cursor) -> bool:
    if one.place is None:
        return one.tracked.size_m is None
    return (one.place.surface, one.place.surface_id) == (cursor.surface, cursor.surface_id)


def _places(one: VisibleObject, origin_m: Vec3, direction: Vec3, ray: _Sight) -> tuple[_Sight, _Sight, float]:
    """Return where the object is nearest to a ray and where its centre is, and its `_log_peak`."""
    size_m = one.tracked.size_m
    reach_m = vector.subtract(one.center_m, origin_m)
    if size_m is not None:
        center, log = _box_place(reach_m, size_m, one.range_m)
        return ray if one.outline_m is None else _sight(vector.subtract(one.outline_m, origin_m)), center, log
    start_m = vector.subtract(reach_m, vector.scale(one.along, one.half_m))
    step_m = vector.scale(one.along, 2.0 * one.half_m)
    nearest_m = vector.add(start_m, vector.scale(step_m, nearest_in_angle(start_m, step_m, direction)[0]))
    return _sight(nearest_m), _sight(reach_m), _log_peak(one.half_rad, 0.0)


@lru_cache(MAX_CACHED)
def _box_place(reach_m: Vec3, size_m: Vec3, range_m: float) -> tuple[_Sight, float]:
    wide_m = max(size_m[:2])
    high_m = size_m[2]
    wide_rad = math.atan(wide_m / 2.0 / range_m)
    high_rad = math.atan(high_m / 2.0 / range_m)
    return _sight(reach_m), _log_peak(wide_rad, high_rad)


def _log_peak(wide_rad: float, high_rad: float) -> float:
    """Return the log of `ATTENTION` times the density of rays, 1/rad², on an object of half this extent."""
    area = (2.0 * wide_rad + _FLAT * SIDEWAYS_RAD) * (2.0 * high_rad + _FLAT * UPWARDS_RAD)
    return math.log(ATTENTION / area)


def _sight(reach: Vec3) -> _Sight:
    x, y, z = reach
    return math.atan2(y, x), math.atan2(z, math.hypot(x, y))


ESTIMATE = SelectionMethod(
    summary="the object that is probably meant, shown from the first guess, once it is sure",
    config=EstimateConfig,
    make=lambda config, _surroundings: EstimateMethod(config),
    by_angle=True,
    announcer=lambda config, user: Announcer(config.announce) if config.announce.is_for(user) else None,
)
