"""Presence on Zenoh: liveliness tokens, and the names that this process or others announce."""

import contextlib
import functools
import threading
from collections import Counter
from collections.abc import Callable, Mapping

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.mailbox import Dispatcher
from pointit.runtime.bus.memory_bus import Participant, PresenceWatcher
from pointit.runtime.zenoh.declarations import name_from_key
from pointit.schemas import SchemaError
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import ANY, Presence

MAX_TOKEN_CHARACTERS = 5000
"""Maximum characters of a token. Longer ones are cut. They count as present, but no key has that form."""


class LivelinessSubscriber:
    """Reports present tokens and changes.

    While the loop is busy, only tokens whose state differs from the reported one are queued. The queue is
    therefore never longer than the number of tokens that are present or reported.

    Zenoh reports the end of a connection and the declarations of the next one on different threads. If the
    successor of a killed process declares the same token at once, the arrival may be reported before the
    departure. Changes are therefore counted. If a change does not agree with the count, Zenoh is queried.
    """

    def __init__(
        self,
        session: zenoh.Session,
        pattern: str,
        handler: Callable[[Mapping[str, bool]], None],
        dispatcher: Dispatcher,
    ) -> None:
        """Watch `pattern`. `handler` gets tokens with True if they came, False if they went."""
        self._session = session
        self._handler = handler
        self._dispatcher = dispatcher
        self._lock = threading.Lock()
        self._reported: set[str] = set()
        """Present tokens, as last reported to the handler."""
        self._changed: dict[str, None] = {}
        """Tokens to report, in order: each is the opposite of what was reported."""
        self._sums = Counter[str]()
        """Arrivals minus departures by token: 1 if it is present, unless reports are out of order."""
        self._pending_replies: dict[str, list[zenoh.Reply] | None] = {}
        """Tokens to query (None), or the replies so far to the last query."""
        self._marked = False
        self._closed = False
        on_token = Callback(self._on_token, indirect=False)
        self._subscriber = session.liveliness().declare_subscriber(pattern, on_token, history=True)

    def close(self) -> None:
        """Stop watching. No handler runs afterwards."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()

    def _on_token(self, sample: zenoh.Sample) -> None:  # on Zenoh's threads
        token = str(sample.key_expr)[:MAX_TOKEN_CHARACTERS]
        step = 1 if sample.kind == zenoh.SampleKind.PUT else -1
        with self._lock:
            count = self._sums[token] + step
            self._count_token(token, count)
            if token in self._pending_replies or (count > 0) != (step > 0):
                self._pending_replies[token] = None  # a pending answer may be older than this change
        self._wake()

    def _on_answer(self, token: str, answers: list[zenoh.Reply]) -> None:  # on Zenoh's threads
        with self._lock:
            if self._pending_replies.get(token) is not answers:
                return  # it is queried again
            if any(answer.ok is None for answer in answers):
                self._pending_replies[token] = None
            else:
                del self._pending_replies[token]
                self._count_token(token, int(bool(answers)))
        self._wake()

    def _count_token(self, token: str, count: int) -> None:
        self._sums[token] = count
        if not count:
            del self._sums[token]
        self._changed.pop(token, None)
        if (count > 0) != (token in self._reported):
            self._changed[token] = None

    def _wake(self) -> None:
        with self._lock:
            if self._marked:
                return
            self._marked = True
        self._dispatcher.schedule(self)

    def drain(self) -> None:
        """Report the changes. Runs in the loop."""
        questions: dict[str, list[zenoh.Reply]] = {}
        with self._lock:
            changed = self._changed
            self._changed = {}
            for token, answers in self._pending_replies.items():
                if answers is None:
                    questions[token] = []
            self._pending_replies |= questions
            self._marked = False
            self._reported ^= changed.keys()

        # Without the lock: handlers may close this, and Zenoh may call back at once
        if self._closed:
            return
        if changed:
            self._handler({token: token in self._reported for token in changed})
        for token, answers in questions.items():
            end = functools.partial(self._on_answer, token, answers)
            with contextlib.suppress(zenoh.ZError):  # a token that was cut
                self._session.liveliness().get(token, Callback(answers.append, end, indirect=False))


class ZenohWatcher(PresenceWatcher):
    """Reports the names that this process or other processes announce."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        presence: Presence,
        handler: PresenceHandler,
    ) -> None:
        super().__init__(bus, presence, handler)
        self._local_names = bus.exchange.present.setdefault(presence.key, {})
        self._withheld: set[str] = set()
        """Names that Zenoh has reported as gone while this process still announces them."""
        self._liveliness = LivelinessSubscriber(session, presence.at(ANY), self._on_tokens, bus.dispatcher)

    def notify_departure(self, name: str) -> None:
        """Report that `name` is gone if only this process still announced it."""
        if name in self._withheld:
            self._change(name, present=False)

    def _undeclare(self) -> None:
        super()._undeclare()
        self._liveliness.close()

    def _on_tokens(self, changes: Mapping[str, bool]) -> None:
        for token, present in changes.items():
            with contextlib.suppress(SchemaError):  # not a valid name of PointIt
                self._change(name_from_key(self.presence, token), present=present)

    def _change(self, name: str, *, present: bool) -> None:
        if not present and name in self._local_names:
            self._withheld.add(name)
            return
        self._withheld.discard(name)
        self.notify(name, present=present)
