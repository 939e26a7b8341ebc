# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""Presence on Zenoh: tokens that come and go, and who is present here or elsewhere."""

import contextlib
import threading
from collections.abc import Callable, Mapping

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.runtime.bus.endpoints import PresenceWatcher
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.zenoh.wire_format import name_from_key
from pointit.schemas import SchemaError
from pointit.schemas.topics import ANY, Presence

MAX_TOKEN_CHARACTERS = 5000
"""Longer ones are cut: nothing can parse them, but they are present."""


class LivelinessSubscriber:
    """Reports tokens that are there now, and changes.

    While the loop is busy, only the tokens wait whose last change differs from what was reported: never more
    than are present or reported, however many come and go.
    """

    def __init__(
        self,
        session: zenoh.Session,
        pattern: str,
        handler: Callable[[Mapping[str, bool]], None],
        dispatcher: Dispatcher,
    ) -> None:
        """Begin to look at `pattern`; `dispatcher` calls `handler` with what came (True) and went (False)."""
        self._handler = handler
        self._dispatcher = dispatcher
        self._lock = threading.Lock()
        self._reported: set[str] = set()
        """Present tokens, as last reported to the handler."""
        self._changed: dict[str, None] = {}
        """Tokens to report, in order: each is the opposite of what was reported."""
        self._marked = False
        self._closed = False
        self._subscriber = session.liveliness().declare_subscriber(
            pattern, Callback(self._on_token, indirect=False), history=True
        )

    def close(self) -> None:
        """Look no more; no handler runs afterwards."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()

    def _on_token(self, sample: zenoh.Sample) -> None:  # on Zenoh's threads
        token = str(sample.key_expr)[:MAX_TOKEN_CHARACTERS]
        with self._lock:
            self._changed.pop(token, None)
            if (sample.kind == zenoh.SampleKind.PUT) != (token in self._reported):
                self._changed[token] = None
            if self._marked:
                return
            self._marked = True
        self._dispatcher.schedule(self)

    def drain(self) -> None:
        """Report the changes. Runs in the loop."""
        with self._lock:
            changed, self._changed = self._changed, {}
            self._marked = False
            self._reported ^= changed.keys()
        if changed and not self._closed:
            self._handler({token: token in self._reported for token in changed})


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
