# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""Presence of other sessions: tokens that come and go."""

import threading
from collections.abc import Callable, Mapping

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.mailbox import Dispatcher

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
