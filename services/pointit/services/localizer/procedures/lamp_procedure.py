"""Base of pointing at one or several lamps: one is lit and its hold is awaited.

Pure: rays and the time go in; lamps to switch and progress come out.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar, Literal

from pointit.schemas import Lamp, Localization, PointingRay
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.outputs import LampSwitch, Output, Phase
from pointit.services.localizer.procedures.hold import Hold


class LampProcedure(ABC):
    """Keeps one lamp lit while it runs; `start` restarts it."""

    PURPOSE: ClassVar[Literal["pose", "anchor"]] = "pose"

    def __init__(self, lamp_ids: Iterable[str], config: LocalizerConfig, min_rays: int, then: str) -> None:
        """Create the procedure.

        Args:
            lamp_ids: all lamps that other people cannot use meanwhile.
            config: times of each hold.
            min_rays: number of rays that a hold needs.
            then: advice if they did not come, as in `start again`.
        """
        self.lamp_ids = frozenset(lamp_ids)
        self.since_ns = 0
        """Time of the request."""
        self.begun_ns = 0
        """Time of the start."""
        self._config = config
        self._min_rays = min_rays
        self._then = then
        self._running = False
        self._holds: list[tuple[Hold, Lamp]] = []
        """Holds since the start; the last one is running."""
        self._published: tuple[str, int] | None = None

    @property
    def running(self) -> bool:
        """Return True if a lamp is lit and rays are needed."""
        return self._running

    @property
    def lit(self) -> str:
        """Return the id of the lamp that is lit, or `""` if none is."""
        return self._lamp.id if self._running else ""

    @property
    @abstractmethod
    def targets(self) -> Sequence[Lamp]:
        """Return the lamps that are, were or may be pointed at."""

    def start(self, now_ns: int, since_ns: int | None = None) -> list[Output]:
        """Light the first lamp; `since_ns` is the time of the request if that is not now."""
        out = [self._switch(on=False)] if self._running else []
        self._running = True
        self.since_ns = now_ns if since_ns is None else since_ns
        self.begun_ns = now_ns
        self._holds = []
        self._forget()
        return [*out, *self._light(now_ns)]

    def on_ray(self, ray: PointingRay) -> None:
        """Add `ray` to the hold of the lamp that is lit."""
        if self._running:
            self._hold.add(ray)

    def step(self, now_ns: int) -> list[Output]:
        """Continue when the hold is over, or end when it times out."""
        if not self._running:
            return []
        hold = self._hold
        if hold.is_over(now_ns, self._min_rays):
            return self._held(now_ns)
        if not hold.has_timed_out(now_ns):
            return self._progress(now_ns)
        return self._end(
            now_ns,
            f"only {len(hold.rays)} rays came while {self._lamp.id} was lit and {self._min_rays} are needed; "
            f"check that the IMU is on and sends, then {self._then}",
        )

    def cancel(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop, lamps off; the pose stays."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False), self._localization(now_ns, "cancelled", reason=reason)]

    def refuse(self, now_ns: int, reason: str) -> list[Output]:
        """Stop, lamps off, because the rays are useless."""
        return self._end(now_ns, reason) if self._running else []

    def stop_silently(self) -> list[Output]:
        """Stop, lamps off, without publishing: another person uses them, and the procedure will restart."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False)]

    def republish(self, now_ns: int) -> list[Output]:
        """Return the lamp and the progress again, since another localizer may have switched the lamp off."""
        self._published = None
        return [self._switch(on=True), *self._progress(now_ns)] if self._running else []

    @property
    def _hold(self) -> Hold:
        return self._holds[-1][0]

    @property
    def _lamp(self) -> Lamp:
        """Return the lamp that is lit, or was lit last."""
        return self._holds[-1][1]

    @abstractmethod
    def _forget(self) -> None:
        """Discard the results of earlier holds."""

    @abstractmethod
    def _next_lamp(self) -> Lamp:
        """Return the lamp to light now."""

    @abstractmethod
    def _held(self, now_ns: int) -> list[Output]:
        """Continue after a hold."""

    @abstractmethod
    def _share(self, now_ns: int) -> float:
        """Return the overall progress, 0 to 1."""

    @property
    def _count(self) -> int:
        """Return the expected number of holds."""
        return 1

    @property
    def _sigmas(self) -> tuple[float | None, float | None]:
        """Return the standard deviations of position (m) and yaw (rad) so far, None while unknown."""
        return None, None

    def _localization(
        self,
        now_ns: int,
        phase: Phase,
        *,
        progress: float = 0.0,
        residual_rad: float | None = None,
        reason: str = "",
    ) -> Localization:
        """Return a progress message."""
        position_sigma_m, yaw_sigma_rad = self._sigmas
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            purpose=self.PURPOSE,
            target_id=self._lamp.id if phase == "sampling" else "",
            target_index=len(self._holds) - 1,
            target_count=self._count,
            samples=sum(len(hold.rays) for hold, _ in self._holds),
            since_ns=self.since_ns,
            progress=progress,
            residual_rad=residual_rad,
            reason=reason,
            position_sigma_m=position_sigma_m,
            yaw_sigma_rad=yaw_sigma_rad,
        )

    def _light(self, now_ns: int) -> list[Output]:
        """Begin a hold at the next lamp."""
        self._holds.append((Hold(now_ns, self._config), self._next_lamp()))
        return self.republish(now_ns)

    def _end(self, now_ns: int, reason: str, residual_rad: float | None = None) -> list[Output]:
        self._running = False
        return [
            self._switch(on=False),
            self._localization(now_ns, "refused", residual_rad=residual_rad, reason=reason),
        ]

    def _progress(self, now_ns: int) -> list[Output]:
        """Return the progress if it differs from the last one published."""
        state = (self._lamp.id, len(self._hold.rays))
        if state == self._published:
            return []
        self._published = state
        return [self._localization(now_ns, "sampling", progress=self._share(now_ns))]

    def _switch(self, *, on: bool) -> Output:
        return LampSwitch(self._lamp.id, on)
