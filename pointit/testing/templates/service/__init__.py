"""Counts selections, and begins again on request."""

from typing import ClassVar

from pydantic import Field

from pointit.plugins import (
    Config,
    Context,
    Delivery,
    Message,
    Query,
    Reply,
    Request,
    SelectionEvent,
    Service,
    ServicePlugin,
    Topic,
    topics,
)

NAME = "template-service"


class Count(Message):
    """Number of selections since the start."""

    selected: int = 0


class Reset(Query):
    """Restart from zero."""


class ResetReply(Reply):
    """Empty."""


COUNT = Topic(
    key="template_service/count",
    message=Count,
    delivery=Delivery.STATE,
    rate_hz=None,
    writers=(NAME,),
    about="number of selections",
)
RESET = Request(
    key="template_service/reset", query=Reset, reply=ResetReply, server=NAME, about="begin again from zero"
)


class ServiceConfig(Config):
    """Parameters of the service."""

    first: int = Field(default=0, description="number from which it counts")


class SelectionCounter(Service[ServiceConfig]):
    """Counts selections."""

    NAME: ClassVar[str] = NAME
    SCOPE: ClassVar = "site"
    CONFIG = ServiceConfig

    def __init__(self, config: ServiceConfig, context: Context) -> None:
        """Declare publishers first, and subscriptions last."""
        super().__init__(config, context)
        self._selected = config.first
        self._seq = 0
        self._counts = self.bus.publisher(COUNT)
        self._publish()
        self.bus.serve(RESET, self._reset)
        self.bus.subscribe(topics.SELECTION_EVENTS, self._on_event)

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        if event.event == "selected":
            self._selected += 1
            self._publish()

    async def _reset(self, _query: Reset, _name: str) -> ResetReply:
        self._selected = self.config.first
        self._publish()
        return ResetReply()

    def _publish(self) -> None:
        self._seq += 1
        self._counts.put(Count(stamp_ns=self.clock.now_ns(), seq=self._seq, selected=self._selected))


SERVICE = ServicePlugin(
    summary="counts selections",
    config=ServiceConfig,
    make=SelectionCounter,
    reads=(topics.SELECTION_EVENTS,),
    writes=(COUNT,),
    serves=(RESET,),
)
