"""Interface of the bus for services: typed topics, requests and presence. Two implementations pass one suite.

All handlers run in the event loop that opened the bus, one at a time, never from within `put`.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

from pointit.schemas.base import Message, Query, Reply
from pointit.schemas.problems import Problem
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import ANY, Presence, Request, Topic

M = TypeVar("M", bound=Message)
M_contra = TypeVar("M_contra", bound=Message, contravariant=True)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
Handler = Callable[[M, str], None]
"""Takes a message and the value of the key's placeholder (`""` without a placeholder)."""

Server = Callable[[Q, str], Awaitable[R]]
"""Takes a query and the value of the placeholder. Raises `RefusedError` with a sentence to refuse.

Each answer is a separate task. It ends with the declaration of `serve`, not when the caller gives up.
"""

AnyTopic = Topic[Any]
"""A topic of the table with any message."""

Recall = Callable[[AnyTopic], Iterable[tuple[str, Message]]]
"""Yields the retained states of a topic: value of the key's placeholder, and last message."""

EVENT_CAPACITY = 1024
"""Number of events in a reader's queue. Beyond it, the oldest are dropped, counted and reported."""
REQUEST_TIMEOUT_S = 2.0
"""Default timeout of a request, s."""
MAX_IN_FLIGHT = 256
"""Maximum number of calls that one server answers at a time. Further callers are refused at once."""
UNDECLARE_S = 0.25
"""Time for which other processes still see a retired writer, unless its session closes earlier, s."""


class Sent(NamedTuple):
    """Time and process that published a message."""

    at_ns: int
    """Unix ns, by the clock of the publisher's machine."""
    process: str
    """Id of the session that published it."""


class Undecoded(Protocol):
    """A message from another process, before decoding."""

    @property
    def size(self) -> int:
        """Return its number of bytes."""
        ...

    @property
    def sent(self) -> Sent | None:
        """Return the time and process that published it, or None if it has no stamp."""
        ...

    def decode(self) -> Message:
        """Return the message.

        Raises:
            DecodeError: It is none.
        """
        ...


Tap = Callable[[Message | Undecoded, str], None]
"""Takes an undecoded message and the value of the key's placeholder, on any thread. Must not raise."""


@dataclass(slots=True)
class SubscriptionStats:
    """Counters of a subscription since its creation."""

    received: int = 0
    dropped: int = 0
    """Messages that newer ones replaced (latest, state) or that overflowed the queue (event)."""
    lost: int = 0
    """Events of a remote writer that never arrived."""
    invalid: int = 0
    """Payloads that were no valid message of their key."""
    last_error: str = ""
    """Error message about the last of them."""
    last_error_name: str = ""
    """Placeholder's value in its key, if known."""
    errors: int = 0
    """Number of handler calls that raised."""
    last_failure: str = ""
    """Class and message of the last error that a handler raised."""
    last_failure_name: str = ""
    """Placeholder's value in the key of the message that it was called with, or `""`."""


class Closable(Protocol):
    """Base of all objects that a bus returns. Closing twice is allowed. Closing the bus closes them."""

    def close(self) -> None:
        """Undeclare. No handler runs afterwards."""
        ...


class Declaration:
    """A declaration that is undone once, by itself or with all others in `held`."""

    def __init__(self, undo: Callable[[], object], held: "dict[Declaration, None] | None" = None) -> None:
        self._undo: Callable[[], object] | None = undo
        self._held = {} if held is None else held
        self._held[self] = None

    @property
    def is_closed(self) -> bool:
        """Return True if it was closed."""
        return self._undo is None

    def close(self) -> None:
        """Undo the declaration, once."""
        undo = self._undo
        self._undo = None
        if undo is not None:
            self._held.pop(self, None)
            undo()


class Publisher(Closable, Protocol[M_contra]):
    """Writes one key."""

    def put(self, message: M_contra) -> None:
        """Send `message`. Returns at once and never blocks on readers.

        Raises:
            BusClosedError: If the publisher or its bus is closed.
        """
        ...

    def close_nowait(self) -> None:
        """Close together with many others. Other processes may see the writer a moment longer."""
        ...


class Subscription(Closable, Protocol):
    """Reads one topic."""

    @property
    def traffic(self) -> SubscriptionStats:
        """Return the live counters."""
        ...


class Bus(Protocol):
    """Bus with publishers, subscriptions, requests, servers and presence."""

    @property
    def site(self) -> str:
        """Return the name of the site."""
        ...

    def publisher(self, topic: Topic[M], name: str = "") -> Publisher[M]:
        """Declare a writer of the key `topic.at(name)`. Declare once, put often."""
        ...

    def subscribe(
        self,
        topic: Topic[M],
        handler: Handler[M],
        name: str = ANY,
        *,
        retained: bool = True,
        queue_all: bool = False,
    ) -> Subscription:
        """Call `handler(message, name)` for each message on `topic` (of one `name`, or of all).

        *latest* and *state* queue the newest message per key. *event* queues `EVENT_CAPACITY` messages in
        order, and so do the others if `queue_all`. A reader of *state* gets the last value at once, from the
        writer if it is present, or else from the keeper (see `serve_retained`) if `retained`. A reader of
        *event* gets only messages that are put from now on.
        """
        ...

    def tap(self, topic: AnyTopic, handler: Tap, name: str = ANY) -> Subscription:
        """Call `handler` for every message on `topic` at once, on the thread on which it arrives.

        For callers that only store messages. It costs a fraction of `subscribe`, since no message is decoded
        and no loop wakes up. Retained states arrive as with `subscribe`.
        """
        ...

    def serve_retained(self, topics: Sequence[AnyTopic], recall: Recall) -> Closable:
        """Serve the last values of `topics`, which are states, for writers that are gone.

        Each reader gets the states that `recall` yields once: present readers now, later ones when they
        subscribe. The value of a living writer has precedence, whichever arrives first. The keeper itself
        subscribes to a topic with `retained=False`.
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
            RefusedError: If the server refuses with a reason, or reports its own error.
            NoAnswerError: If no server answers within `timeout_s`.
            RequestError: If the reply has another type than the table's.
            BusClosedError: If the bus was closed meanwhile.
        """
        ...

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed, or until this process dies."""
        ...

    def watch(self, presence: Presence, handler: PresenceHandler) -> Closable:
        """Call `handler(name, present=…)` for each present name now, and on every change."""
        ...

    @property
    def problem(self) -> str:
        """Return a message if the bus itself has a problem, else `""`."""
        ...

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return the problems of the bus itself, with their codes."""
        ...

    @property
    def is_closed(self) -> bool:
        """Return True if the bus is closed or closing."""
        ...

    async def close(self) -> None:
        """Close all declarations of this bus. No handler runs afterwards."""
        ...


async def list_present(bus: Bus, presence: Presence, wait_s: float) -> set[str]:
    """Return the present names that are known after `wait_s` seconds. On one machine, ms suffice.

    Call this before announcing a name, and reject a name in use.
    """
    names: set[str] = set()

    def on_presence(name: str, *, present: bool) -> None:
        if present:
            names.add(name)
        else:
            names.discard(name)

    watching = bus.watch(presence, on_presence)
    try:
        await asyncio.sleep(wait_s)
    finally:
        watching.close()
    return names
