# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Presence on Zenoh."""

import asyncio
import contextlib
from collections.abc import Callable

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.endpoints import PresenceWatcher
from pointit.runtime.bus.local_broker import Participant
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
        self._loop = asyncio.get_running_loop()
        self._here = bus.exchange.present.setdefault(presence.key, {})
        self._withheld: set[str] = set()
        """Names of which Zenoh has said that they are gone, while this process still announces them."""
        self._subscriber = session.liveliness().declare_subscriber(
            presence.at(ANY), Callback(self._on_change, indirect=False), history=True
        )

    def notify_departure(self, name: str) -> None:
        """Say that `name` is gone if only this process still announced it."""
        if name in self._withheld:
            self._change(name, False)

    def _undeclare(self) -> None:
        super()._undeclare()
        self._subscriber.undeclare()

    def _on_change(self, sample: zenoh.Sample) -> None:  # on Zenoh's thread
        with contextlib.suppress(SchemaError, RuntimeError):  # not a name of ours; the loop is gone
            name = name_from_key(self.presence, str(sample.key_expr))
            self._loop.call_soon_threadsafe(self._change, name, sample.kind == zenoh.SampleKind.PUT)

    def _change(self, name: str, present: bool) -> None:  # noqa: FBT001
        if not present and name in self._here:
            self._withheld.add(name)
            return
        self._withheld.discard(name)
        self.notify(name, present)
