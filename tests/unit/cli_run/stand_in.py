"""A page that serves nobody: it only says how many have it open."""

from typing import ClassVar

from pointit.bridges.web.config import WebConfig
from pointit.runtime.service.service import Context, Scope, Service


class StandIn(Service[WebConfig]):
    """Page service as a run sees it."""

    NAME: ClassVar[str] = "web"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = WebConfig
    viewers: ClassVar[int] = 0
    newest: ClassVar["StandIn"]

    def __init__(self, config: WebConfig, context: Context) -> None:
        super().__init__(config, context)
        type(self).newest = self
        self.bus.set_metric("viewers", self.viewers)


class Broken(StandIn):
    def __init__(self, config: WebConfig, context: Context) -> None:
        super().__init__(config, context)
        raise OSError("the port is taken")
