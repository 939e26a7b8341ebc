"""Pointing at one lamp to set the pose right: "point at the lamp once" (pointing.md §3, §4).

Pure: rays and the time go in; the lamp, progress and the anchor come out.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pointit.schemas import Anchor, Lamp, Localization, PointingRay
from pointit.services.localizer import rays as ray_math
from pointit.services.localizer.hold import Hold, Timing
from pointit.services.localizer.outputs import MEASURED, LampSwitch, Output, Phase
from pointit.services.localizer.rays import Mean


@dataclass(frozen=True, kw_only=True)
class Steadiness:
    """What makes a hold an anchor."""

    max_spread_rad: float = math.radians(3.0)
    """Rms of the rays about their mean."""
    min_samples: int = 10


class Anchoring:
    """One pointing at one lamp; `start` begins it again."""

    def __init__(
        self,
        lamp: Lamp,
        judge: Callable[[Lamp, Mean, str], Anchor],
        timing: Timing | None = None,
        steadiness: Steadiness | None = None,
        *,
        occupies: Iterable[str] = (),
    ) -> None:
        """Prepare.

        Args:
            lamp: to point at.
            judge: returns the anchor that lamp and mean ray make, and does with it what is to be done; the
                text is why it must not be taken, mostly empty.
            timing: how long the lamp is lit.
            steadiness: what is demanded.
            occupies: ids of the lamps that nobody else may use meanwhile, besides `lamp`.
        """
        self._lamp = lamp
        self.lamp_ids = frozenset((lamp.id, *occupies))
        self._judge = judge
        self._timing = timing if timing is not None else Timing()
        self._steadiness = steadiness if steadiness is not None else Steadiness()
        self._hold = Hold(0, self._timing)
        self._running = False
        self.since_ns = 0
        """When it was started."""
        self._told = -1

    @property
    def running(self) -> bool:
        """Return whether the lamp is lit and rays are wanted."""
        return self._running

    def start(self, now_ns: int) -> list[Output]:
        """Light the lamp."""
        self._hold = Hold(now_ns, self._timing)
        self._running = True
        self.since_ns = now_ns
        return self.again(now_ns)

    def on_ray(self, ray: PointingRay) -> None:
        """Keep `ray` if it was captured while the person pointed at the lamp."""
        if self._running:
            self._hold.add(ray)

    def step(self, now_ns: int) -> list[Output]:
        """End when it is time."""
        if not self._running:
            return []
        hold, fewest = self._hold, self._steadiness.min_samples
        if hold.is_over(now_ns, fewest):
            return self._finish(now_ns)
        if not hold.is_hopeless(now_ns):
            return self._progress(now_ns)
        return self._end(
            now_ns,
            f"only {len(hold.rays)} rays came while {self._lamp.id} was lit and {fewest} are needed; check "
            "that the IMU is on and sends, then ask again",
        )

    def cancel(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop, lamp off; the pose stays."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False), self._localization(now_ns, "cancelled", reason=reason)]

    def give_way(self, now_ns: int, reason: str) -> list[Output]:
        """Stop, lamp off, because somebody else has it."""
        return self._end(now_ns, reason) if self._running else []

    def again(self, now_ns: int) -> list[Output]:
        """Return what is to be seen and where it stands once more: the lamp may have been switched off."""
        self._told = -1
        return [self._switch(on=True), *self._progress(now_ns)] if self._running else []

    def _finish(self, now_ns: int) -> list[Output]:
        mean = ray_math.mean(self._hold.rays)
        if mean is None:
            return self._end(now_ns, "the rays point to all sides; hold the arm still and try again")
        limit_rad = self._steadiness.max_spread_rad
        wrong = ""
        if mean.spread_rad > limit_rad:
            wrong = (
                f"the arm wandered by {math.degrees(mean.spread_rad):.1f}° while {self._lamp.id} was lit and "
                f"at most {math.degrees(limit_rad):.1f}° is accepted; hold it still and try again"
            )
        anchor = self._judge(self._lamp, mean, wrong)
        if not anchor.accepted and anchor.reason != MEASURED:
            return [anchor, *self._end(now_ns, anchor.reason)]
        self._running = False
        return [
            self._switch(on=False),
            anchor,
            self._localization(now_ns, "solved", progress=1.0, reason=anchor.reason),
        ]

    def _end(self, now_ns: int, reason: str) -> list[Output]:
        self._running = False
        return [self._switch(on=False), self._localization(now_ns, "refused", reason=reason)]

    def _progress(self, now_ns: int) -> list[Output]:
        if len(self._hold.rays) == self._told:
            return []
        self._told = len(self._hold.rays)
        return [self._localization(now_ns, "sampling", progress=self._hold.share(now_ns))]

    def _localization(
        self, now_ns: int, phase: Phase, *, progress: float = 0.0, reason: str = ""
    ) -> Localization:
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            purpose="anchor",
            target_id=self._lamp.id if phase == "sampling" else "",
            target_count=1,
            samples=len(self._hold.rays),
            since_ns=self.since_ns,
            progress=progress,
            reason=reason,
        )

    def _switch(self, *, on: bool) -> LampSwitch:
        return LampSwitch(self._lamp.id, on)
