"""Services with one fault each, made from the template, and the check that must catch it."""

import asyncio
import time
from dataclasses import replace
from typing import Any

from pydantic import Field

from pointit.plugins import Context, SelectionEvent, topics
from pointit.testing import ServiceHarness
from pointit.testing.templates.service import (
    COUNT,
    RESET,
    SERVICE,
    Reset,
    ResetReply,
    SelectionCounter,
    ServiceConfig,
)
from pointit.testing.templates.service.fake import DEVICE
from tests.unit.testing_kit.faulty_sources import Fault


class FailsAtStart(SelectionCounter):
    def __init__(self, config: ServiceConfig, context: Context) -> None:
        super().__init__(config, context)
        raise LookupError("no camera")


class ReturnsAtOnce(SelectionCounter):
    async def run(self) -> None:
        await asyncio.sleep(0.05)


class AnswersNothing(SelectionCounter):
    def __init__(self, config: ServiceConfig, context: Context) -> None:
        super(SelectionCounter, self).__init__(config, context)


class FailsOnRequest(SelectionCounter):
    async def _reset(self, _query: Reset, _name: str) -> ResetReply:
        raise KeyError("anna")


class FailsOnMessages(SelectionCounter):
    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        raise ValueError(event.kind)


class MovesTheBelts(SelectionCounter):
    def __init__(self, config: ServiceConfig, context: Context) -> None:
        super().__init__(config, context)
        self.lamp = self.bus.publisher(topics.LAMP_COLOR, "1")


class Listens(SelectionCounter):
    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        super()._on_event(event, _name)
        self.bus.subscribe(topics.CURSOR, lambda _cursor, _user: None)


class Miscounts(SelectionCounter):
    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self._selected += 1
        super()._on_event(event, _name)


class CannotBeCancelled(SelectionCounter):
    async def run(self) -> None:
        for _ in range(30):
            try:
                await asyncio.sleep(1.0)
            except asyncio.CancelledError:
                continue


class SleepsInTheLoop(SelectionCounter):
    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        time.sleep(0.6)
        super()._on_event(event, _name)


class LeavesATask(SelectionCounter):
    async def run(self) -> None:
        self.task = asyncio.create_task(asyncio.sleep(3600))
        await super().run()


class UndescribedConfig(ServiceConfig):
    gain: float = 1.0


class StrictConfig(ServiceConfig):
    limit: int = Field(default=0, description="greatest number")


class RaisesKeyError(SelectionCounter):
    CONFIG = StrictConfig

    @classmethod
    def validate_config(cls, config: ServiceConfig) -> None:
        raise KeyError(config.first)


class Undescribed(SelectionCounter):
    CONFIG = UndescribedConfig


def fault(check: str, words: str, make: Any, **changes: Any) -> Fault:
    """Return the template with another service."""
    plugin = replace(SERVICE, make=make, config=make.CONFIG, **changes)
    harness: ServiceHarness = replace(DEVICE, plugin=plugin, patience_s=5.0)
    return Fault(check, words, harness)


FAULTS: dict[str, Fault] = {
    "fails_at_start": fault("starts", "`run` raised LookupError", FailsAtStart),
    "returns_at_once": fault("starts", "`run` returned by itself", ReturnsAtOnce),
    "answers_nothing": fault("answers", RESET.key, AnswersNothing),
    "fails_on_request": fault("answers", "raised KeyError", FailsOnRequest),
    "fails_on_messages": fault("hears", "50 of its handlers", FailsOnMessages),
    "writes_what_it_does_not_name": fault("uses_declared_rows", "`writes` does not name", MovesTheBelts),
    "reads_what_it_does_not_name": fault("uses_declared_rows", "`reads` does not name", Listens),
    "miscounts": fault("works", "a selection was not counted", Miscounts),
    "cannot_be_cancelled": fault("cancels", "still ran", CannotBeCancelled),
    "sleeps_in_the_loop": fault("does_not_block", r"stood still .*time\.sleep", SleepsInTheLoop),
    "leaves_a_task": fault("leaves_nothing", "task", LeavesATask),
    "undescribed_parameter": fault("parameters", "without a description: gain", Undescribed),
    "takes_the_row_of_another": fault(
        "parameters", "cannot write health", SelectionCounter, writes=(COUNT, topics.HEALTH)
    ),
    "long_summary": fault("parameters", "the summary is no line", SelectionCounter, summary="long " * 21),
    "unknown_argument": fault("parameters", "'host' is no parameter", SelectionCounter, argument="host"),
    "raises_key_error": fault("config_errors", "raised KeyError", RaisesKeyError),
}
