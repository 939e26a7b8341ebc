"""A simulated arm of five joints with a suction cup. A class with the same members drives a real arm."""

import math

import numpy as np

from pointit.plugins import NS_PER_S, Clock, rotation

Vec3 = tuple[float, float, float]

SHOULDER_M = 0.35
"""Height of the shoulder above the base, m."""
UPPER_M = 0.62
"""Length of the upper arm, m."""
FORE_M = 0.62
"""Length of the forearm, m."""
HAND_M = 0.14
"""Length of the hand, m."""
MAX_SPEED_MPS = 1.2
APPROACH_RATE = 8.0
"""Speed of the tip near its goal, per metre that is left, 1/s."""


def joint_angles(base_m: Vec3, tip_m: Vec3) -> tuple[float, float, float, float, float] | None:
    """Return the angles of base, shoulder, elbow, wrist and cup, rad, or None if `tip_m` is out of reach.

    The hand points downwards, and the cup keeps its azimuth in {W}. The elbow is up. All are 0 where the arm
    is straight and level along x.
    """
    x, y, z = (a - b for a, b in zip(tip_m, base_m, strict=True))
    # of the wrist from the shoulder
    across_m = math.hypot(x, y)
    up_m = z + HAND_M - SHOULDER_M
    cosine = (across_m**2 + up_m**2 - UPPER_M**2 - FORE_M**2) / (2.0 * UPPER_M * FORE_M)
    if not -0.95 <= cosine <= 0.999:  # not folded upon itself, not quite straight
        return None
    elbow = -math.acos(cosine)
    shoulder = math.atan2(up_m, across_m)
    shoulder -= math.atan2(FORE_M * math.sin(elbow), UPPER_M + FORE_M * math.cos(elbow))
    yaw = math.atan2(y, x)
    return (yaw, shoulder, elbow, -math.pi / 2.0 - shoulder - elbow, -yaw)


def link_ends(base_m: Vec3, angles: tuple[float, ...]) -> list[Vec3]:
    """Return the positions of shoulder, elbow, wrist and tip, {W}, m."""
    elevation = 0.0
    ends = [np.add(base_m, (0.0, 0.0, SHOULDER_M))]
    for angle, length_m in zip(angles[1:4], (UPPER_M, FORE_M, HAND_M), strict=True):
        elevation += angle
        turn = rotation.from_azimuth_elevation(angles[0], elevation)
        ends.append(ends[-1] + length_m * np.array(rotation.rotate(turn, (1.0, 0.0, 0.0))))
    return [(float(x), float(y), float(z)) for x, y, z in ends]


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
        passed_s = min(max(now_ns - self._at_ns, 0) / NS_PER_S, 0.1)
        self._at_ns = now_ns
        left_m = math.dist(self._goal_m, self._tip_m)
        step_m = min(MAX_SPEED_MPS, APPROACH_RATE * left_m + 0.01) * passed_s
        share = min(step_m / left_m, 1.0) if left_m > 0.0 else 1.0
        tip = np.array(self._tip_m) + share * np.subtract(self._goal_m, self._tip_m)
        next_m = (float(tip[0]), float(tip[1]), float(tip[2]))
        if joint_angles(self._base_m, next_m) is not None:
            self._tip_m = next_m
        return self._tip_m
