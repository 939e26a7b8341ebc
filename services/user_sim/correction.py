"""Closed-loop correction by the visible cursor (pointing.md §3, §7).

The person knows their own recent movements (an efference copy), so that a correction still within the visual
delay is not made twice, and the cursor is expected at the right position.
"""

import math
from collections import deque

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import AimConfig
from pointit.services.user_sim.goal import PersonGoal
from pointit.sim.aim import Stance

Pair = tuple[float, float]

MEMORY_S = 1.5
"""Time for which own movements are remembered, s."""
GAIN = 0.9
"""Share of the seen error that is corrected."""
ADAPTATION = 0.3
"""Share of the correction of one reach that is carried into the next."""
ADOPTION = 0.6
"""The same where a thing's light or a message says what helped, which people adopt as a strategy (Taylor,
Krakauer and Ivry 2014) rather than adapt to."""
LOST_S = 0.7
"""Time without a cursor after a reach until the person searches for it, s."""
SEARCH_RAD = tuple(math.radians(step) for step in (-5.0, 5.0, -10.0, 10.0))
"""Elevations tried one after the other, rad."""
SEARCH_WIDE_RAD = (*SEARCH_RAD, math.radians(-20.0), math.radians(20.0))
"""The same if the light shows that the ray passes everything."""
LOST_SEARCHES = 2
"""Number of failed searches after which the cursor is lost."""

MAX_RAD = (math.radians(90.0), math.radians(40.0))
"""Limits of the correction of azimuth and elevation, rad."""


class Correction:
    """Deliberate offset from the perceived target, so that the cursor is on it."""

    def __init__(self, config: AimConfig, stance: Stance, rng: np.random.Generator) -> None:
        self._stance = stance
        self._rng = rng
        self._spread = config.correction_spread
        self._content_rad = math.radians(config.content_deg)
        self._period_ns = round(config.correction_period_s * NS_PER_S)
        self._delay_ns = round(config.visual_delay_s * NS_PER_S)

        # The correction, and what is carried over to the next goal
        self._learned: Pair = (0.0, 0.0)
        self._confirmed_rad: Pair | None = None
        """Correction that light or a message has confirmed at this goal, rad, or None"""
        self._confirms = False
        """True if the last sight is exact: a cursor on the goal's line, or the goal's own light."""
        self.now_rad: Pair = (0.0, 0.0)
        """Current correction of azimuth and elevation, rad."""

        # Own movements and what was seen, which is late
        self._done: deque[tuple[int, Pair]] = deque()
        self._seen: list[Pair] = []
        self._beside: Pair = (0.0, 0.0)
        """Last offset of the visible cursor from the intended direction, rad."""
        self._look_from_ns = 0
        self._next_ns = 0
        self._newest_ns = 0
        self.steady_since_ns = 0
        """Time since which the intended direction has not changed."""

        # Search for a cursor that does not come
        self._searches = 0
        self._aside_rad: float | None = None
        """Azimuth correction, rad, by the mark of a ray that passes everything, or None."""
        self._is_turning = False
        """True if a cue has just specified a turn."""

    @property
    def is_lost(self) -> bool:
        """Return True if searches for the cursor failed."""
        return self._searches >= LOST_SEARCHES

    @property
    def off_rad(self) -> float:
        """Return the angle from the cursor to the felt direction, rad. Infinite if it is lost."""
        return math.inf if self.is_lost else math.hypot(*self.now_rad)

    def settle(self, previous: PersonGoal, goal: PersonGoal) -> None:
        """Change from goal `previous` to `goal`. A part of the correction remains, as adaptation.

        It applies to the next goal with a cursor. Without a cursor the person aims along their finger. Only
        a confirmed correction remains: nobody adapts to an error that they do not see.
        """
        confirmed = self._confirmed_rad
        if confirmed is not None and previous.closed_loop:
            share = ADAPTATION if previous.on_line else ADOPTION
            learned = self._learned
            azimuth = learned[0] + share * (confirmed[0] - learned[0])
            elevation = learned[1] + share * (confirmed[1] - learned[1])
            self._learned = (azimuth, elevation)
        self.now_rad = self._learned if goal.closed_loop else (0.0, 0.0)

    def begin(self, reached_ns: int) -> None:
        """Start looking at the cursor when the hand has arrived."""
        self._look_from_ns = self._newest_ns = self.steady_since_ns = reached_ns
        self._next_ns = reached_ns + self._delay_ns
        self._seen.clear()
        self._confirmed_rad = None
        self._searches = 0
        self._aside_rad = None
        self._is_turning = False

    def remember(self, now_ns: int, deviation_rad: Pair) -> None:
        """Record the deliberate offset from the goal."""
        azimuth = deviation_rad[0] + self.now_rad[0]
        elevation = deviation_rad[1] + self.now_rad[1]
        self._done.append((now_ns, (azimuth, elevation)))
        while self._done[0][0] < now_ns - MEMORY_S * NS_PER_S:
            self._done.popleft()

    def expected_m(self, at_ns: int, goal: PersonGoal) -> Vec3 | None:
        """Return the approximate position of the cursor at `at_ns`, {W}, or None if unknown."""
        target = goal.point_at(at_ns)
        deliberate = self._recall(at_ns)
        if target is None or deliberate is None:
            return None
        azimuth, elevation = self._stance.sight_of(target)
        azimuth_rad = azimuth + deliberate[0] + self._beside[0]
        elevation_rad = elevation + deliberate[1] + self._beside[1]
        away = vector.direction(azimuth_rad, elevation_rad)
        distance_m = math.dist(target, self._stance.eyes_m)
        return vector.add(self._stance.eyes_m, vector.scale(away, distance_m))

    def see(self, point_m: Vec3, at_ns: int, goal: PersonGoal, *, confirms: bool = True) -> None:
        """Process the position of the cursor at `at_ns`. `confirms`: it is exact, as far as people see."""
        target = goal.point_at(at_ns)
        deliberate = self._recall(at_ns)
        if target is None or deliberate is None:
            return
        shown = self._stance.sight_of(point_m)
        intended = self._stance.sight_of(target)
        azimuth_rad = vector.wrap(shown[0] - intended[0] - deliberate[0])
        self._beside = (azimuth_rad, shown[1] - intended[1] - deliberate[1])
        if at_ns < self._look_from_ns:
            return
        self._newest_ns = max(self._newest_ns, at_ns)
        self._searches = 0
        self._aside_rad = None
        self._seen.append(self._beside)
        self._confirms = confirms

    def wait(self, now_ns: int) -> None:
        """Search for nothing now: what shows the cursor is visible, but has not followed the hand yet."""
        self._newest_ns = max(self._newest_ns, now_ns)

    def see_mark(self, point_m: Vec3, at_ns: int, goal: PersonGoal) -> None:
        """Process that the ray passed everything at `at_ns`, nearest to `point_m`."""
        target = goal.point_at(at_ns)
        deliberate = self._recall(at_ns)
        if target is None or deliberate is None:
            return
        if at_ns < self._look_from_ns:
            return
        shown = self._stance.sight_of(point_m)
        intended = self._stance.sight_of(target)
        aside = vector.wrap(shown[0] - intended[0])
        self._aside_rad = deliberate[0] - aside

    def turn(self, turn_rad: Pair, at_ns: int, now_ns: int, goal: PersonGoal, named_m: Vec3 | None) -> None:
        """Turn by a cue's angles to the right and up, relative to the ray of `at_ns`.

        They lead to the thing that the cue names, at `named_m` if it is visible, and from there to the goal.
        """
        target = goal.point_at(at_ns)
        deliberate = self._recall(at_ns)
        if target is None or deliberate is None:
            return
        named = self._stance.sight_of(named_m or target)
        intended = self._stance.sight_of(target)
        beyond_azimuth = vector.wrap(named[0] - intended[0])
        beyond_elevation = named[1] - intended[1]
        azimuth = deliberate[0] - turn_rad[0] - beyond_azimuth
        elevation = deliberate[1] + turn_rad[1] - beyond_elevation
        self.now_rad = _limited((azimuth, elevation))
        if named_m is not None:
            self._confirmed_rad = self.now_rad
        self._newest_ns = now_ns
        self._searches = 0
        self._is_turning = True

    def step(self, now_ns: int) -> bool:
        """Return True if `now_rad` changed, so that the hand must move."""
        has_changed = self._step(now_ns)
        if has_changed:
            self.steady_since_ns = now_ns
        return has_changed

    def _step(self, now_ns: int) -> bool:
        # A cue has turned the hand
        if self._is_turning:
            self._is_turning = False
            self._next_ns = now_ns + self._period_ns
            return True

        # Wait for the effect of the last correction. A clock that was set back does not block.
        if now_ns < self._next_ns <= now_ns + self._period_ns + self._delay_ns + 10 * NS_PER_S:
            return False

        # Correct a share of the mean error since then, unless it is small enough
        if self._seen:
            self._next_ns = now_ns + self._period_ns
            azimuth, elevation = (math.fsum(axis) / len(self._seen) for axis in zip(*self._seen, strict=True))
            self._seen.clear()
            azimuth_error = self.now_rad[0] + azimuth
            elevation_error = self.now_rad[1] + elevation
            if math.hypot(azimuth_error, elevation_error) < self._content_rad:
                self._confirm()
                return False
            new_azimuth = self.now_rad[0] - self._share() * azimuth_error
            new_elevation = self.now_rad[1] - self._share() * elevation_error
            self.now_rad = _limited((new_azimuth, new_elevation))
            self._confirm()
            return True

        # Nothing was seen for long: search
        timeout_ns = self._delay_ns + LOST_S * NS_PER_S
        if abs(now_ns - self._newest_ns) > timeout_ns:
            self._search(now_ns)
            return True
        return False

    def _confirm(self) -> None:
        if self._confirms:
            self._confirmed_rad = self.now_rad

    def _share(self) -> float:
        deviation = self._spread * float(self._rng.standard_normal())
        return GAIN * (1.0 + deviation)

    def _recall(self, at_ns: int) -> Pair | None:
        """Return the offset from the goal at `at_ns`, rad, or None if unknown."""
        for then_ns, turned in reversed(self._done):
            if then_ns <= at_ns:
                return turned
        return None

    def _search(self, now_ns: int) -> None:
        steps = SEARCH_RAD if self._aside_rad is None else SEARCH_WIDE_RAD
        step = steps[self._searches % len(steps)]
        self._searches += 1
        azimuth_rad = self._learned[0] if self._aside_rad is None else self._aside_rad
        self.now_rad = _limited((azimuth_rad, self._learned[1] + step))
        self._next_ns = now_ns + self._period_ns
        self._newest_ns = now_ns


def _limited(turn_rad: Pair) -> Pair:
    max_azimuth, max_elevation = MAX_RAD
    azimuth = min(max(vector.wrap(turn_rad[0]), -max_azimuth), max_azimuth)
    elevation = min(max(turn_rad[1], -max_elevation), max_elevation)
    return (azimuth, elevation)
