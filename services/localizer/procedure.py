"""Life cycle of every localization procedure, and the base of those that point at lamps.

Pure: rays, tracked objects and the time go in; progress, by which led-driver lights the lamp, poses and
anchors come out.

In one hold a lamp lights, the person notices, turns to it and settles, and then their rays count. The first
second or so is reaction, and an open-loop reach settles about two seconds after the light (pointing.md §4):
the hold begins when the reaction is over and the ray is steady.
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np

from pointit.schemas import NS_PER_S, Lamp, Localization, PointingRay, TrackedObjects
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import unfiltered_rays
from pointit.services.localizer.estimation.estimator import Solution
from pointit.services.localizer.outputs import Output, Phase, finite_or_none

STEADY_S = 0.4
"""Time over which a ray must be steady."""

MIN_RAYS = 4
"""Smallest number of rays in that time."""

MAX_RAYS = 8192
"""Largest number of rays in one hold, whatever their rate."""


class Procedure(ABC):
    """One procedure of one person."""

    purpose: Literal["pose", "anchor"] = "pose"

    def __init__(self, config: LocalizerConfig) -> None:
        self._config = config
        self._running = False
        self.since_ns = 0
        """Time of the request."""
        self._solution: Solution | None = None
        """Pose of the rays so far, None if there is none."""

    @property
    def running(self) -> bool:
        """Return True from the start to the end."""
        return self._running

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return the stamps of the first and the middle ray of a pose, -1 if there are none."""
        return -1, -1

    def start(self, now_ns: int, since_ns: int | None = None) -> list[Output]:
        """Start; `since_ns` is the time of the request if that is not now."""
        self._running = True
        self.since_ns = now_ns if since_ns is None else since_ns
        return self._begin(now_ns)

    def step(self, now_ns: int) -> list[Output]:
        """Continue, or end."""
        return self._continue(now_ns) if self._running else []

    def on_ray(self, ray: PointingRay) -> None:
        """Process a ray of the person, if they are used."""
        del ray

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Process positions of tracked objects, if they are used."""
        del tracker, message

    def on_yaw_origin_changed(self, now_ns: int, reason: str) -> list[Output]:
        """Process that later rays have another yaw origin than those before."""
        return self._end(now_ns, "refused", reason)

    def cancel(self, now_ns: int, reason: str = "") -> list[Output]:
        """End; the last pose stays."""
        return self._end(now_ns, "cancelled", reason) if self._running else []

    @abstractmethod
    def _begin(self, now_ns: int) -> list[Output]:
        """Return the first outputs."""

    @abstractmethod
    def _continue(self, now_ns: int) -> list[Output]:
        """Return the outputs of a step."""

    @abstractmethod
    def _details(self, phase: Phase) -> dict[str, Any]:
        """Return the fields of `Localization` that only this procedure has."""

    def _share(self, now_ns: int, phase: Phase) -> float:
        """Return the progress, 0 to 1."""
        del now_ns, phase
        return 0.0

    def _end(
        self, now_ns: int, phase: Phase, reason: str = "", residual_rad: float | None = None
    ) -> list[Output]:
        self._running = False
        return [self._localization(now_ns, phase, residual_rad=residual_rad, reason=reason)]

    def _localization(
        self,
        now_ns: int,
        phase: Phase,
        *,
        progress: float | None = None,
        residual_rad: float | None = None,
        reason: str = "",
    ) -> Localization:
        """Return a progress message; `progress` only if it is not that of `_share`."""
        if progress is None:
            progress = self._share(now_ns, phase)

        # Of the rays so far. Messages have no infinity, which means the same as no value.
        position_sigma_m: float | None = None
        yaw_sigma_rad: float | None = None
        if self._solution is not None:
            position_sigma_m = finite_or_none(self._solution.position_sigma_m)
            yaw_sigma_rad = finite_or_none(self._solution.yaw_sigma_rad)
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            purpose=self.purpose,
            since_ns=self.since_ns,
            progress=progress,
            residual_rad=residual_rad,
            reason=reason,
            position_sigma_m=position_sigma_m,
            yaw_sigma_rad=yaw_sigma_rad,
            **self._details(phase),
        )


class Hold:
    """Rays of one hold; those captured before it only determine its beginning."""

    def __init__(self, lit_ns: int, config: LocalizerConfig) -> None:
        """Create the hold of a lamp that lights at `lit_ns`."""
        self._config = config
        self._from_ns = lit_ns + round(config.reaction_s * NS_PER_S)
        self._latest_ns = self._from_ns + round(config.patience_s * NS_PER_S)
        """Time at which the hold begins even if the ray is not steady."""
        self._newest_ns = -1
        self._recent: deque[PointingRay] = deque()
        """Rays of the last `STEADY_S`, while the ray is not steady."""
        self._waits = config.steady_degps > 0.0
        self.rays: list[PointingRay] = []
        """Rays that count."""

    @property
    def is_settled(self) -> bool:
        """Return True if the ray was steady or need not be."""
        return not self._waits

    def add(self, ray: PointingRay) -> None:
        """Add `ray` unless it is not newer than the last."""
        if ray.stamp_ns <= self._newest_ns:
            return
        self._newest_ns = ray.stamp_ns
        if not self._waits:
            if ray.stamp_ns > self._from_ns and len(self.rays) < MAX_RAYS:
                self.rays.append(ray)
            return
        self._recent.append(ray)
        oldest_ns = ray.stamp_ns - round(STEADY_S * NS_PER_S)
        while self._recent[0].stamp_ns < oldest_ns:
            self._recent.popleft()
        if ray.stamp_ns <= self._from_ns:
            return
        if self._is_steady() or ray.stamp_ns >= self._latest_ns:
            self._settle()

    def is_over(self, now_ns: int, enough: int) -> bool:
        """Return True if the hold has lasted long enough and `enough` rays came."""
        return self.is_settled and now_ns >= self._end_ns and len(self.rays) >= enough

    def has_timed_out(self, now_ns: int) -> bool:
        """Return True if waiting for more rays is useless."""
        return now_ns >= self._end_ns + round(self._config.patience_s * NS_PER_S)

    def progress(self, now_ns: int) -> float:
        """Return the progress, 0 to 1."""
        if not self.is_settled:
            return 0.0
        held_s = max(0, now_ns - self._from_ns) / NS_PER_S
        return min(1.0, held_s / self._config.hold_s)

    @property
    def _end_ns(self) -> int:
        return self._from_ns + round(self._config.hold_s * NS_PER_S)

    def _settle(self) -> None:
        """Begin to count, with the recent rays after the reaction."""
        self._waits = False
        self._from_ns = max(self._from_ns, self._recent[0].stamp_ns - 1)
        self.rays = [ray for ray in self._recent if ray.stamp_ns > self._from_ns]
        self._recent.clear()

    def _is_steady(self) -> bool:
        """Return True if the mean directions of the two halves of the recent rays are close.

        Halves, because single rays jitter faster than the arm moves.
        """
        recent = self._recent
        span_s = (recent[-1].stamp_ns - recent[0].stamp_ns) / NS_PER_S
        if len(recent) < MIN_RAYS or span_s < 0.75 * STEADY_S:
            return False
        directions = unfiltered_rays.directions(recent)
        half = len(recent) // 2
        before = directions[:half].sum(axis=0)
        after = directions[-half:].sum(axis=0)
        sine = float(np.linalg.norm(np.cross(before, after)))
        angle_rad = math.atan2(sine, float(before @ after))
        limit_rad = math.radians(self._config.steady_degps) * span_s / 2.0  # half of the span between them
        return angle_rad <= limit_rad


class LampProcedure(Procedure):
    """Keeps one lamp lit while it runs."""

    def __init__(self, lamp_ids: Iterable[str], config: LocalizerConfig, min_rays: int, then: str) -> None:
        """Create the procedure.

        Args:
            lamp_ids: all lamps that other people cannot use meanwhile.
            config: times of each hold.
            min_rays: number of rays that a hold needs.
            then: advice if they did not come, as in `start again`.
        """
        super().__init__(config)
        self.lamp_ids = tuple(sorted({*lamp_ids}))
        self._min_rays = min_rays
        self._then = then
        self._holds: list[tuple[Hold, Lamp]] = []
        """Holds since the start; the last one is running."""
        self._published: tuple[str, int] | None = None

    @property
    def lit(self) -> str:
        """Return the id of the lamp that is lit, or `""` if none is."""
        return self._lamp.id if self._running else ""

    @property
    @abstractmethod
    def targets(self) -> Sequence[Lamp]:
        """Return the lamps that are, were or may be pointed at."""

    def on_ray(self, ray: PointingRay) -> None:
        """Add `ray` to the hold of the lamp that is lit."""
        if self._running:
            self._hold.add(ray)

    def _begin(self, now_ns: int) -> list[Output]:
        return self._light(now_ns)

    def _continue(self, now_ns: int) -> list[Output]:
        hold = self._hold
        if hold.is_over(now_ns, self._min_rays):
            return self._held(now_ns)
        if not hold.has_timed_out(now_ns):
            return self._progress(now_ns)
        reason = (
            f"only {len(hold.rays)} rays came while {self._lamp.id} was lit and {self._min_rays} are needed; "
            f"check that the IMU is on and sends, then {self._then}"
        )
        return self._end(now_ns, "refused", reason)

    def republish(self, now_ns: int) -> list[Output]:
        """Return the progress again, since led-driver forgets silent users."""
        self._published = None
        return self._progress(now_ns) if self._running else []

    @property
    def _hold(self) -> Hold:
        return self._holds[-1][0]

    @property
    def _lamp(self) -> Lamp:
        return self._holds[-1][1]

    @abstractmethod
    def _next_lamp(self) -> Lamp:
        """Return the lamp to light now."""

    @abstractmethod
    def _held(self, now_ns: int) -> list[Output]:
        """Continue after a hold."""

    @property
    def _count(self) -> int:
        return 1

    def _details(self, phase: Phase) -> dict[str, Any]:
        target_id = ""
        lamp_ids: tuple[str, ...] = ()
        if phase == "sampling":
            target_id = self._lamp.id
            lamp_ids = self.lamp_ids
        return {
            "target_id": target_id,
            "target_index": len(self._holds) - 1,
            "target_count": self._count,
            "samples": sum(len(hold.rays) for hold, _ in self._holds),
            "lamps": lamp_ids,
        }

    def _share(self, now_ns: int, phase: Phase) -> float:
        done = len(self._holds) - 1 + self._hold.progress(now_ns)
        return done / self._count if phase == "sampling" else 0.0

    def _light(self, now_ns: int) -> list[Output]:
        self._holds.append((Hold(now_ns, self._config), self._next_lamp()))
        return self.republish(now_ns)

    def _progress(self, now_ns: int) -> list[Output]:
        state = (self._lamp.id, len(self._hold.rays))
        if state == self._published:
            return []
        self._published = state
        return [self._localization(now_ns, "sampling")]
