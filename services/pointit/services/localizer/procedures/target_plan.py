"""Selection and order of the lamps of a localization, and its stop criterion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import Lamp
from pointit.services.localizer.estimation.estimator import Solution

ROUNDS = 2
"""Largest number of holds at each lamp without a configured number."""


@dataclass(frozen=True, kw_only=True)
class TargetPlan:
    """Selection and order of the lamps, and the stop criterion."""

    order: Literal["given", "informative"] = "given"
    targets: int = 0
    """Number of lamps (in the given order at most all). 0: all, or until the pose is certain enough."""
    position_sigma_m: float = 0.45
    yaw_sigma_rad: float = math.radians(7.0)
    """Standard deviations at which informative order without a number ends."""

    def max_holds(self, lamps: int) -> int:
        """Return the largest number of holds with `lamps` lamps."""
        if self.order == "given":
            return min(self.targets, lamps) if self.targets else lamps
        return self.targets or ROUNDS * lamps

    def usable(self, lamps: Sequence[Lamp]) -> Sequence[Lamp]:
        """Return those of `lamps` that may be lit."""
        return lamps[: self.max_holds(len(lamps))] if self.order == "given" else lamps

    def expected_holds(self, lamps: int) -> int:
        """Return the number of holds that a person should expect."""
        return self.targets or lamps if self.order == "informative" else self.max_holds(lamps)

    def uncertainty_ratio(self, solution: Solution | None) -> float:
        """Return the ratio of a pose's uncertainty to the one that is needed, infinite without a pose."""
        if solution is None:
            return math.inf
        return max(
            solution.position_sigma_m / self.position_sigma_m, solution.yaw_sigma_rad / self.yaw_sigma_rad
        )
