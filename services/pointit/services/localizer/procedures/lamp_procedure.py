"""Base of pointing at one or several lamps: one is lit and its hold is awaited.

Pure: rays and the time go in; progress comes out, by which led-driver lights the lamp.
"""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any

from pointit.schemas import Lamp, PointingRay
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.outputs import Output, Phase
from pointit.services.localizer.procedures.hold import Hold
from pointit.services.localizer.procedures.procedure import Procedure


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
        return self._end(
            now_ns,
            "refused",
            f"only {len(hold.rays)} rays came while {self._lamp.id} was lit and {self._min_rays} are needed; "
            f"check that the IMU is on and sends, then {self._then}",
        )

    def republish(self, now_ns: int) -> list[Output]:
        """Return the progress again, since led-driver forgets who is silent."""
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
        is_on = phase == "sampling"
        return {
            "target_id": self._lamp.id if is_on else "",
            "target_index": len(self._holds) - 1,
            "target_count": self._count,
            "samples": sum(len(hold.rays) for hold, _ in self._holds),
            "lamps": self.lamp_ids if is_on else (),
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
