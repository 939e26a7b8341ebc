"""Selection methods with one fault each, made from the template, and the test that must catch it."""

import time

from pointit.plugins import Config, MethodConfig, PointingSample, SelectionProgress, Surroundings
from pointit.testing.templates.selection_method import Method
from pointit.testing.templates.selection_method.promises import MethodPromises
from tests.unit.testing_kit.faults import CaughtBy

caught_by = CaughtBy(MethodPromises)


@caught_by("selects", "there fired nothing")
class UsesTheClock(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        cursor = pointing.cursor.model_copy(update={"stamp_ns": time.time_ns()})
        return super().step(pointing._replace(cursor=cursor))


@caught_by("selects", "'object 3', 'object 3'")
class NeverLatches(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        result = super().step(pointing)
        self._latched = None
        return result


@caught_by("selects", "was latched, and fired all the same")
class IgnoresLatch(Method):
    def latch(self, object_id: str) -> None:
        """Do nothing."""


@caught_by("selects", "stayed latched")
class LatchesForEver(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        latched = self._latched
        result = super().step(pointing)
        self._latched = self._latched or latched
        return result


@caught_by("selects_nothing_else", "pointed at 'nothing', and")
class FiresTheLast(Method):
    """Selects what was left."""

    last: str | None = None

    def step(self, pointing: PointingSample) -> SelectionProgress:
        result = super().step(pointing)
        if pointing.under is None:
            result = SelectionProgress(fired=self.last if self._gone() else None)
            self.last = self.last
        else:
            self.last = pointing.under
            self.since = 0
        return result

    def _gone(self) -> bool:
        self.since += 1
        return self.since == 20


@caught_by("selects_nothing_else", "on each of many: ")
class AddsUpPassing(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        spent_ns = self._spent_ns
        self._object = pointing.under
        result = super().step(pointing)
        self._spent_ns = max(self._spent_ns, spent_ns)
        return result


@caught_by("selects", "a progress was")
class ReportsSeconds(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        return super().step(pointing)._replace(progress=self._spent_ns / 1e8)


@caught_by("deterministic", "gave other results")
class SharesState(Method):
    everybody = 0

    def step(self, pointing: PointingSample) -> SelectionProgress:
        SharesState.everybody += pointing.under == "object 1"
        result = super().step(pointing)
        return result if self.everybody < 400 else result._replace(progress=1.0)


@caught_by("selects_nothing_else", "and it fired")
class CountsGaps(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        stamp_ns = pointing.cursor.stamp_ns
        if self._stamp_ns is not None and self._object == pointing.under and stamp_ns > self._stamp_ns:
            self._spent_ns += stamp_ns - self._stamp_ns
            self._stamp_ns = stamp_ns
        return super().step(pointing)


@caught_by("odd_cursors", "raised ZeroDivisionError")
class DividesByTheStep(Method):
    def step(self, pointing: PointingSample) -> SelectionProgress:
        if self._stamp_ns is not None:
            self.rate_hz = 1e9 / (pointing.cursor.stamp_ns - self._stamp_ns)
        return super().step(pointing)


@caught_by("many_objects", "it held")
class NeverForgets(Method):
    def __init__(self, config: MethodConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self.spent: dict[str | None, list[int]] = {}

    def step(self, pointing: PointingSample) -> SelectionProgress:
        self.spent.setdefault(pointing.under, []).append(pointing.cursor.stamp_ns)
        return super().step(pointing)


caught_by("parameters", "`dwell_s` is None", config=Config)(Method)
