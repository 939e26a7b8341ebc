"""Selection methods with one fault each, made from the template, and the check that must catch it."""

import time
from dataclasses import replace
from typing import Any

from pydantic import Field

from pointit.plugins import Config, MethodConfig, Pointing, Progress, Surroundings
from pointit.testing.templates.selection_method import METHOD, Method
from pointit.testing.templates.selection_method.fake import DEVICE
from tests.unit.testing_kit.faulty_sources import Fault


class UsesTheClock(Method):
    def step(self, pointing: Pointing) -> Progress:
        cursor = pointing.cursor.model_copy(update={"stamp_ns": time.time_ns()})
        return super().step(pointing._replace(cursor=cursor))


class NeverLatches(Method):
    def step(self, pointing: Pointing) -> Progress:
        result = super().step(pointing)
        self._latched = None
        return result


class IgnoresLatch(Method):
    def latch(self, object_id: str) -> None:
        """Do nothing."""


class LatchesForEver(Method):
    def step(self, pointing: Pointing) -> Progress:
        latched = self._latched
        result = super().step(pointing)
        self._latched = self._latched or latched
        return result


class FiresTheLast(Method):
    """Selects what was left."""

    last: str | None = None

    def step(self, pointing: Pointing) -> Progress:
        result = super().step(pointing)
        if pointing.under is None:
            result, self.last = Progress(fired=self.last if self._gone() else None), self.last
        else:
            self.last, self.since = pointing.under, 0
        return result

    def _gone(self) -> bool:
        self.since += 1
        return self.since == 20


class AddsUpPassing(Method):
    def step(self, pointing: Pointing) -> Progress:
        spent_ns, self._object = self._spent_ns, pointing.under
        result = super().step(pointing)
        self._spent_ns = max(self._spent_ns, spent_ns)
        return result


class ReportsSeconds(Method):
    def step(self, pointing: Pointing) -> Progress:
        return super().step(pointing)._replace(progress=self._spent_ns / 1e8)


class SharesState(Method):
    everybody = 0

    def step(self, pointing: Pointing) -> Progress:
        SharesState.everybody += pointing.under == "object 1"
        result = super().step(pointing)
        return result if self.everybody < 400 else result._replace(progress=1.0)


class CountsGaps(Method):
    def step(self, pointing: Pointing) -> Progress:
        stamp_ns = pointing.cursor.stamp_ns
        if self._stamp_ns is not None and self._object == pointing.under and stamp_ns > self._stamp_ns:
            self._spent_ns += stamp_ns - self._stamp_ns
            self._stamp_ns = stamp_ns
        return super().step(pointing)


class DividesByTheStep(Method):
    def step(self, pointing: Pointing) -> Progress:
        if self._stamp_ns is not None:
            self.rate_hz = 1e9 / (pointing.cursor.stamp_ns - self._stamp_ns)
        return super().step(pointing)


class NeverForgets(Method):
    def __init__(self, config: MethodConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self.spent: dict[str | None, list[int]] = {}

    def step(self, pointing: Pointing) -> Progress:
        self.spent.setdefault(pointing.under, []).append(pointing.cursor.stamp_ns)
        return super().step(pointing)


class DwellConfig(Config):
    """Without the time that every method has."""

    seconds: float = Field(default=0.8, description="time")


def fault(check: str, words: str, make: Any, config: type[Config] = MethodConfig) -> Fault:
    """Return the template with another method."""
    return Fault(check, words, replace(DEVICE, plugin=replace(METHOD, make=make, config=config)))


FAULTS: dict[str, Fault] = {
    "uses_the_clock": fault("selects", "there fired nothing", UsesTheClock),
    "never_latches": fault("selects", "'object 3', 'object 3'", NeverLatches),
    "ignores_latch": fault("latches", "was latched, and fired all the same", IgnoresLatch),
    "latches_for_ever": fault("latches", "stayed latched", LatchesForEver),
    "fires_the_last": fault("selects_only_hovered", "pointed at 'nothing', and", FiresTheLast),
    "adds_up_passing": fault("passes", "on each of many objects", AddsUpPassing),
    "reports_seconds": fault("progress", "a progress was", ReportsSeconds),
    "shares_state": fault("deterministic", "gave other results", SharesState),
    "counts_gaps": fault("gaps", "and it fired", CountsGaps),
    "divides_by_the_step": fault("odd_cursors", "raised ZeroDivisionError", DividesByTheStep),
    "never_forgets": fault("many_objects", "it held", NeverForgets),
    "no_dwell_time": fault("parameters", "`dwell_s` is None", Method, DwellConfig),
}
