"""What pointing at lamps has in common, be it at one or at several: one is lit, its hold is waited for.

Pure: rays and the time go in; lamps to switch and progress come out.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar, Literal

from pointit.schemas import Lamp, Localization, PointingRay
from pointit.services.localizer.outputs import LampSwitch, Output, Phase
from pointit.services.localizer.procedures.clock_step import ClockStepDetector
from pointit.services.localizer.procedures.hold import Hold, Timing


class LampProcedure(ABC):
    """Keeps one lamp lit while it runs; `start` begins it again."""

    PURPOSE: ClassVar[Literal["pose", "anchor"]] = "pose"

    def __init__(self, lamp_ids: Iterable[str], timing: Timing | None, fewest: int, then: str) -> None:
        """Prepare.

        Args:
            lamp_ids: of all that nobody else may use meanwhile.
            timing: how long each lamp takes.
            fewest: rays that a hold needs.
            then: what to do when they did not come, as in `start again`.
        """
        self.lamp_ids = frozenset(lamp_ids)
        self.since_ns = 0
        """When it was asked for."""
        self.begun_ns = 0
        """When it was started."""
        self._timing = timing if timing is not None else Timing()
        self._fewest = fewest
        self._then = then
        self._running = False
        self._holds: list[tuple[Hold, Lamp]] = []
        """Since it was started; the last one goes on."""
        self._told: tuple[str, int] | None = None
        self._clock = ClockStepDetector()

    @property
    def running(self) -> bool:
        """Return True if a lamp is lit and rays are wanted."""
        return self._running

    @property
    def lit(self) -> str:
        """Return the id of the lamp that is lit; empty when none is."""
        return self._lamp.id if self._running else ""

    @property
    @abstractmethod
    def targets(self) -> Sequence[Lamp]:
        """Return the lamps that are, were or may be pointed at."""

    def start(self, now_ns: int, since_ns: int | None = None) -> list[Output]:
        """Light the first lamp; `since_ns`: when it was asked for, if that is not now."""
        out = [self._switch(on=False)] if self._running else []
        self._running = True
        self.since_ns = now_ns if since_ns is None else since_ns
        self.begun_ns = now_ns
        self._clock.begin(now_ns)
        self._holds = []
        self._forget()
        return [*out, *self._light(now_ns)]

    def on_ray(self, ray: PointingRay) -> None:
        """Keep `ray` if it was captured while the person pointed at the lamp that is lit."""
        if self._running:
            self._hold.add(ray)

    def step(self, now_ns: int) -> list[Output]:
        """Go on when the hold is over; end when it is hopeless; begin it anew when the clock was set back."""
        if not self._running:
            return []
        if back_ns := self._clock.by_ns(now_ns):
            self._set_back(back_ns, now_ns)
        hold = self._hold
        if hold.is_over(now_ns, self._fewest):
            return self._held(now_ns)
        if not hold.has_timed_out(now_ns):
            return self._progress(now_ns)
        return self._end(
            now_ns,
            f"only {len(hold.rays)} rays came while {self._lamp.id} was lit and {self._fewest} are needed; "
            f"check that the IMU is on and sends, then {self._then}",
        )

    def cancel(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop, lamps off; the pose stays."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False), self._localization(now_ns, "cancelled", reason=reason)]

    def refuse(self, now_ns: int, reason: str) -> list[Output]:
        """Stop, lamps off, because it cannot go on: the rays are worth nothing."""
        return self._end(now_ns, reason) if self._running else []

    def stop_silently(self) -> list[Output]:
        """Stop, lamps off, without a word: somebody else has them, and it will begin anew."""
        if not self._running:
            return []
        self._running = False
        return [self._switch(on=False)]

    def republish(self, now_ns: int) -> list[Output]:
        """Return what is to be seen and where it stands once more: the lamp may have been switched off."""
        self._told = None
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
        """Forget what was made of earlier holds."""

    @abstractmethod
    def _next_lamp(self) -> Lamp:
        """Return the lamp to light now."""

    @abstractmethod
    def _held(self, now_ns: int) -> list[Output]:
        """Go on, the hold being over."""

    @abstractmethod
    def _share(self, now_ns: int) -> float:
        """Return how far all of it is, 0 to 1."""

    @property
    def _count(self) -> int:
        """Return how many holds it will take, as far as is known."""
        return 1

    @property
    def _sigmas(self) -> tuple[float | None, float | None]:
        """Return one sigma of the position (m) and the yaw (rad) so far; none while nothing is known."""
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
        """Return where it stands."""
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
        self._holds.append((Hold(now_ns, self._timing), self._next_lamp()))
        return self.republish(now_ns)

    def _set_back(self, by_ns: int, now_ns: int) -> None:
        """Begin the hold anew that goes on; those before stay."""
        self.since_ns = max(0, self.since_ns - by_ns)
        self.begun_ns = max(0, self.begun_ns - by_ns)
        for hold, _ in self._holds[:-1]:
            hold.set_back(by_ns)
        self._holds[-1] = (Hold(now_ns, self._timing), self._lamp)
        self._told = None

    def _end(self, now_ns: int, reason: str, residual_rad: float | None = None) -> list[Output]:
        self._running = False
        return [
            self._switch(on=False),
            self._localization(now_ns, "refused", residual_rad=residual_rad, reason=reason),
        ]

    def _progress(self, now_ns: int) -> list[Output]:
        """Return where it stands, if that is not what was told last."""
        state = (self._lamp.id, len(self._hold.rays))
        if state == self._told:
            return []
        self._told = state
        return [self._localization(now_ns, "sampling", progress=self._share(now_ns))]

    def _switch(self, *, on: bool) -> Output:
        return LampSwitch(self._lamp.id, on)
