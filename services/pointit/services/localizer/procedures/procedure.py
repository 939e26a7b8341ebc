"""Life cycle of every localization procedure: started once by a request, stepped until it has ended.

Pure: rays, tracked objects and the time go in; progress, poses and anchors come out.
"""

from abc import ABC, abstractmethod
from typing import Any, Literal

from pointit.schemas import Localization, PointingRay, TrackedObjects
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Solution
from pointit.services.localizer.outputs import Output, Phase, finite_or_none


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
        solution = self._solution
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            purpose=self.purpose,
            since_ns=self.since_ns,
            progress=self._share(now_ns, phase) if progress is None else progress,
            residual_rad=residual_rad,
            reason=reason,
            position_sigma_m=None if solution is None else finite_or_none(solution.position_sigma_m),
            yaw_sigma_rad=None if solution is None else finite_or_none(solution.yaw_sigma_rad),
            **self._details(phase),
        )
