# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""Liveliness tokens of a plain session: our own, and those of others."""

import asyncio
import functools
import logging
import threading
from collections.abc import Callable, Mapping

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.mailbox import Dispatcher

log = logging.getLogger(__name__)

MAX_WAITING_TOKENS = 20_000
"""Limit of changes that wait for the loop. Beyond it all tokens are queried again."""
ASK_AFTER_S = 0.5
"""So long after changes were dropped all tokens are asked for: a flood passes first."""
ASK_TIMEOUT_S = 5.0
MAX_TOKEN_CHARACTERS = 5000
"""Longer ones are cut: nothing can parse them, but they are present."""


class LivelinessSubscriber:
    """Reports present tokens. The last change of each token waits for the loop."""

    def __init__(
        self,
        dispatcher: Dispatcher,
        handler: Callable[[Mapping[str, bool]], None],
        on_close: Callable[["LivelinessSubscriber"], None],
    ) -> None:
        self.dropped = 0
        """Changes that were too many."""
        self._dispatcher = dispatcher
        self._handler = handler
        self._on_close = on_close
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._waiting: dict[str, bool] = {}
        self._marked = False
        self._closed = False
        self._undeclare: Callable[[], None] = lambda: None
        self._reported: set[str] = set()
        """Present tokens as last reported to the handler."""
        self._is_lacking = False
        """Changes were dropped, or the answer to our question was."""
        self._since: set[str] | None = None
        """Tokens that changed since the last query for all, whose answer may be older."""
        self._found: set[str] | None = None
        """All there are, as answered."""
        self._timer: asyncio.TimerHandle | None = None
        self._ask: Callable[[], None] = lambda: None

    def declare(self, session: zenoh.Session, pattern: str) -> None:
        """Begin to look at `pattern`."""
        self._ask = functools.partial(self._ask_for_all, session, pattern)
        subscriber = session.liveliness().declare_subscriber(
            pattern, Callback(self._on_token, indirect=False), history=True
        )
        self._undeclare = subscriber.undeclare

    def close(self) -> None:
        """Look no more; no handler runs afterwards."""
        if not self._closed:
            self.stop()
            self._undeclare()
            self._on_close(self)

    def stop(self) -> None:
        """Handle nothing any more."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()

    def _on_token(self, sample: zenoh.Sample) -> None:  # on Zenoh's threads
        if self._closed:
            return
        token = str(sample.key_expr)[:MAX_TOKEN_CHARACTERS]
        with self._lock:
            if token not in self._waiting and len(self._waiting) >= MAX_WAITING_TOKENS:
                self.dropped += 1
                self._is_lacking = True
                return
            self._waiting[token] = sample.kind == zenoh.SampleKind.PUT
            if self._since is not None:
                self._since.add(token)
        self._mark()

    def _mark(self) -> None:
        with self._lock:
            if self._marked:
                return
            self._marked = True
        self._dispatcher.schedule(self)

    def drain(self) -> None:
        """Report the changes. Runs in the loop."""
        with self._lock:
            changes, self._waiting = self._waiting, {}
            self._marked = False
            if self._found is not None:
                newer = changes.keys() | (self._since or set())
                changes |= dict.fromkeys(self._reported - self._found - newer, False)
                changes |= dict.fromkeys(self._found - self._reported - newer, True)
                self._found = self._since = None
            if self._is_lacking and self._since is None and self._timer is None and not self._closed:
                self._is_lacking = False
                self._timer = self._loop.call_later(ASK_AFTER_S, self._ask)
        if self._closed:
            return
        for token, present in changes.items():
            (self._reported.add if present else self._reported.discard)(token)
        if changes:
            self._handler(changes)

    def _ask_for_all(self, session: zenoh.Session, pattern: str) -> None:
        """Query all tokens, since a dropped change is never repeated."""
        self._timer = None
        found: set[str] = set()
        refused: list[zenoh.Reply] = []

        def take(reply: zenoh.Reply) -> None:  # on Zenoh's threads
            if reply.ok is None:
                refused.append(reply)
            else:
                found.add(str(reply.ok.key_expr)[:MAX_TOKEN_CHARACTERS])

        def finish() -> None:  # on Zenoh's threads
            with self._lock:
                if refused:  # tokens may be missing from the answer: query again
                    self._is_lacking, self._since = True, None
                else:
                    self._found = found
            self._mark()

        with self._lock:
            self._since = set()
        log.warning("%d changes of tokens were too many; all tokens are queried again", self.dropped)
        session.liveliness().get(pattern, Callback(take, finish, indirect=False), timeout=ASK_TIMEOUT_S)


class PlainToken:
    """A declared token. Kept here because Zenoh undeclares tokens that are no longer referenced."""

    def __init__(self, token: zenoh.LivelinessToken) -> None:
        self._token: zenoh.LivelinessToken | None = token

    def close(self) -> None:
        """Undeclare the token."""
        token, self._token = self._token, None
        if token is not None:
            token.undeclare()


def declared_token(session: zenoh.Session, key: str) -> PlainToken:
    """Return the token `key`, declared."""
    return PlainToken(session.liveliness().declare_token(key))
