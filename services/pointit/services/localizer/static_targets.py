"""Localization by pointing at lamps that are lit one after the other (paper, §III-B).

In the order given (two of them are the paper's case), or each time the one that tells most, until the pose
is sure enough. Pure: rays and the time go in, lamps to switch, progress and the pose come out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pointit.schemas import NS_PER_S, Lamp, Localization, PointingRay
from pointit.services.localizer import rays as ray_math
from pointit.services.localizer.estimator import Pointings, Refusal, Solution, Trust, solve
from pointit.services.localizer.hold import Hold, Timing
from pointit.services.localizer.next_target import EYES_M, Acuity, next_target
from pointit.services.localizer.outputs import LampSwitch, Output, Phase, extent, pose_message

FEWEST = 2
"""Lamps before a pose can be tried."""

WORTHWHILE = 0.9
"""A lamp comes again when the hold before has made the pose surer by this factor, or the pose will not do."""

ROUNDS = 2
"""When as many lamps are lit as are needed, each is lit at most so often."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Which lamps are lit, in which order, and when it is enough."""

    order: Literal["given", "informative"] = "given"
    targets: int = 0
    """How many; 0: all in the given order, or as many as are needed."""
    position_sigma_m: float = 0.3
    yaw_sigma_rad: float = math.radians(3.0)
    """In informative order it ends when the pose is as certain as this."""

    def most(self, lamps: int) -> int:
        """Return how many holds there are at most with so many lamps."""
        if self.order == "given":
            return min(self.targets, lamps) if self.targets else lamps
        return self.targets or ROUNDS * lamps

    def planned(self, lamps: int) -> int:
        """Return how many holds a person should expect."""
        return self.targets or lamps if self.order == "informative" else self.most(lamps)


class StaticTargets:
    """One run of the procedure; `start` begins it again."""

    _holds: list[tuple[Hold, int]]
    """With the index of the lamp; the last one goes on."""
    _told: tuple[int, int]
    _solution: Solution | None
    """With what was gathered so far, however uncertain."""
    _lacking: float
    """How many times less certain than what is sure enough."""

    def __init__(
        self,
        lamps: Sequence[Lamp],
        timing: Timing | None = None,
        trust: Trust | None = None,
        choice: Choice | None = None,
        *,
        floor_m: float = 0.0,
    ) -> None:
        """Take the lamps in the order in which they are lit, at least one."""
        self._lamps = tuple(lamps)
        self.lamp_ids = frozenset(lamp.id for lamp in lamps)
        self._timing = timing if timing is not None else Timing()
        self._trust = trust if trust is not None else Trust()
        self._choice = choice if choice is not None else Choice()
        self._floor_m = floor_m
        self._most = self._choice.most(len(self._lamps))
        shared = self._most if self._choice.order == "given" or self._choice.targets else FEWEST
        self._enough = -(-self._trust.min_samples // shared)
        self._running = False
        self.since_ns = 0
        """When it was started."""
        self._clear()

    @property
    def running(self) -> bool:
        """Return whether a lamp is lit and rays are wanted."""
        return self._running

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return when the first ray was captured, and when the middle one was; -1 when there is none."""
        rays = self._rays
        return (rays[0].stamp_ns, rays[len(rays) // 2].stamp_ns) if rays else (-1, -1)

    def start(self, now_ns: int) -> list[Output]:
        """Light the first lamp."""
        out: list[Output] = [self._switch(on=False)] if self._running else []
        self._clear()
        self._running = True
        self.since_ns = now_ns
        return [*out, *self._light(now_ns)]

    def on_ray(self, ray: PointingRay) -> None:
        """Keep `ray` if it was captured while the person pointed at the lamp that is lit."""
        if self._running:
            self._hold.add(ray)

    def step(self, now_ns: int) -> list[Output]:
        """Go on to the next lamp, or to the end, when it is time."""
        if not self._running:
            return []
        hold = self._hold
        if hold.is_over(now_ns, self._enough):
            return self._next(now_ns)
        if not hold.is_hopeless(now_ns):
            return self._progress(now_ns)
        return self._end(
            now_ns,
            Refusal(
                f"only {len(hold.rays)} rays came while {self._lamp.id} was lit and {self._enough} "
                "are needed; check that the IMU is on and sends, then start again"
            ),
        )

    def cancel(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop, lamps off."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False), self._localization(now_ns, "cancelled", reason=reason)]

    def give_way(self, now_ns: int, reason: str) -> list[Output]:
        """Stop, lamps off, because somebody else has them."""
        return self._end(now_ns, Refusal(reason)) if self._running else []

    def again(self, now_ns: int) -> list[Output]:
        """Return what is to be seen and where it stands once more: the lamp may have been switched off."""
        self._told = (-1, -1)
        return [self._switch(on=True), *self._progress(now_ns)] if self._running else []

    @property
    def _hold(self) -> Hold:
        return self._holds[-1][0]

    @property
    def _lamp(self) -> Lamp:
        return self._lamps[self._holds[-1][1]]

    @property
    def _rays(self) -> list[PointingRay]:
        return [ray for hold, _ in self._holds for ray in hold.rays]

    def _clear(self) -> None:
        self._holds = []
        self._told = (-1, -1)
        self._solution = None
        self._lacking = math.inf

    def _light(self, now_ns: int) -> list[Output]:
        self._holds.append((Hold(now_ns, self._timing), self._chosen()))
        return [self._switch(on=True), *self._progress(now_ns)]

    def _chosen(self) -> int:
        """Return the index of the lamp to light now."""
        if self._choice.order == "given":
            return len(self._holds)
        trust, rays, solution = self._trust, self._rays, self._solution
        acuity = Acuity(
            ray_sigma_rad=max(trust.act_sigma_rad, trust.ray_sigma_rad),
            elevation_sigma_rad=trust.elevation_sigma_rad,
            bias_sigma_rad=ray_math.believed(trust, rays).bias_sigma_rad,
            independent=1.0,  # a reach errs until the next one, however long the hold
            body_sigma_m=trust.body_sigma_m,
            eyes_m=rays[-1].origin_m[2] if rays else EYES_M,
        )
        chosen = [index for _, index in self._holds]
        return next_target(
            [lamp.position_m for lamp in self._lamps],
            [chosen.count(index) for index in range(len(self._lamps))],
            acuity,
            floor_m=self._floor_m,
            place_m=None if solution is None else (solution.x_m, solution.y_m),
        )

    def _next(self, now_ns: int) -> list[Output]:
        """Light the next lamp, or end, the hold being over."""
        off = self._switch(on=False)
        count = len(self._holds)
        if self._choice.order == "given":
            if count < self._most:
                return [off, *self._light(now_ns)]
            return self._finish(now_ns, self._solve(self._trust))
        result = self._solve(self._trust) if count >= FEWEST else None
        sofar = self._solve(_lax(self._trust)) if isinstance(result, Refusal) else result
        self._solution = sofar if isinstance(sofar, Solution) else None
        before, self._lacking = self._lacking, self._lack(self._solution)
        if result is None or (count < self._most and self._goes_on(result, before)):
            return [off, *self._light(now_ns)]
        return self._finish(now_ns, result)

    def _goes_on(self, result: Solution | Refusal, before: float) -> bool:
        """Return whether another hold is worth the person's while.

        Until the pose is sure enough; but once all lamps were used, and the pose will do, only as long as it
        still gains.
        """
        if isinstance(result, Refusal):
            return True
        is_new = len({index for _, index in self._holds}) < len(self._lamps)
        return self._lacking > 1.0 and (is_new or self._lacking < WORTHWHILE * before)

    def _lack(self, solution: Solution | None) -> float:
        """Return how many times too uncertain it is: 1 is sure enough."""
        if solution is None:
            return math.inf
        return max(
            solution.position_sigma_m / self._choice.position_sigma_m,
            solution.yaw_sigma_rad / self._choice.yaw_sigma_rad,
        )

    def _solve(self, trust: Trust) -> Solution | Refusal:
        rays = self._rays
        lamps = [index for hold, index in self._holds for _ in hold.rays]
        stamps = np.array([ray.stamp_ns - rays[0].stamp_ns for ray in rays]) / NS_PER_S
        positions = np.array([lamp.position_m for lamp in self._lamps], dtype=np.float64)
        pointings = Pointings(stamps, ray_math.origins(rays), ray_math.directions(rays), positions[lamps])
        return solve(pointings, ray_math.believed(trust, rays), floor_m=self._floor_m)

    def _finish(self, now_ns: int, result: Solution | Refusal) -> list[Output]:
        if isinstance(result, Refusal):
            tried = len(self._holds)
            if self._choice.order == "informative" and tried > FEWEST:
                result = replace(result, reason=f"after pointing {tried} times {result.reason}")
            return self._end(now_ns, result)
        self._solution = result
        self._running = False
        return [
            self._switch(on=False),
            pose_message(result, "static_targets", self._rays[-1].stamp_ns, self._floor_m),
            self._localization(now_ns, "solved", residual_rad=result.residual_rad, progress=1.0),
        ]

    def _end(self, now_ns: int, refusal: Refusal) -> list[Output]:
        self._running = False
        return [
            self._switch(on=False),
            self._localization(now_ns, "refused", residual_rad=refusal.residual_rad, reason=refusal.reason),
        ]

    def _progress(self, now_ns: int) -> list[Output]:
        """Return where it stands, if that is not what was told last."""
        state = (len(self._holds), len(self._hold.rays))
        if state == self._told:
            return []
        self._told = state
        done = len(self._holds) - 1 + self._hold.share(now_ns)
        return [self._localization(now_ns, "sampling", progress=done / self._count)]

    @property
    def _count(self) -> int:
        return max(len(self._holds), self._choice.planned(len(self._lamps)))

    def _localization(
        self,
        now_ns: int,
        phase: Phase,
        *,
        progress: float = 0.0,
        residual_rad: float | None = None,
        reason: str = "",
    ) -> Localization:
        solution = self._solution
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            target_id=self._lamp.id if phase == "sampling" else "",
            target_index=len(self._holds) - 1,
            target_count=self._count,
            samples=sum(len(hold.rays) for hold, _ in self._holds),
            since_ns=self.since_ns,
            progress=progress,
            residual_rad=residual_rad,
            reason=reason,
            position_sigma_m=None if solution is None else extent(solution.position_sigma_m),
            yaw_sigma_rad=None if solution is None else extent(solution.yaw_sigma_rad),
        )

    def _switch(self, *, on: bool) -> LampSwitch:
        return LampSwitch(self._lamp.id, on)


def _lax(trust: Trust) -> Trust:
    """Return `trust` for a pose so far: how uncertain it is does not matter."""
    return replace(trust, max_position_sigma_m=math.inf, max_yaw_sigma_rad=math.inf)
