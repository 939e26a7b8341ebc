"""Pointing at one lamp, or robot whose place is known, to correct the pose (pointing.md §3, §4).

Pure: rays and the time go in; the lamp, progress and the anchor come out.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from pointit.schemas import NS_PER_S, Lamp, TrackedObject, TrackedObjects
from pointit.schemas.text import round_beyond
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import rays as ray_math
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.estimation.rays import Mean
from pointit.services.localizer.outputs import AnchorOutcome, Output
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure
from pointit.services.localizer.procedures.moving_target import ROBOT

MIN_RAYS = 10
"""Rays that an anchor needs."""

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


class Anchoring(LampProcedure):
    """One pointing at one lamp."""

    purpose = "anchor"

    def __init__(
        self,
        lamp: Lamp,
        judge: Callable[[Lamp, Mean, str, int], AnchorOutcome],
        config: LocalizerConfig,
        *,
        occupies: Iterable[str] = (),
        is_robot: bool = False,
    ) -> None:
        """Create the procedure.

        Args:
            lamp: to point at.
            judge: applies the anchor of a lamp and a mean ray, and returns the outcome. The text is the
                reason to reject it or `""`, the number is the time, ns.
            config: times and limits of the hold.
            occupies: ids of lamps that other people cannot use meanwhile, besides `lamp`.
            is_robot: `lamp` is the place of a robot, which several people may point at.
        """
        super().__init__((*(() if is_robot else (lamp.id,)), *occupies), config, MIN_RAYS, "ask again")
        self._is_robot = is_robot
        self._target = lamp
        self._judge = judge

    @property
    def targets(self) -> Sequence[Lamp]:
        """Return the one lamp."""
        return () if self._is_robot else (self._target,)

    def _next_lamp(self) -> Lamp:
        return self._target

    def _held(self, now_ns: int) -> list[Output]:
        mean = ray_math.mean(self._hold.rays)
        if mean is None:
            return self._end(
                now_ns, "refused", "the rays point in all directions; hold the arm still and try again"
            )
        limit_rad = math.radians(self._config.max_spread_deg)
        problem = ""
        if mean.spread_rad > limit_rad:
            spread_deg = round_beyond(math.degrees(mean.spread_rad), self._config.max_spread_deg)
            problem = (
                f"the arm wandered by {spread_deg}° while {self._lamp.id} was lit and "
                f"at most {self._config.max_spread_deg:.1f}° is accepted; hold it still and try again"
            )
        judged = self._judge(self._lamp, mean, problem, now_ns)
        anchor = judged.anchor
        if not judged.is_done:
            return [anchor, *self._end(now_ns, "refused", anchor.reason)]
        self._running = False
        return [anchor, self._localization(now_ns, "solved", progress=1.0, reason=anchor.reason)]


@dataclass(frozen=True)
class _Seen:
    stamp_ns: int
    robot: TrackedObject


class KnownRobots:
    """The newest report of every robot."""

    def __init__(self) -> None:
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
        if (sigma_m := seen.robot.position_sigma_m or 0.0) > MAX_SIGMA_M:
            return Refusal(
                f"the place of robot {robot} is uncertain by {round_beyond(sigma_m, MAX_SIGMA_M)} m and "
                "at most "
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
