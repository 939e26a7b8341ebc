"""A shard of the selector on the bus: what the site's selector decides in; claims of its people out."""

import logging

from pointit.runtime.bus.contract import Publisher
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import ConfigError
from pointit.schemas import Claim, Selection, SelectionEvent
from pointit.schemas.topics import CLAIM, SELECTION, SELECTION_EVENTS, SERVICE_ALIVE
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.method import MakeMethod
from pointit.services.selector.shard_engine import NO_ARBITER, ShardEngine
from pointit.services.selector.site_role import Put, Use

log = logging.getLogger(__name__)


class ShardRole:
    """The selector of some people: it claims what they point at, and follows the decisions."""

    def __init__(
        self, config: SelectorConfig, bus: ServiceBus, clock: Clock, *, make: MakeMethod, put: Put, use: Use
    ) -> None:
        self._bus, self._clock, self._put, self._use = bus, clock, put, use
        self.engine = ShardEngine(config, make)
        self._claims: dict[str, Publisher[Claim]] = {
            user: bus.publisher(CLAIM, user) for user in config.people
        }
        self._parameters: tuple[str | None, float | None] = (None, None)

    def begin(self) -> None:
        """Do nothing: there is nothing to restore."""

    def subscribe(self) -> None:
        """Subscribe to the selection and its events, and watch the site's selector."""
        self._bus.subscribe(SELECTION, self._on_selection)
        self._bus.subscribe(SELECTION_EVENTS, self._on_event)
        self._bus.watch(SERVICE_ALIVE, self._on_service)

    def commit(self) -> None:
        """Do nothing: the site's selector keeps the journal."""

    def publish(self, user: str, message: Selection | SelectionEvent | Claim) -> None:
        """Publish what `engine` returned."""
        if isinstance(message, Claim):
            self._claims[user].put(message)

    def check(self, _now_ns: int) -> None:
        """Show in health if the site's selector cannot be reached. Called periodically."""
        self._warn()

    def close(self) -> None:
        """Do nothing: there is no journal."""

    def _on_service(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if instance == "selector":
            self.engine.has_arbiter = present
            self._warn()

    def _warn(self) -> None:
        problem = f"{NO_ARBITER}: start it, or mend the network" if not self.engine.has_arbiter else ""
        self._bus.warn("arbiter", problem)

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self.engine.on_selection(selection)
        parameters = selection.method, selection.dwell_s
        if selection.method is None or parameters == self._parameters:
            return
        self._parameters = parameters
        try:
            self._use(*parameters)
            self._bus.clear("follow")
        except (ValueError, ConfigError) as error:
            problem = f"method {selection.method} of the site's selector cannot be used here: {error}"
            log.error("%s", problem)  # noqa: TRY400 - the sentence says all
            self._bus.warn("follow", problem)

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self._put(self.engine.on_event(event))
