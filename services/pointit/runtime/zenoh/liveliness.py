"""Presence on Zenoh."""

import contextlib
from collections.abc import Callable, Mapping

import zenoh

from pointit.runtime.bus.endpoints import PresenceWatcher
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.transport.liveliness import LivelinessSubscriber
from pointit.runtime.zenoh.wire_format import name_from_key
from pointit.schemas import SchemaError
from pointit.schemas.topics import ANY, Presence


class ZenohWatcher(PresenceWatcher):
    """Tells who is present here or elsewhere."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        presence: Presence,
        handler: Callable[[str, bool], None],
    ) -> None:
        super().__init__(bus, presence, handler)
        self._here = bus.exchange.present.setdefault(presence.key, {})
        self._withheld: set[str] = set()
        """Names of which Zenoh has said that they are gone, while this process still announces them."""
        self._tokens = LivelinessSubscriber(session, presence.at(ANY), self._on_tokens, bus.dispatcher)

    def notify_departure(self, name: str) -> None:
        """Say that `name` is gone if only this process still announced it."""
        if name in self._withheld:
            self._change(name, False)

    def _undeclare(self) -> None:
        super()._undeclare()
        self._tokens.close()

    def _on_tokens(self, changes: Mapping[str, bool]) -> None:
        for token, present in changes.items():
            with contextlib.suppress(SchemaError):  # not a name of ours
                self._change(name_from_key(self.presence, token), present)

    def _change(self, name: str, present: bool) -> None:  # noqa: FBT001
        if not present and name in self._here:
            self._withheld.add(name)
            return
        self._withheld.discard(name)
        self.notify(name, present)
