"""A simulated arm of five joints with a suction cup. A class with the same members drives a real arm."""

import math

from pointit.plugins import NS_PER_S, Clock, vector

Vec3 = vector.Vec3

SHOULDER_M = 0.35
"""Height of the shoulder above the base, m."""
UPPER_M = 0.62
"""Length of the upper arm, m."""
FORE_M = 0.62
"""Length of the forearm, m."""
HAND_M = 0.14
"""Length of the hand, m."""
MOST_FOLDED = -0.95
ALMOST_STRAIGHT = 0.999
"""Limits of the cosine of the elbow."""
MAX_SPEED_MPS = 1.2
LEAST_SPEED_MPS = 0.01
MAX_PASSED_S = 0.1
"""Longest time that one step makes up for, s."""
APPROACH_RATE = 8.0
"""Speed of the tip near its goal, per metre that is left, 1/s."""


def joint_angles(base_m: Vec3, tip_m: Vec3) -> tuple[float, float, float, float, float] | None:
    """Return the angles of base, shoulder, elbow, wrist and cup, rad, or None if `tip_m` is out of reach.

    The hand points downwards, and the cup keeps its azimuth in {W}. The elbow is up. All are 0 where the arm
    is straight and level along x.
    """
    x, y, z = vector.subtract(tip_m, base_m)
    # Of the wrist from the shoulder
    across_m = math.hypot(x, y)
    up_m = z + HAND_M - SHOULDER_M
    cosine = (across_m**2 + up_m**2 - UPPER_M**2 - FORE_M**2) / (2.0 * UPPER_M * FORE_M)
    is_solvable = MOST_FOLDED <= cosine <= ALMOST_STRAIGHT
    if not is_solvable:
        return None
    elbow = -math.acos(cosine)
    shoulder = math.atan2(up_m, across_m)
    shoulder -= math.atan2(FORE_M * math.sin(elbow), UPPER_M + FORE_M * math.cos(elbow))
    yaw = math.atan2(y, x)
    return (yaw, shoulder, elbow, -math.pi / 2.0 - shoulder - elbow, -yaw)


def link_ends(base_m: Vec3, angles: tuple[float, ...]) -> list[Vec3]:
    """Return the positions of shoulder, elbow, wrist and tip, {W}, m."""
    elevation = 0.0
    ends = [vector.add(base_m, (0.0, 0.0, SHOULDER_M))]
    for angle, length_m in zip(angles[1:4], (UPPER_M, FORE_M, HAND_M), strict=True):
        elevation += angle
        direction = vector.direction(angles[0], elevation)
        ends.append(vector.add(ends[-1], vector.scale(direction, length_m)))
    return ends


class SimulatedArm:
    """Moves its tip straight to its goal. Where its joints cannot follow, it stands."""

    def __init__(self, base_m: Vec3, tip_m: Vec3, clock: Clock) -> None:
        """Create at `tip_m`, {W}, m."""
        self.has_link = True
        """True if the arm answers."""
        self.holds = False
        """True if the suction is on. On a real arm: if its sensor feels something."""
        self._base_m = base_m
        self._clock = clock
        self._tip_m = self._goal_m = tip_m
        self._at_ns = clock.now_ns()

    def move(self, tip_m: Vec3) -> None:
        """Move the tip to `tip_m`, {W}, m, in place of any earlier goal. Does not wait."""
        self._goal_m = tip_m

    def grip(self, *, on: bool) -> None:
        """Switch the suction on or off. Does not wait."""
        self.holds = on

    def tip_m(self) -> Vec3:
        """Return the position of the tip now, {W}, m."""
        now_ns = self._clock.now_ns()
        passed_s = min(max(now_ns - self._at_ns, 0) / NS_PER_S, MAX_PASSED_S)
        self._at_ns = now_ns
        way_m = vector.subtract(self._goal_m, self._tip_m)
        left_m = vector.norm(way_m)
        if left_m == 0.0:
            return self._tip_m

        # Slower near the goal
        speed_mps = min(MAX_SPEED_MPS, APPROACH_RATE * left_m + LEAST_SPEED_MPS)
        share = min(speed_mps * passed_s / left_m, 1.0)
        next_m = vector.add(self._tip_m, vector.scale(way_m, share))
        if joint_angles(self._base_m, next_m) is not None:
            self._tip_m = next_m
        return self._tip_m
