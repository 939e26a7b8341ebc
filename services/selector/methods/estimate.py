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
"""Minimum probability at which an object is shown."""
MIN_SHARE = 0.7
"""Share of the highest probability above which the object that is shown is kept."""
SPOKEN_SHOWN = 0.12
"""As `SHOWN`, where names are spoken: a hover that flickers cuts them off."""
MIN_SPOKEN_SHARE = 0.4
"""As `MIN_SHARE`, where names are spoken."""
SPOKEN_DWELL_S = 1.6
"""Minimum dwell time where names are spoken, s: word, hand and movement take 1.1 s."""
UNCLEAR_S = 2.5
"""Time of staying after which the person is notified of another object that is as probable."""
ALIKE = 0.5
"""Share of the highest probability from which another object counts as equally probable."""
BOTH = 0.7
"""Minimum probability of both together."""
UNTOLD_S = 6.0
"""Minimum time between two such cues, s."""
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

        # Start again without a ray, and after a gap
        if cursor.direction is None or cursor.origin_m is None or view is None:
            self._beside.clear()
            self._change_shown(None, now_ns)
            return SelectionProgress()
        if elapsed_s > LONGEST_GAP_S:
            self._speed.clear()
            self._beside.clear()
            self._change_shown(None, now_ns)
        self._speed.add(now_ns, cursor.direction)

        # Judge the objects, choose the one to show, and fire when it is sure
        share = 1.0 - math.exp(-elapsed_s / SMOOTHING_S)
        logs = self._log_likelihoods(view, cursor.origin_m, cursor.direction, share)
        probabilities = self._probabilities(view, cursor, logs, now_ns)
        self._choose(view, probabilities, now_ns)
        return self._progress(pointing, view, probabilities, now_ns)

    def _log_likelihoods(self, view: View, origin_m: Vec3, direction: Vec3, share: float) -> dict[str, float]:
        """Smooth the angles to each object. Return the log of `ATTENTION` times the ray's density, 1/rad²."""
        ray = _sight(direction)
        azimuth, elevation = ray
        level = math.cos(elevation)
        previous = self._beside
        self._beside = {}
        self._now = {}
        logs: dict[str, float] = {}
        for visible in view.seen:
            nearest, center, prior = _places(visible, origin_m, direction, ray)
            near_azimuth, near_elevation = nearest
            center_azimuth, center_elevation = center
            now: _Angles = (
                vector.wrap(azimuth - near_azimuth) * level,
                near_elevation - elevation,
                vector.wrap(azimuth - center_azimuth) * level,
                center_elevation - elevation,
            )
            self._now[visible.id] = now

            # Smooth each angle by its own last value; a new object starts at this ray's
            a, b, c, d = previous.get(visible.id, now)
            right = a + share * (now[0] - a)
            up = b + share * (now[1] - b)
            center_right = c + share * (now[2] - c)
            center_up = d + share * (now[3] - d)
            self._beside[visible.id] = (right, up, center_right, center_up)

            # Deviation of the aim: a ray that is low by less than `LOW_RAD` is on the object
            if up < 0.0:
                up_error = up - LOW_RAD
            else:
                up_error = max(up - LOW_RAD, 0.0)
            square = (right / SIDEWAYS_RAD) ** 2 + (up_error / UPWARDS_RAD) ** 2
            logs[visible.id] = prior - 0.5 * square
        return logs

    def _probabilities(
        self, view: View, cursor: Cursor, logs: dict[str, float], now_ns: int
    ) -> dict[str, float]:
        """Return the probability of each object near the ray. The rest is that of none."""
        # The shown object: who stays on it accepts it, since they see or hear that it is shown
        shown = self._shown
        stayed_s = 0.0
        if shown is not None:
            stayed_s = (now_ns - self._stays_ns) / NS_PER_S
        accepted = min(SEEN_PER_S * max(stayed_s - SEEN_AFTER_S, 0.0), SEEN)
        if shown is not None and shown in logs:
            is_lit = any(visible.id == shown and visible.tracked.lit for visible in view.seen)
            seen = accepted if is_lit else 0.0
            logs[shown] += max(seen, self._agreement(now_ns))

        # None: anywhere, less probably for an arm that rests
        none = math.log(UNIFORM_DENSITY) - min(RESTING_PER_S * stayed_s, RESTING)
        # who points at a line on which objects move, or that lights them, means an object
        may_mean_line = cursor.surface in LINES and not any(
            _may_be_on(visible, cursor) for visible in view.seen
        )
        if may_mean_line:
            density = ON_LIGHT / (_FLAT * UPWARDS_RAD)
            line = math.log(density) - 0.5 * (cursor.miss_rad / UPWARDS_RAD) ** 2
            line += accepted  # they see the cursor there, too
            ratio = math.exp(-abs(none - line))
            none = max(none, line) + math.log1p(ratio)

        # Normalize, relative to the highest, so that not all weights vanish
        highest = max(none, *logs.values()) if logs else none
        weights = {name: math.exp(log - highest) for name, log in logs.items()}
        total = math.fsum(weights.values()) + math.exp(none - highest)
        return {name: weight / total for name, weight in weights.items()}

    def _agreement(self, now_ns: int) -> float:
        """Return the log-likelihood ratio for the shown object of staying since its name was spoken, nats."""
        if self._spoken is None:
            return 0.0
        spoken_id, began_ns = self._spoken
        if spoken_id != self._shown:
            return 0.0
        spoken_s = (now_ns - max(self._stays_ns, began_ns)) / NS_PER_S
        return min(SEEN_PER_S * max(spoken_s - SPOKEN_AFTER_S, 0.0), SPOKEN)

    def _choose(self, view: View, probabilities: dict[str, float], now_ns: int) -> None:
        """Choose the object to show, and note since when the person stays on it."""
        best = max(probabilities, key=probabilities.__getitem__, default=None)
        rate = self._speed.rate()
        if best is None or rate is None:
            self._change_shown(None, now_ns)
            return

        # The most probable object, unless the one that is shown is nearly as probable
        min_share = MIN_SHARE
        min_probability = SHOWN
        if self._spoken is not None:
            min_share = MIN_SPOKEN_SHARE
            min_probability = SPOKEN_SHOWN
        shown = self._shown
        if shown in probabilities and probabilities[shown] >= min_share * probabilities[best]:
            best = shown
        is_slow = view.relative_rate(best, rate) < FAST_RADPS
        is_probable = probabilities[best] >= min_probability
        if not is_slow or not is_probable:
            self._change_shown(None, now_ns)
            return
        self._change_shown(best, now_ns)

        # An arm that corrects its aim does not stay. The last ray counts half, as it is not smoothed
        anchor_center = self._anchor[2:]
        moved_rad = math.dist(self._beside[best][2:], anchor_center)
        jumped_rad = math.dist(self._now[best][2:], anchor_center) / 2.0
        if max(moved_rad, jumped_rad) > _corrected_rad(view, best):
            self._stays_ns = now_ns
            self._anchor = self._beside[best]

    def _change_shown(self, object_id: str | None, now_ns: int) -> None:
        """Show `object_id`, or nothing. What fired can fire again once it is left for long enough."""
        if object_id != self._shown:
            self._shown = object_id
            self._stays_ns = now_ns
            self._anchor = self._beside.get(object_id or "", self._anchor)
        for fired_id, since_ns in list(self._left.items()):
            if fired_id == object_id:
                self._left[fired_id] = None
            elif since_ns is None:
                self._left[fired_id] = now_ns
            elif now_ns - since_ns >= LEFT_S * NS_PER_S:
                del self._left[fired_id]

    def _progress(
        self, pointing: PointingSample, view: View, probabilities: dict[str, float], now_ns: int
    ) -> SelectionProgress:
        """Return the progress of the shown object. It fires after its dwell time, if it is sure by then."""
        shown = self._shown
        if shown is None:
            return SelectionProgress()
        probability = probabilities[shown]
        if shown in self._left or not pointing.acts(shown):
            return SelectionProgress(shown, confidence=probability)

        # Share of its dwell time, less where it is not sure yet
        dwell_s = _visible_by_id(view, shown).tracked.dwell_s or self._config.dwell_s
        if self._spoken is not None:
            dwell_s = max(dwell_s, SPOKEN_DWELL_S)
        stayed_s = (now_ns - self._stays_ns) / NS_PER_S
        certainty = min(probability / self._config.sure, 1.0)
        progress = min(stayed_s / dwell_s, 1.0) * certainty
        if progress < 1.0:
            is_unclear = stayed_s > UNCLEAR_S and self._spoken is None
            rival = self._rival(shown, probabilities, now_ns) if is_unclear else None
            return SelectionProgress(shown, progress, None, stayed_s, probability, rival)
        self._left[shown] = None
        return SelectionProgress(shown, 1.0, shown, stayed_s, probability)

    def _rival(self, shown: str, probabilities: dict[str, float], now_ns: int) -> str | None:
        """Return the object that is about as probable as the one that is shown, now and then, or None."""
        others = dict(probabilities)
        del others[shown]
        rival = max(others, key=others.__getitem__, default=None)
        if rival is None:
            return None
        is_alike = ALIKE * probabilities[shown] <= others[rival]
        if not is_alike or probabilities[shown] + others[rival] < BOTH:
            return None
        if self._notified_ns is not None and now_ns - self._notified_ns < UNTOLD_S * NS_PER_S:
            return None
        self._notified_ns = now_ns
        return rival


def _corrected_rad(view: View, object_id: str) -> float:
    """Return the angle from which a movement on an object may be a correction towards another one."""
    own = _visible_by_id(view, object_id)
    distances_m: list[float] = []
    for visible in view.seen:
        if visible is not own:
            distances_m.append(math.dist(own.center_m, visible.center_m))
    apart_m = min(distances_m, default=math.inf)
    return min(MOVED * math.atan(apart_m / own.range_m), MAX_MOVED_RAD)


def _visible_by_id(view: View, object_id: str) -> VisibleObject:
    return next(visible for visible in view.seen if visible.id == object_id)


def _may_be_on(visible: VisibleObject, cursor: Cursor) -> bool:
    """Return True if the object may be on the line of `cursor`."""
    if visible.place is None:
        return visible.tracked.size_m is None
    return (visible.place.surface, visible.place.surface_id) == (cursor.surface, cursor.surface_id)


def _places(
    visible: VisibleObject, origin_m: Vec3, direction: Vec3, ray: _Sight
) -> tuple[_Sight, _Sight, float]:
    """Return the point of the object nearest to a ray, its centre, and its `_log_peak`."""
    size_m = visible.tracked.size_m
    reach_m = vector.subtract(visible.center_m, origin_m)
    if size_m is not None:
        center, log_peak = _box_place(reach_m, size_m, visible.range_m)
        nearest = ray  # the ray meets the box
        if visible.outline_m is not None:
            nearest = _sight(vector.subtract(visible.outline_m, origin_m))
        return nearest, center, log_peak
    start_m = vector.subtract(reach_m, vector.scale(visible.along, visible.half_m))
    step_m = vector.scale(visible.along, 2.0 * visible.half_m)
    t, _ = nearest_in_angle(start_m, step_m, direction)
    nearest_m = vector.add(start_m, vector.scale(step_m, t))
    return _sight(nearest_m), _sight(reach_m), _log_peak(visible.half_rad, 0.0)


@lru_cache(MAX_CACHED)
def _box_place(reach_m: Vec3, size_m: Vec3, range_m: float) -> tuple[_Sight, float]:
    """Return the centre of a box of any yaw, and its `_log_peak`."""
    wide_m = max(size_m[:2])
    high_m = size_m[2]
    wide_rad = math.atan(wide_m / 2.0 / range_m)
    high_rad = math.atan(high_m / 2.0 / range_m)
    return _sight(reach_m), _log_peak(wide_rad, high_rad)


def _log_peak(wide_rad: float, high_rad: float) -> float:
    """Return the log of `ATTENTION` times the density of rays, 1/rad², on an object of half this extent."""
    effective_width = 2.0 * wide_rad + _FLAT * SIDEWAYS_RAD
    effective_height = 2.0 * high_rad + _FLAT * UPWARDS_RAD
    area = effective_width * effective_height
    return math.log(ATTENTION / area)


def _sight(reach: Vec3) -> _Sight:
    """Return azimuth and elevation of a vector."""
    x, y, z = reach
    level = math.hypot(x, y)
    return math.atan2(y, x), math.atan2(z, level)


ESTIMATE = SelectionMethod(
    summary="the object that is probably meant, shown from the first guess, once it is sure",
    config=EstimateConfig,
    make=lambda config, _surroundings: EstimateMethod(config),
    by_angle=True,
    announcer=lambda config, user: Announcer(config.announce) if config.announce.is_for(user) else None,
)
