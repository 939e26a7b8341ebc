"""Pointing at one lamp, or robot, to correct the pose: "point at the lamp once" (pointing.md §3, §4).

Pure: rays and the time go in; the lamp, progress and the anchor come out.
"""

import math
from collections.abc import Callable, Iterable, Sequence

from pointit.schemas import Lamp
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import rays as ray_math
from pointit.services.localizer.estimation.rays import Mean
from pointit.services.localizer.outputs import AnchorOutcome, Output
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure

MIN_RAYS = 10
"""Rays that an anchor needs."""


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
            problem = (
                f"the arm wandered by {math.degrees(mean.spread_rad):.1f}° while {self._lamp.id} was lit and "
                f"at most {math.degrees(limit_rad):.1f}° is accepted; hold it still and try again"
            )
        judged = self._judge(self._lamp, mean, problem, now_ns)
        anchor = judged.anchor
        if not judged.is_done:
            return [anchor, *self._end(now_ns, "refused", anchor.reason)]
        self._running = False
        return [anchor, self._localization(now_ns, "solved", progress=1.0, reason=anchor.reason)]
