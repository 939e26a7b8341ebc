"""My selection method: time on an object adds up, and drains away while the cursor is elsewhere.

Unlike `hold` it forgives a shaky hand: a moment off the object costs a moment, not all that was gathered.
"""

from pydantic import Field

from pointit.plugins import (
    NS_PER_S,
    MethodConfig,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
    Surroundings,
)

LONGEST_STEP_S = 0.1
"""Longest time that a step between two cursors counts, s."""


class LeakyConfig(MethodConfig):
    """Parameters; `dwell_s`, the time that selects, is there in every method."""

    drain: float = Field(default=0.5, ge=0, le=10, description="seconds lost per second elsewhere")


class Leaky:
    """The method for one person."""

    def __init__(self, config: LeakyConfig, _surroundings: Surroundings) -> None:
        self._config = config
        self._gathered_s: dict[str, float] = {}
        self._stamp_ns = 0
        self.latched = set[str]()

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Return the object under the cursor, its progress, and what to select now."""
        now_ns = pointing.cursor.stamp_ns
        under = pointing.under
        passed_s = (now_ns - self._stamp_ns) / NS_PER_S
        passed_s = min(passed_s, LONGEST_STEP_S)
        self._stamp_ns = now_ns
        self._drain(under, passed_s)
        self.latched &= {under}  # what has been left can be selected again
        if under is None or under in self.latched:
            return SelectionProgress(under)
        if not pointing.acts(under):
            return SelectionProgress(under)
        gathered_s = self._gathered_s.get(under, 0.0) + passed_s
        if gathered_s < self._config.dwell_s:
            self._gathered_s[under] = gathered_s
            return SelectionProgress(under, gathered_s / self._config.dwell_s)
        self.latch(under)
        return SelectionProgress(under, 1.0, fired=under)

    def _drain(self, under: str | None, passed_s: float) -> None:
        """Reduce the time of all objects but that under the cursor."""
        others = [object_id for object_id in self._gathered_s if object_id != under]
        for object_id in others:
            self._gathered_s[object_id] -= passed_s * self._config.drain
            if self._gathered_s[object_id] <= 0.0:
                del self._gathered_s[object_id]

    def latch(self, object_id: str) -> None:
        """Ignore the object until it is left."""
        self.latched.add(object_id)
        self._gathered_s.pop(object_id, None)


LEAKY = SelectionMethod(summary="time on an object, which drains off it", config=LeakyConfig, make=Leaky)
