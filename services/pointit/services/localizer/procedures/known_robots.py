"""Robots whose places are known, as targets of one pointing that corrects the pose.

Pure: tracked objects and the time go in; targets come out.
"""

import math
from dataclasses import dataclass

from pointit.schemas import NS_PER_S, Lamp, TrackedObject, TrackedObjects
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.procedures.moving_target import ROBOT

FRESH_S = 1.0
"""Age of a report at which a robot's place is unknown."""

STANDS_MPS = 0.1
"""Speed below which a robot stands: pointing at it takes seconds."""

STAYS_M = 0.1
"""Distance by which a robot may move while it is pointed at."""

MAX_SIGMA_M = 0.2
"""Uncertainty of a place at which pointing is no measure, 1 sigma."""

MAX_ROBOTS = 256
"""Largest number of robots; those reported last are kept."""


@dataclass(frozen=True)
class _Seen:
    stamp_ns: int
    robot: TrackedObject


class KnownRobots:
    """The newest report of every robot."""

    def __init__(self) -> None:
        """Start without robots."""
        self._seen: dict[str, _Seen] = {}

    def on_objects(self, message: TrackedObjects) -> None:
        """Update the robots of a tracker."""
        for item in message.objects:
            if item.kind == ROBOT:
                self._seen.pop(item.id, None)
                self._seen[item.id] = _Seen(message.stamp_ns, item)
        while len(self._seen) > MAX_ROBOTS:
            del self._seen[next(iter(self._seen))]

    def __contains__(self, robot: str) -> bool:
        """Return True if `robot` was ever reported."""
        return robot in self._seen

    def target(self, robot: str, now_ns: int) -> Lamp | Refusal:
        """Return the place of `robot`, or a refusal if it is unknown or moves."""
        seen = self._seen.get(robot)
        if seen is None or now_ns - seen.stamp_ns > FRESH_S * NS_PER_S:
            return Refusal(f"robot {robot} is not tracked now; start its tracker, or point at a lamp")
        if math.hypot(*seen.robot.velocity_mps) > STANDS_MPS:
            return Refusal(f"robot {robot} moves; let it stand, then point at it")
        if (seen.robot.position_sigma_m or 0.0) > MAX_SIGMA_M:
            return Refusal(
                f"the place of robot {robot} is uncertain by {seen.robot.position_sigma_m:.1f} m and at most "
                f"{MAX_SIGMA_M:g} m is accepted; point at a lamp"
            )
        return Lamp(id=robot, position_m=seen.robot.position_m)

    def standing(self, now_ns: int) -> list[Lamp]:
        """Return the places of all robots that stand."""
        targets = (self.target(robot, now_ns) for robot in self._seen)
        return [target for target in targets if isinstance(target, Lamp)]

    def moved(self, target: Lamp, now_ns: int) -> str:
        """Return the reason not to measure by pointing at `target`, where a robot was, or `""`."""
        now = self.target(target.id, now_ns)
        if isinstance(now, Refusal):
            return now.reason
        moved_m = math.dist(now.position_m, target.position_m)
        return f"robot {target.id} moved by {moved_m:.1f} m meanwhile; try again" if moved_m > STAYS_M else ""
