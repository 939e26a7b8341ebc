"""Which lamps are lit for a localization, in which order, and when it is enough."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import Lamp
from pointit.services.localizer.estimation.estimator import Solution

ROUNDS = 2
"""When as many lamps are lit as are needed, each is lit at most so often."""


@dataclass(frozen=True, kw_only=True)
class TargetPlan:
    """Which lamps are lit, in which order, and when it is enough."""

    order: Literal["given", "informative"] = "given"
    targets: int = 0
    """How many, neither more nor fewer (in the given order at most all); 0: all, or as many as are needed."""
    position_sigma_m: float = 0.45
    yaw_sigma_rad: float = math.radians(7.0)
    """In informative order without a number it ends when the pose is as certain as this, 1 sigma."""

    def max_holds(self, lamps: int) -> int:
        """Return how many holds there are at most with so many lamps."""
        if self.order == "given":
            return min(self.targets, lamps) if self.targets else lamps
        return self.targets or ROUNDS * lamps

    def usable(self, lamps: Sequence[Lamp]) -> Sequence[Lamp]:
        """Return those of `lamps` that may be lit."""
        return lamps[: self.max_holds(len(lamps))] if self.order == "given" else lamps

    def expected_holds(self, lamps: int) -> int:
        """Return how many holds a person should expect."""
        return self.targets or lamps if self.order == "informative" else self.max_holds(lamps)

    def uncertainty_ratio(self, solution: Solution | None) -> float:
        """Return how many times too uncertain a pose is: 1 is sure enough, infinite is none."""
        if solution is None:
            return math.inf
        return max(
            solution.position_sigma_m / self.position_sigma_m, solution.yaw_sigma_rad / self.yaw_sigma_rad
        )
