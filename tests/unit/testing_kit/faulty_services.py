"""Services with one fault each, made from the template, and the test that must catch it."""

import asyncio

from pointit.plugins import Context, SelectionEvent, topics
from pointit.testing.templates.service import COUNT, RESET, Reset, ResetReply, SelectionCounter, ServiceConfig
from pointit.testing.templates.service.promises import ServicePromises
from tests.unit.testing_kit.faults import CaughtBy

caught_by = CaughtBy(ServicePromises)


@caught_by("works", "`run` returned by itself")
class ReturnsAtOnce(SelectionCounter):
    async def run(self) -> None:
        await asyncio.sleep(0.05)


@caught_by("works", RESET.key)
class AnswersNothing(SelectionCounter):
    def __init__(self, config: ServiceConfig, context: Context) -> None:
        super(SelectionCounter, self).__init__(config, context)


@caught_by("works", "raised KeyError")
class FailsOnRequest(SelectionCounter):
    async def _reset(self, _query: Reset, _name: str) -> ResetReply:
        raise KeyError("anna")


@caught_by("works", "50 of its handlers")
class FailsOnMessages(SelectionCounter):
    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        raise ValueError(event.kind)


@caught_by("uses_declared_rows", "`writes` does not name")
class MovesTheBelts(SelectionCounter):
    def __init__(self, config: ServiceConfig, context: Context) -> None:
        super().__init__(config, context)
        self.lamp = self.bus.publisher(topics.LAMP_COLOR, "1")


@caught_by("works", "a selection was not counted")
class Miscounts(SelectionCounter):
    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self._selected += 1
        super()._on_event(event, _name)


caught_by("uses_declared_rows", "cannot write health", writes=(COUNT, topics.HEALTH))(SelectionCounter)
caught_by("parameters", "'host' is no parameter", argument="host")(SelectionCounter)
