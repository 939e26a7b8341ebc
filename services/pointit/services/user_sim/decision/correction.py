"""Closing the loop: what the person makes of the cursor they see (pointing.md §3, §7).

The person knows what their own hand has just done (an efference copy), so that a correction still on its
way to the eyes is not made twice, and where to look for the cursor.
"""

import math
from collections import deque

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import AimConfig
from pointit.services.user_sim.decision.goal import Goal
from pointit.sim.aim import Stance

MEMORY_S = 1.5
"""How far back a person recalls what their hand did."""
ADAPTATION = 0.3
"""Share of what had to be corrected in one reach that is carried into the next."""
LOST_S = 0.7
"""Without a cursor for so long after a reach, the person searches for it."""
SEARCH_RAD = tuple(math.radians(step) for step in (-5.0, 5.0, -10.0, 10.0))
"""Elevations tried one after the other."""
SEARCH_WIDE_RAD = (*SEARCH_RAD, math.radians(-20.0), math.radians(20.0))
"""The same where the light says that one points past."""
LOST_SEARCHES = 2
"""After so many in vain it is lost."""

MOST_RAD = (math.radians(90.0), math.radians(40.0))
"""Nobody points further beside what they look at: azimuth, elevation."""

Pair = tuple[float, float]


class Correction:
    """The deliberate turn away from where the person thinks the target is, so that the cursor is on it."""

    def __init__(self, config: AimConfig, stance: Stance, rng: np.random.Generator) -> None:
        """Correct from the place of `stance`."""
        self._stance = stance
        self._rng = rng
        self._gain = config.correction_gain
        self._spread = config.correction_spread
        self._content_rad = math.radians(config.content_deg)
        self._period_ns = round(config.correction_period_s * NS_PER_S)
        self._delay_ns = round(config.visual_delay_s * NS_PER_S)
        self._learned: Pair = (0.0, 0.0)
        self.now_rad: Pair = (0.0, 0.0)
        """Azimuth and elevation."""
        self._done: deque[tuple[int, Pair]] = deque()
        self._seen: list[Pair] = []
        self._beside: Pair = (0.0, 0.0)
        """How far from where the hand should point the cursor was when it was seen last."""
        self._look_from_ns = 0
        self._next_ns = 0
        self._newest_ns = 0
        self._searches = 0
        self._aside_rad: float | None = None
        """Azimuth, rad, to which the pixel that shows pointing past led, or None."""
        self._is_turning = False
        """Whether a cue has just said how to turn."""

    @property
    def is_lost(self) -> bool:
        """Return True if the cursor was searched for in vain."""
        return self._searches >= LOST_SEARCHES

    @property
    def off_rad(self) -> float:
        """Return how far the cursor is from where the person feels to point; infinite when it is lost."""
        return math.inf if self.is_lost else math.hypot(*self.now_rad)

    def settle(self, left: Goal, goal: Goal) -> None:
        """Turn from `left` to `goal`: of a correction by the cursor a part stays, as adaptation.

        It serves the next goal with a cursor; without one the person aims along their finger, as they see it.
        """
        if left.closed_loop and not self.is_lost:
            self._learned = (
                self._learned[0] + ADAPTATION * (self.now_rad[0] - self._learned[0]),
                self._learned[1] + ADAPTATION * (self.now_rad[1] - self._learned[1]),
            )
        self.now_rad = self._learned if goal.closed_loop else (0.0, 0.0)

    def begin(self, reached_ns: int) -> None:
        """Look at the cursor again once the hand has arrived."""
        self._look_from_ns = self._newest_ns = reached_ns
        self._next_ns = reached_ns + self._delay_ns
        self._seen.clear()
        self._searches = 0
        self._aside_rad = None
        self._is_turning = False

    def remember(self, now_ns: int, deviation_rad: Pair) -> None:
        """Note what the hand deliberately does beside the goal."""
        turned = (deviation_rad[0] + self.now_rad[0], deviation_rad[1] + self.now_rad[1])
        while self._done and self._done[-1][0] > now_ns:  # a clock was set back
            self._done.pop()
        self._done.append((now_ns, turned))
        while self._done[0][0] < now_ns - MEMORY_S * NS_PER_S:
            self._done.popleft()

    def expected_m(self, at_ns: int, goal: Goal) -> Vec3 | None:
        """Return about where the cursor should have been at `at_ns`, {W}; none while that is not known."""
        target, did = goal.point_at(at_ns), self._recall(at_ns)
        if target is None or did is None:
            return None
        azimuth, elevation = self._stance.sight_of(target)
        away = vector.direction(azimuth + did[0] + self._beside[0], elevation + did[1] + self._beside[1])
        return vector.add(self._stance.eyes_m, vector.scale(away, math.dist(target, self._stance.eyes_m)))

    def see(self, point_m: Vec3, at_ns: int, goal: Goal) -> None:
        """Take in where the cursor was at `at_ns`."""
        target, did = goal.point_at(at_ns), self._recall(at_ns)
        if target is None or did is None:
            return
        shown, meant = self._stance.sight_of(point_m), self._stance.sight_of(target)
        self._beside = (vector.wrap(shown[0] - meant[0] - did[0]), shown[1] - meant[1] - did[1])
        if at_ns < self._look_from_ns:
            return
        self._newest_ns = max(self._newest_ns, at_ns)
        self._searches = 0
        self._aside_rad = None
        self._seen.append(self._beside)

    def see_mark(self, point_m: Vec3, at_ns: int, goal: Goal) -> None:
        """Take in that the ray passed everything by at `at_ns`, nearest to `point_m`."""
        target, did = goal.point_at(at_ns), self._recall(at_ns)
        if target is None or did is None or at_ns < self._look_from_ns:
            return
        shown, meant = self._stance.sight_of(point_m), self._stance.sight_of(target)
        self._aside_rad = did[0] - vector.wrap(shown[0] - meant[0])

    def turn(self, turn_rad: Pair, at_ns: int, now_ns: int) -> None:
        """Turn as a cue says by which the ray of `at_ns` has to go right and up to meet something."""
        did = self._recall(at_ns)
        if did is None:
            return
        self.now_rad = _held((did[0] - turn_rad[0], did[1] + turn_rad[1]))
        self._newest_ns = now_ns
        self._searches = 0
        self._is_turning = True

    def step(self, now_ns: int) -> bool:
        """Return True if `now_rad` changed, so that the hand must move."""
        if self._is_turning:
            self._is_turning = False
            self._next_ns = now_ns + self._period_ns
            return True
        if now_ns < self._next_ns <= now_ns + self._period_ns + self._delay_ns + 10 * NS_PER_S:
            return False
        if self._seen:
            self._next_ns = now_ns + self._period_ns
            unknown = [math.fsum(axis) / len(self._seen) for axis in zip(*self._seen, strict=True)]
            self._seen.clear()
            if math.hypot(self.now_rad[0] + unknown[0], self.now_rad[1] + unknown[1]) < self._content_rad:
                return False
            self.now_rad = _held(
                (
                    self.now_rad[0] - self._share() * (self.now_rad[0] + unknown[0]),
                    self.now_rad[1] - self._share() * (self.now_rad[1] + unknown[1]),
                )
            )
            return True
        if abs(now_ns - self._newest_ns) > self._delay_ns + LOST_S * NS_PER_S:
            self._search(now_ns)
            return True
        return False

    def _share(self) -> float:
        """Return the share of an error that is corrected this time."""
        return self._gain * (1.0 + self._spread * float(self._rng.standard_normal()))

    def _recall(self, at_ns: int) -> Pair | None:
        """Return what the hand did beside the goal at `at_ns`."""
        for then_ns, turned in reversed(self._done):
            if then_ns <= at_ns:
                return turned
        return None

    def _search(self, now_ns: int) -> None:
        steps = SEARCH_RAD if self._aside_rad is None else SEARCH_WIDE_RAD
        step = steps[self._searches % len(steps)]
        self._searches += 1
        azimuth_rad = self._learned[0] if self._aside_rad is None else self._aside_rad
        self.now_rad = _held((azimuth_rad, self._learned[1] + step))
        self._next_ns = now_ns + self._period_ns
        self._newest_ns = now_ns


def _held(turned: Pair) -> Pair:
    azimuth, elevation = MOST_RAD
    return (
        min(max(vector.wrap(turned[0]), -azimuth), azimuth),
        min(max(turned[1], -elevation), elevation),
    )
