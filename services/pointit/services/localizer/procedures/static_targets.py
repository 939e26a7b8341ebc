"""Localization by pointing at lamps that are lit one after the other (paper, §III-B).

In the order given (two of them are the paper's case) or the most informative one first: as many as
configured, or until the pose is certain enough. Pure: rays and the time go in; progress and the pose come
out.
"""

import math
from collections.abc import Sequence

import numpy as np

from pointit.schemas import NS_PER_S, Lamp, PointingRay
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import rays as ray_math
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.outputs import Output, pose_message
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure
from pointit.services.localizer.procedures.lamps import max_holds, usable
from pointit.services.localizer.procedures.next_target import EYES_M, ObservationModel, next_target
from pointit.services.localizer.verification.holds import held, outlier_lamps

MIN_LAMPS = 2
"""Number of lamps before a pose can be solved."""


class StaticTargets(LampProcedure):
    """One run of the procedure."""

    def __init__(self, lamps: Sequence[Lamp], config: LocalizerConfig) -> None:
        """Create the procedure for `lamps`, at least one, in the order of lighting."""
        self._lamps = tuple(lamps)
        self._settings = config.believed()
        self._max_holds = max_holds(config, len(self._lamps))
        shared = self._max_holds if config.order == "given" or config.targets else MIN_LAMPS
        super().__init__(
            (lamp.id for lamp in lamps), config, -(-self._settings.min_samples // shared), "start again"
        )

    @property
    def targets(self) -> Sequence[Lamp]:
        """Return the lamps that are, were or may be pointed at."""
        return usable(self._config, self._lamps)

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return the stamps of the first and the middle ray, -1 if there are none."""
        rays = self._rays
        return (rays[0].stamp_ns, rays[len(rays) // 2].stamp_ns) if rays else (-1, -1)

    @property
    def _rays(self) -> list[PointingRay]:
        return [ray for hold, _ in self._holds for ray in hold.rays]

    def _next_lamp(self) -> Lamp:
        if self._config.order == "given":
            return self._lamps[len(self._holds)]
        settings, rays, solution = self._settings, self._rays, self._solution
        observation_model = ObservationModel(
            ray_sigma_rad=settings.act_sigma_rad,
            elevation_sigma_rad=settings.elevation_sigma_rad,
            bias_sigma_rad=ray_math.believed(settings, rays).bias_sigma_rad,
            body_sigma_m=settings.body_sigma_m,
            eyes_m=rays[-1].origin_m[2] if rays else EYES_M,
        )
        chosen = [lamp.id for _, lamp in self._holds]
        best = next_target(
            [lamp.position_m for lamp in self._lamps],
            [chosen.count(lamp.id) for lamp in self._lamps],
            observation_model,
            floor_m=self._config.floor_m,
            place_m=None if solution is None else (solution.x_m, solution.y_m),
        )
        return self._lamps[best]

    def _held(self, now_ns: int) -> list[Output]:
        count = len(self._holds)
        if self._config.order == "given":
            if count < self._max_holds:
                return self._light(now_ns)
            return self._finish(now_ns, self._solve())
        result = self._solve() if count >= MIN_LAMPS else None
        sofar = self._so_far() if isinstance(result, Refusal) else result
        self._solution = sofar if isinstance(sofar, Solution) else None
        if result is None or (count < self._max_holds and self._goes_on(result)):
            return self._light(now_ns)
        return self._finish(now_ns, result)

    def _goes_on(self, result: Solution | Refusal) -> bool:
        """Return True if another hold is useful. A second one at a lamp, if accepted, has the same error."""
        if isinstance(result, Refusal) or self._config.targets:
            return True
        is_new = len({lamp.id for _, lamp in self._holds}) < len(self._lamps)
        return is_new and self._uncertainty_ratio() > 1.0

    def _uncertainty_ratio(self) -> float:
        """Return the ratio of the pose's uncertainty to the one that is needed, infinite without a pose."""
        solution, enough = self._solution, self._config.enough
        if solution is None:
            return math.inf
        turned_deg = math.degrees(solution.yaw_sigma_rad)
        return max(solution.position_sigma_m / enough.position_m, turned_deg / enough.yaw_deg)

    def _solve(self) -> Solution | Refusal:
        return held(self._pointings(), self._believed(), floor_m=self._config.floor_m, lamps=self._lit)

    def _so_far(self) -> Solution | Refusal:
        """Return the pose however uncertain it is, to choose the next lamp."""
        return solve(self._pointings(), self._believed().unlimited(), floor_m=self._config.floor_m)

    def _believed(self) -> SolverSettings:
        return ray_math.believed(self._settings, self._rays)

    def _pointings(self) -> Pointings:
        rays = self._rays
        targets = [lamp.position_m for hold, lamp in self._holds for _ in hold.rays]
        stamps = np.array([ray.stamp_ns - rays[0].stamp_ns for ray in rays]) / NS_PER_S
        positions = np.array(targets, dtype=np.float64).reshape(-1, 3)
        return Pointings(stamps, ray_math.origins(rays), ray_math.directions(rays), positions)

    def _finish(self, now_ns: int, result: Solution | Refusal) -> list[Output]:
        if isinstance(result, Refusal):
            reason, tried = result.reason, len(self._holds)
            if self._config.order == "informative" and tried > MIN_LAMPS:
                reason = f"after pointing {tried} times {reason}"
            return self._end(now_ns, "refused", reason, result.residual_rad)
        self._solution = result
        self._running = False
        return [
            pose_message(result, "static_targets", self._rays[-1].stamp_ns, self._config),
            self._localization(
                now_ns, "solved", residual_rad=result.residual_rad, reason=self._left_out(), progress=1.0
            ),
        ]

    def _left_out(self) -> str:
        outliers = outlier_lamps(self._pointings(), self._believed(), floor_m=self._config.floor_m)
        return (
            f"the pointing at {self._lit[outliers[0]]} missed it by far and does not count"
            if outliers
            else ""
        )

    @property
    def _lit(self) -> list[str]:
        """Return the ids of the lamps, in the order of their first holds."""
        return list(dict.fromkeys(lamp.id for _, lamp in self._holds))

    @property
    def _count(self) -> int:
        config = self._config
        expected = (config.targets or len(self._lamps)) if config.order == "informative" else self._max_holds
        return max(len(self._holds), expected)
