# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""Tokens of a plain session: who is present, ours and others'."""

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
"""Changes that wait for the loop; after more all are asked for anew."""
ASK_AFTER_S = 0.5
"""So long after changes were dropped all tokens are asked for: a flood passes first."""
ASK_TIMEOUT_S = 5.0
MAX_TOKEN_CHARACTERS = 5000
"""What is longer is cut: nobody can read it, but it is there."""


class LivelinessSubscriber:
    """Reads who is present: the last word on each token waits for the loop."""

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
        self._told: set[str] = set()
        """Who is present, as the handler knows it."""
        self._is_lacking = False
        """Changes were dropped, or the answer to our question was."""
        self._since: set[str] | None = None
        """Tokens that have changed since all were asked for: what is answered may be older."""
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
        """Tell what has changed; in the loop."""
        with self._lock:
            changes, self._waiting = self._waiting, {}
            self._marked = False
            if self._found is not None:
                newer = changes.keys() | (self._since or set())
                changes |= dict.fromkeys(self._told - self._found - newer, False)
                changes |= dict.fromkeys(self._found - self._told - newer, True)
                self._found = self._since = None
            if self._is_lacking and self._since is None and self._timer is None and not self._closed:
                self._is_lacking = False
                self._timer = self._loop.call_later(ASK_AFTER_S, self._ask)
        if self._closed:
            return
        for token, present in changes.items():
            (self._told.add if present else self._told.discard)(token)
        if changes:
            self._handler(changes)

    def _ask_for_all(self, session: zenoh.Session, pattern: str) -> None:
        """Ask who is there: a change that was dropped comes never again."""
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
                if refused:  # who is not among them may be there: ask again
                    self._is_lacking, self._since = True, None
                else:
                    self._found = found
            self._mark()

        with self._lock:
            self._since = set()
        log.warning("%d changes of tokens were too many; who is there is asked for anew", self.dropped)
        session.liveliness().get(pattern, Callback(take, finish, indirect=False), timeout=ASK_TIMEOUT_S)


class PlainToken:
    """Somebody of ours is present; kept here because Zenoh takes back what nobody refers to."""

    def __init__(self, token: zenoh.LivelinessToken) -> None:
        self._token: zenoh.LivelinessToken | None = token

    def close(self) -> None:
        """Be gone."""
        token, self._token = self._token, None
        if token is not None:
            token.undeclare()


def declared_token(session: zenoh.Session, key: str) -> PlainToken:
    """Return the token `key`, declared."""
    return PlainToken(session.liveliness().declare_token(key))
