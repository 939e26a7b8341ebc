"""Localization by pointing at lamps that are lit one after the other (paper, §III-B).

Pure: rays and the time go in, lamps to switch, progress and the pose come out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.schemas import NS_PER_S, Lamp, Localization, PointingRay
from pointit.services.localizer.estimator import Pointings, Refusal, Trust, solve
from pointit.services.localizer.outputs import LampSwitch, Output, Phase, pose_message


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long each lamp takes."""

    reaction_s: float = 1.5
    """After a lamp lights, until the person points at it; rays of that time do not count."""
    hold_s: float = 2.0
    """Then rays count."""
    patience_s: float = 5.0
    """How much longer a lamp stays lit when too few rays came."""


class StaticTargets:
    """One run of the procedure; `start` begins it again."""

    _index: int
    _rays: list[tuple[PointingRay, int]]
    _here: int
    """Rays at the lamp that is lit."""
    _newest_ns: int
    _counts_from_ns: int
    _told: tuple[int, int]

    def __init__(
        self,
        lamps: Sequence[Lamp],
        timing: Timing | None = None,
        trust: Trust | None = None,
        *,
        floor_m: float = 0.0,
    ) -> None:
        """Take the lamps in the order in which they are lit, at least one."""
        self._lamps = tuple(lamps)
        self.lamp_ids = frozenset(lamp.id for lamp in lamps)
        self._timing = timing if timing is not None else Timing()
        self._trust = trust if trust is not None else Trust()
        self._floor_m = floor_m
        self._enough = -(-self._trust.min_samples // len(self._lamps))
        self._running = False
        self.since_ns = 0
        """When it was started."""
        self._clear()

    @property
    def running(self) -> bool:
        """Return whether a lamp is lit and rays are wanted."""
        return self._running

    def start(self, now_ns: int) -> list[Output]:
        """Light the first lamp."""
        out: list[Output] = [self._switch(on=False)] if self._running else []
        self._clear()
        self._running = True
        self.since_ns = now_ns
        return [*out, *self._light(now_ns)]

    def on_ray(self, ray: PointingRay) -> None:
        """Keep `ray` if it was captured while the person pointed at the lamp that is lit."""
        if self._running and ray.stamp_ns > max(self._counts_from_ns, self._newest_ns):
            self._newest_ns = ray.stamp_ns
            self._rays.append((ray, self._index))
            self._here += 1

    def step(self, now_ns: int) -> list[Output]:
        """Go on to the next lamp, or to the end, when it is time."""
        if not self._running:
            return []
        end_ns = self._counts_from_ns + self._ns(self._timing.hold_s)
        if now_ns < end_ns:
            return self._progress(now_ns)
        if self._here >= self._enough:
            return self._next(now_ns)
        if now_ns < end_ns + self._ns(self._timing.patience_s):
            return self._progress(now_ns)
        return self._end(
            now_ns,
            Refusal(
                f"only {self._here} rays came while {self._lamps[self._index].id} was lit and {self._enough} "
                "are needed; check that the IMU is on and sends, then start again"
            ),
        )

    def cancel(self, now_ns: int) -> list[Output]:
        """Stop, lamps off."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False), self._localization(now_ns, "cancelled")]

    def give_way(self, now_ns: int, reason: str) -> list[Output]:
        """Stop, lamps off, because somebody else has them."""
        return self._end(now_ns, Refusal(reason)) if self._running else []

    def again(self, now_ns: int) -> list[Output]:
        """Return what is to be seen and where it stands once more: the lamp may have been switched off."""
        self._told = (-1, -1)
        return [self._switch(on=True), *self._progress(now_ns)] if self._running else []

    def _clear(self) -> None:
        self._index = 0
        self._rays = []
        self._here = 0
        self._newest_ns = -1
        self._counts_from_ns = 0
        self._told = (-1, -1)

    def _light(self, now_ns: int) -> list[Output]:
        self._here = 0
        self._counts_from_ns = now_ns + self._ns(self._timing.reaction_s)
        return [self._switch(on=True), *self._progress(now_ns)]

    def _next(self, now_ns: int) -> list[Output]:
        off = self._switch(on=False)
        if self._index + 1 < len(self._lamps):
            self._index += 1
            return [off, *self._light(now_ns)]
        positions = np.array([lamp.position_m for lamp in self._lamps], dtype=np.float64)
        first_ns = self._rays[0][0].stamp_ns
        pointings = Pointings(
            np.array([(ray.stamp_ns - first_ns) / NS_PER_S for ray, _ in self._rays]),
            np.array([ray.origin_m for ray, _ in self._rays]),
            np.array([ray.direction for ray, _ in self._rays]),
            positions[[index for _, index in self._rays]],
        )
        result = solve(pointings, self._trust, floor_m=self._floor_m)
        if isinstance(result, Refusal):
            return self._end(now_ns, result)
        self._running = False
        return [
            off,
            pose_message(result, "static_targets", self._newest_ns, self._floor_m),
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
        state = (self._index, self._here)
        if state == self._told:
            return []
        self._told = state
        held_s = max(0, now_ns - self._counts_from_ns) / NS_PER_S
        share = (self._index + min(1.0, held_s / self._timing.hold_s)) / len(self._lamps)
        return [self._localization(now_ns, "sampling", progress=share)]

    def _localization(
        self,
        now_ns: int,
        phase: Phase,
        *,
        progress: float = 0.0,
        residual_rad: float | None = None,
        reason: str = "",
    ) -> Localization:
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            target_id=self._lamps[self._index].id if phase == "sampling" else "",
            target_index=self._index,
            target_count=len(self._lamps),
            samples=len(self._rays),
            since_ns=self.since_ns,
            progress=progress,
            residual_rad=residual_rad,
            reason=reason,
        )

    def _switch(self, *, on: bool) -> LampSwitch:
        return LampSwitch(self._lamps[self._index].id, on)

    @staticmethod
    def _ns(duration_s: float) -> int:
        return round(duration_s * NS_PER_S)
