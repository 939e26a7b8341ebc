"""The bus within one process: for tests, for `sim`, and as the inner half of the Zenoh bus.

Several buses may share one `Exchange`; each stands for one participant.
"""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import Any, Generic, TypeVar

from pointit.runtime.bus import REQUEST_TIMEOUT_S, AnyTopic, Closable, Handler, Server, Subscription, Traffic
from pointit.runtime.errors import BusClosedError, NoAnswerError, RefusedError
from pointit.runtime.mailbox import Dispatcher, Mailbox
from pointit.schemas import Message, Query, Reply
from pointit.schemas.topics import ANY, Delivery, Presence, Request, Topic

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

log = logging.getLogger(__name__)


class Exchange:
    """What participants of one process share: readers, last values, servers, presence."""

    def __init__(self) -> None:
        self.readers: dict[str, list[tuple[str, Mailbox]]] = {}
        """By topic key: the wanted name (or `*`) and the mailbox."""
        self.states: dict[str, dict[str, Message]] = {}
        """By topic key and name: the last value whose writer is still there."""
        self.servers: dict[str, list[tuple[str, Server[Any, Any]]]] = {}
        self.present: dict[str, dict[str, int]] = {}
        """By presence key and name: how many announce it."""
        self.watchers: dict[str, list[Callable[[str, bool], None]]] = {}

    def readers_of(self, topic: AnyTopic) -> list[tuple[str, Mailbox]]:
        """Return the live list of readers, for writers to keep."""
        return self.readers.setdefault(topic.key, [])

    def server_of(self, request: Request[Q, R], name: str) -> Server[Q, R] | None:
        """Return who serves `request` for `name` in this process."""
        for wanted, server in self.servers.get(request.key, ()):
            if wanted in (ANY, name):
                return server
        return None


class Declaration:
    """Something declared: undone once, by itself or with its bus."""

    def __init__(self, bus: "MemoryBus", undo: Callable[[], None]) -> None:
        self._bus = bus
        self._undo: Callable[[], None] | None = undo
        bus.declarations.add(self)

    def close(self) -> None:
        """Undo it, once."""
        undo, self._undo = self._undo, None
        if undo is not None:
            self._bus.declarations.discard(self)
            undo()


class MemoryPublisher(Generic[M]):
    """Hands messages to the readers of this process as they are: they are frozen."""

    def __init__(self, bus: "MemoryBus", topic: Topic[M], name: str) -> None:
        topic.at(name)  # raises on a name that cannot stand in the key
        self._bus = bus
        self._name = name
        self._readers = bus.exchange.readers_of(topic)
        self._is_state = topic.delivery is Delivery.STATE
        self._states = bus.exchange.states.setdefault(topic.key, {})
        self._message = topic.message
        self._last: M | None = None
        self._declaration = Declaration(bus, self._undeclare)
        self._open = True

    def put(self, message: M) -> None:
        """Send `message`."""
        if not self._open:
            raise BusClosedError(f"{self._message.__name__} cannot be sent: the bus is closed")
        if self._is_state:
            self._states[self._name] = self._last = message
        for wanted, mailbox in self._readers:
            if wanted in (ANY, self._name):
                mailbox.offer(self._name, message)

    def close(self) -> None:
        """Undeclare; a state's last value goes with its writer."""
        self._declaration.close()

    def _undeclare(self) -> None:
        self._open = False
        if self._is_state and self._last is not None and self._states.get(self._name) is self._last:
            del self._states[self._name]


class MailboxSubscription:
    """A mailbox in the exchange's list of readers."""

    def __init__(self, bus: "MemoryBus", topic: AnyTopic, mailbox: Mailbox, name: str) -> None:
        if name != ANY:
            topic.at(name)
        self._mailbox = mailbox
        readers = bus.exchange.readers_of(topic)
        entry = (name, mailbox)
        readers.append(entry)

        def undo() -> None:
            mailbox.close()
            readers.remove(entry)

        self._declaration = Declaration(bus, undo)
        if topic.delivery is Delivery.STATE:
            for key, state in bus.exchange.states.get(topic.key, {}).items():
                if name in (ANY, key):
                    mailbox.offer(key, state)

    @property
    def traffic(self) -> Traffic:
        """Return the live counters."""
        return self._mailbox.traffic

    def close(self) -> None:
        """Undeclare; the handler does not run any more."""
        self._declaration.close()


class MemoryBus:
    """A participant of an exchange; see `pointit.runtime.bus.Bus` for the contract."""

    def __init__(self, exchange: Exchange | None = None) -> None:
        """Join `exchange`, or a new one; must be called in the event loop that will run the handlers."""
        self.exchange = exchange if exchange is not None else Exchange()
        self.declarations: set[Closable] = set()
        self.dispatcher = Dispatcher()
        self._closed = False
        self._calls: set[asyncio.Task[Any]] = set()

    def publisher(self, topic: Topic[M], name: str = "") -> MemoryPublisher[M]:
        """Declare a writer of `topic.at(name)`."""
        self._check_open()
        return MemoryPublisher(self, topic, name)

    def subscribe(self, topic: Topic[M], handler: Handler[M], name: str = ANY) -> Subscription:
        """Call `handler(message, name)` for what arrives."""
        self._check_open()
        return MailboxSubscription(self, topic, Mailbox(topic, handler, self.dispatcher), name)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`."""
        self._check_open()
        servers = self.exchange.servers.setdefault(request.key, [])
        entry = (name if request.placeholder else ANY, server)
        servers.append(entry)
        return Declaration(self, lambda: servers.remove(entry))

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of whoever serves `request`."""
        self._check_open()
        key = request.at(name)
        server = self.exchange.server_of(request, name)
        if server is None:
            raise no_answer(request, key)
        return await self.in_time(request, key, answer(request, server, query, name), timeout_s)

    async def in_time(
        self, request: Request[Q, R], key: str, reply: Coroutine[Any, Any, R], timeout_s: float
    ) -> R:
        """Return what `reply` comes to; ends with the time-out, the caller or the bus."""
        task = asyncio.create_task(reply, name=f"call {key}")
        self._calls.add(task)
        try:
            await asyncio.wait({task}, timeout=timeout_s)
            if task.cancelled():
                raise BusClosedError(f"{key} was not answered: the bus is closed")
            if not task.done():
                raise no_answer(request, key, timeout_s)
            return task.result()
        finally:
            self._calls.discard(task)
            if not task.done():
                task.cancel()
                await asyncio.wait({task})

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed."""
        self._check_open()
        presence.at(name)
        counts = self.exchange.present.setdefault(presence.key, {})
        counts[name] = counts.get(name, 0) + 1
        if counts[name] == 1:
            self._tell(presence, name, present=True)

        def undo() -> None:
            counts[name] -= 1
            if not counts[name]:
                del counts[name]
                self._tell(presence, name, present=False)

        return Declaration(self, undo)

    def watch(self, presence: Presence, handler: Callable[[str, bool], None]) -> Closable:
        """Call `handler(name, present)` now and on every change."""
        self._check_open()
        loop = asyncio.get_running_loop()
        live = True

        def tell(name: str, present: bool) -> None:  # noqa: FBT001 - the handler's own signature
            loop.call_soon(lambda: handler(name, present) if live else None)

        watchers = self.exchange.watchers.setdefault(presence.key, [])
        watchers.append(tell)
        for name in self.exchange.present.get(presence.key, {}):
            tell(name, True)

        def undo() -> None:
            nonlocal live
            live = False
            watchers.remove(tell)

        return Declaration(self, undo)

    async def close(self) -> None:
        """Close everything that was declared here."""
        self._closed = True
        self.dispatcher.close()
        for declaration in list(self.declarations):
            declaration.close()
        for call in list(self._calls):
            call.cancel()
        await asyncio.sleep(0)

    def _tell(self, presence: Presence, name: str, *, present: bool) -> None:
        for watcher in list(self.exchange.watchers.get(presence.key, ())):
            watcher(name, present)

    def _check_open(self) -> None:
        if self._closed:
            raise BusClosedError("the bus is closed")


async def answer(request: Request[Q, R], server: Server[Q, R], query: Q, name: str) -> R:
    """Return the server's reply; whatever else it raises becomes a refusal that says so."""
    try:
        return await server(query, name)
    except RefusedError:
        raise
    except Exception as error:
        log.exception("%s failed", request.key)
        raise RefusedError(
            f"{request.server} failed on {request.key}: {type(error).__name__}: {error}"
        ) from error


def no_answer(request: Request[Any, Any], key: str, timeout_s: float | None = None) -> NoAnswerError:
    """Return the error that says who should have answered `key`."""
    waited = "" if timeout_s is None else f" within {timeout_s:g} s"
    return NoAnswerError(
        f"{request.server} does not answer {key}{waited}; is it running? See `pointit doctor`"
    )
