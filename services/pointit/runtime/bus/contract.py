"""The bus as services see it: typed topics, requests and presence; two implementations pass one suite.

All handlers run in the event loop that opened the bus, one at a time, never from within `put`.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

from pointit.schemas.base import Message, Query, Reply
from pointit.schemas.topics import ANY, Presence, Request, Topic

M = TypeVar("M", bound=Message)
M_contra = TypeVar("M_contra", bound=Message, contravariant=True)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
EVENT_CAPACITY = 1024
"""Events a reader may lag behind before the oldest are dropped, counted and reported."""
REQUEST_TIMEOUT_S = 2.0
"""Time (s) that a caller waits for a reply by default."""

Handler = Callable[[M, str], None]
"""Takes a message and what stands for the key's placeholder (empty where there is none)."""


Server = Callable[[Q, str], Awaitable[R]]
"""Takes a query and the placeholder's name; raises `RefusedError` with a sentence to refuse.

Each answer is a task of its own that ends with what `serve` returned, not with a caller that gives up.
"""


class Sent(NamedTuple):
    """When and by which process a message was published."""

    at_ns: int
    """Unix ns, by the clock of the publisher's machine."""
    process: str
    """Id of the session that published it."""


class Undecoded(Protocol):
    """A message of another process, as it arrived."""

    @property
    def size(self) -> int:
        """Return its number of bytes."""
        ...

    @property
    def sent(self) -> Sent | None:
        """Return when and by which process it was published, or None if it does not say."""
        ...

    def decode(self) -> Message:
        """Return the message.

        Raises:
            DecodeError: It is none.
        """
        ...


Tap = Callable[[Message | Undecoded, str], None]
"""Takes a message as it arrived and what stands for the key's placeholder, on any thread. Must not raise."""

AnyTopic = Topic[Any]
"""A row of the table, whatever its message."""

Recall = Callable[[AnyTopic], Iterable[tuple[str, Message]]]
"""Yields what is kept of a topic now: what stands for the key's placeholder, and the last message."""

MAX_IN_FLIGHT = 256
"""Answers that one server works on at a time; further callers are refused at once."""
UNDECLARE_S = 0.25
"""Time (s) for which a retired writer is still known elsewhere, unless its session is closed before."""


@dataclass(slots=True)
class SubscriptionStats:
    """Counters of a subscription since it was made."""

    received: int = 0
    dropped: int = 0
    """Conflated (latest, state) or overflowed (event)."""
    lost: int = 0
    """Events that a remote writer sent and that never arrived."""
    invalid: int = 0
    """Bytes that were not the message of their key."""
    complaint: str = ""
    """Error message about the last of them."""
    culprit: str = ""
    """Name on whose key it came, if known."""
    errors: int = 0
    """Handlers that raised."""


class Closable(Protocol):
    """Anything a bus hands out; closing twice is allowed, and closing the bus closes it."""

    def close(self) -> None:
        """Undeclare; no handler runs afterwards."""
        ...


class Declaration:
    """Something declared: undone once, by itself or with all that `held` lists."""

    def __init__(self, undo: Callable[[], object], held: "dict[Declaration, None] | None" = None) -> None:
        self._undo: Callable[[], object] | None = undo
        self._held = {} if held is None else held
        self._held[self] = None

    @property
    def is_closed(self) -> bool:
        """Return True if it was closed."""
        return self._undo is None

    def close(self) -> None:
        """Undo it, once."""
        undo, self._undo = self._undo, None
        if undo is not None:
            self._held.pop(self, None)
            undo()


class Publisher(Closable, Protocol[M_contra]):
    """Writes one key."""

    def put(self, message: M_contra) -> None:
        """Send `message`; returns at once, never blocks on readers.

        Raises:
            BusClosedError: the publisher or its bus is closed.
        """
        ...

    def close_nowait(self) -> None:
        """Close, where much else closes too: other processes may see the writer a moment longer."""
        ...


class Subscription(Closable, Protocol):
    """Reads one topic."""

    @property
    def traffic(self) -> SubscriptionStats:
        """Return the live counters."""
        ...


class Bus(Protocol):
    """Publish, subscribe, ask, serve, be present."""

    @property
    def site(self) -> str:
        """Return the name of the site that was joined."""
        ...

    def publisher(self, topic: Topic[M], name: str = "") -> Publisher[M]:
        """Declare a writer of the key `topic.at(name)`; declare once, put often."""
        ...

    def subscribe(
        self, topic: Topic[M], handler: Handler[M], name: str = ANY, *, kept: bool = True, every: bool = False
    ) -> Subscription:
        """Call `handler(message, name)` for what arrives on `topic` (of one `name`, or of all).

        *latest* and *state* keep the newest a key until handled; *event* keeps `EVENT_CAPACITY` in order, and
        so do the others if a reader wants `every` message.
        A reader of *state* gets the last value at once, when a writer that has put one is there, or else
        from who keeps it (see `serve_retained`), unless `kept` is false; a reader of *event* gets what is put
        from now on.
        """
        ...

    def tap(self, topic: AnyTopic, handler: Tap, name: str = ANY) -> Subscription:
        """Call `handler` for every message on `topic` at once, on the thread on which it arrives.

        For who only stores messages: it costs a fraction of `subscribe`, as nothing is decoded and no loop
        wakes up. What is kept of states comes as with `subscribe`.
        """
        ...

    def serve_retained(self, topics: Sequence[AnyTopic], recall: Recall) -> Closable:
        """Answer for the writers of `topics`, which are states, that are gone.

        Each reader gets what `recall` yields, once: those there are now, and those that come when they
        subscribe. What a living writer has put wins, whichever arrives first. Who keeps a topic reads it
        with `kept=False`.
        """
        ...

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request` (of one `name`, or of all)."""
        ...

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply.

        Raises:
            RefusedError: the server refuses with a reason, or reports its own error.
            NoAnswerError: nobody serves it, or not within `timeout_s`.
            RequestError: the reply is not the one of the table.
            BusClosedError: the bus was closed meanwhile.
        """
        ...

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed, or until this process dies."""
        ...

    def watch(self, presence: Presence, handler: Callable[[str, bool], None]) -> Closable:
        """Call `handler(name, present)` for everyone present now, and on every change."""
        ...

    @property
    def problem(self) -> str:
        """Return a message if the bus itself has a problem, else `""`."""
        ...

    @property
    def is_closed(self) -> bool:
        """Return True if the bus is closed or closing."""
        ...

    async def close(self) -> None:
        """Close everything that was declared through this bus; no handler runs afterwards."""
        ...


async def list_present(bus: Bus, presence: Presence, wait_s: float) -> set[str]:
    """Return the names that are present now, as far as they are known after `wait_s` (ms on one machine).

    Call this before announcing a name, and reject a name in use.
    """
    names: set[str] = set()

    def tell(name: str, is_present: bool) -> None:  # noqa: FBT001 - the handler's own signature
        (names.add if is_present else names.discard)(name)

    watching = bus.watch(presence, tell)
    try:
        await asyncio.sleep(wait_s)
    finally:
        watching.close()
    return names
