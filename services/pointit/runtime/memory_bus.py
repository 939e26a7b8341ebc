"""The bus within one process: for tests, for `sim`, and as the inner half of the Zenoh bus.

Several buses may share one `Exchange`; each stands for one participant.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from pointit.runtime.bus import (
    MAX_IN_FLIGHT,
    REQUEST_TIMEOUT_S,
    AnyTopic,
    Closable,
    Handler,
    Recall,
    Server,
    Subscription,
    Traffic,
)
from pointit.runtime.errors import BusClosedError, PointItError, RefusedError
from pointit.runtime.mailbox import Dispatcher, Mailbox
from pointit.runtime.unanswered import no_answer, shutting_down
from pointit.schemas import Message, Query, Reply
from pointit.schemas.topics import ANY, Delivery, Presence, Request, Topic

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

CLOSE_PATIENCE_S = 1.0
"""How long closing waits for servers to notice that they are cancelled."""

log = logging.getLogger(__name__)


class Exchange:
    """What participants of one process share: readers, last values, servers, presence."""

    def __init__(self) -> None:
        self.readers: dict[str, list[tuple[str, Mailbox]]] = {}
        """By topic key: the wanted name (or `*`) and the mailbox."""
        self.states: dict[str, dict[str, Message]] = {}
        """By topic key and name: the last value whose writer is still there."""
        self.desks: dict[str, list[Desk[Any, Any]]] = {}
        """By request key: who answers."""
        self.present: dict[str, dict[str, int]] = {}
        """By presence key and name: how many announce it."""
        self.watchers: dict[str, list[Watcher]] = {}
        self.keepings: list[Keeping] = []
        """Who answers for writers that are gone."""

    def readers_of(self, topic: AnyTopic) -> list[tuple[str, Mailbox]]:
        """Return the live list of readers, for writers to keep."""
        return self.readers.setdefault(topic.key, [])

    def desk_of(self, request: Request[Q, R], name: str) -> "Desk[Q, R] | None":
        """Return who answers `request` for `name` in this process."""
        for desk in self.desks.get(request.key, ()):
            if desk.wanted in (ANY, name):
                return desk
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
        self._name = name
        self._readers = bus.exchange.readers_of(topic)
        self._is_state = topic.delivery is Delivery.STATE
        self._states = bus.exchange.states.setdefault(topic.key, {})
        self._message = topic.message
        self._last: M | None = None
        self._open = True
        self._declaration = Declaration(bus, self._undeclare)

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

    def retire(self) -> None:
        """Write no more."""
        self.close()

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
        self._readers = bus.exchange.readers_of(topic)
        self._entry = (name, mailbox)
        self._readers.append(self._entry)
        self._declaration = Declaration(bus, self._undeclare)
        if topic.delivery is Delivery.STATE:
            for key, state in bus.exchange.states.get(topic.key, {}).items():
                if name in (ANY, key):
                    mailbox.offer(key, state)
            for keeping in bus.exchange.keepings:
                keeping.hand_over(topic, name, mailbox)

    @property
    def traffic(self) -> Traffic:
        """Return the live counters."""
        return self._mailbox.traffic

    def close(self) -> None:
        """Undeclare; the handler does not run any more."""
        self._declaration.close()

    def _undeclare(self) -> None:
        self._mailbox.close()
        self._readers.remove(self._entry)


class Keeping:
    """What somebody keeps of states: handed over to the readers there are, and to each that comes."""

    def __init__(self, bus: "MemoryBus", topics: Sequence[AnyTopic], recall: Recall) -> None:
        self.recall = recall
        self._keys = frozenset(topic.key for topic in topics)
        self._keepings = bus.exchange.keepings
        self._keepings.append(self)
        self._declaration = Declaration(bus, self._undeclare)
        for topic in topics:
            for wanted, mailbox in bus.exchange.readers_of(topic):
                self.hand_over(topic, wanted, mailbox)

    def hand_over(self, topic: AnyTopic, wanted: str, mailbox: Mailbox) -> None:
        """Offer what is kept of `topic` under the name `wanted`, or under all."""
        if topic.key in self._keys and mailbox.takes_kept:
            for name, message in self.recall(topic):
                if wanted in (ANY, name):
                    mailbox.offer_kept(name, message)

    def close(self) -> None:
        """Answer no longer."""
        self._declaration.close()

    def _undeclare(self) -> None:
        self._keepings.remove(self)


class Desk(Generic[Q, R]):
    """Where one request is answered: each answer is a task that ends with the desk, not with its caller."""

    def __init__(self, bus: "MemoryBus", request: Request[Q, R], server: Server[Q, R], name: str) -> None:
        self.request = request
        self.wanted = name if request.placeholder else ANY
        self._bus = bus
        self._server = server
        self._answers: set[asyncio.Task[R]] = set()
        self._desks = bus.exchange.desks.setdefault(request.key, [])
        self._desks.append(self)
        self._declaration = Declaration(bus, self._undeclare)

    def start(self, query: Q, name: str) -> asyncio.Task[R]:
        """Begin to answer `query`; the task raises nothing but `RefusedError`."""
        is_busy = len(self._answers) >= MAX_IN_FLIGHT
        task = self._bus.spawn(self._answer(query, name, is_busy=is_busy), f"serve {self.request.key}")
        self._answers.add(task)
        task.add_done_callback(self._answers.discard)
        return task

    def close(self) -> None:
        """Answer no longer; callers that wait are told."""
        self._declaration.close()

    def _undeclare(self) -> None:
        self._desks.remove(self)
        for answer in self._answers:
            answer.cancel()

    async def _answer(self, query: Q, name: str, *, is_busy: bool) -> R:
        server, key = self.request.server, self.request.key
        if is_busy:
            raise RefusedError(f"{server} is busy with {MAX_IN_FLIGHT} other requests for {key}; ask later")
        try:
            reply = await self._server(query, name)
            if not isinstance(reply, self.request.reply):
                raise TypeError(f"the reply is a {type(reply).__name__}, not a {self.request.reply.__name__}")  # noqa: TRY301
        except RefusedError:
            raise
        except PointItError as error:  # a sentence for a person already
            raise RefusedError(str(error)) from error
        except Exception as error:
            log.exception("%s failed", key)
            raise RefusedError(f"{server} failed on {key}: {type(error).__name__}: {error}") from error
        return reply


class Watcher:
    """Tells a handler who is present, each change once."""

    def __init__(self, bus: "MemoryBus", presence: Presence, handler: Callable[[str, bool], None]) -> None:
        self.presence = presence
        self._handler = handler
        self._known: set[str] = set()
        self._open = True
        self._watchers = bus.exchange.watchers.setdefault(presence.key, [])
        self._watchers.append(self)
        self._declaration = Declaration(bus, self._undeclare)

    def tell(self, name: str, present: bool) -> None:  # noqa: FBT001 - the handler's own signature
        """Say that `name` is there or gone; in the loop, never from within a call of the watched."""
        if not self._open or present == (name in self._known):
            return
        (self._known.add if present else self._known.discard)(name)
        try:
            self._handler(name, present)
        except Exception:  # a handler's fault must not stop the others
            log.exception("watcher of %s failed", self.presence.key)

    def close(self) -> None:
        """Tell nothing any more."""
        self._declaration.close()

    def _undeclare(self) -> None:
        self._open = False
        self._watchers.remove(self)


class MemoryBus:
    """A participant of an exchange; see `pointit.runtime.bus.Bus` for the contract."""

    def __init__(self, exchange: Exchange | None = None) -> None:
        """Join `exchange`, or a new one; must be called in the event loop that will run the handlers."""
        self.exchange = exchange if exchange is not None else Exchange()
        self.declarations: set[Closable] = set()
        self.dispatcher = Dispatcher()
        self._loop = asyncio.get_running_loop()
        self._closed = self._loop.create_future()
        self._tasks: set[asyncio.Task[Any]] = set()

    @property
    def site(self) -> str:
        """Return a name for what has no site: one process by itself."""
        return "memory"

    @property
    def trouble(self) -> str:
        """Return nothing: this bus works or is closed."""
        return ""

    def publisher(self, topic: Topic[M], name: str = "") -> MemoryPublisher[M]:
        """Declare a writer of `topic.at(name)`."""
        self._check_open()
        return MemoryPublisher(self, topic, name)

    def subscribe(
        self, topic: Topic[M], handler: Handler[M], name: str = ANY, *, kept: bool = True
    ) -> Subscription:
        """Call `handler(message, name)` for what arrives."""
        self._check_open()
        return MailboxSubscription(self, topic, Mailbox(topic, handler, self.dispatcher, kept=kept), name)

    def keep(self, topics: Sequence[AnyTopic], recall: Recall) -> Closable:
        """Answer for the writers of `topics` that are gone."""
        self._check_open()
        return Keeping(self, topics, recall)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`."""
        self._check_open()
        request.at(name)
        return Desk(self, request, server, name)

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of whoever serves `request` in this process."""
        self._check_open()
        key = request.at(name)
        desk = self.exchange.desk_of(request, name)
        if desk is None:
            raise no_answer(request, key)
        return await self._wait_for(desk.start(query, name), request, key, timeout_s)

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed."""
        self._check_open()
        presence.at(name)
        counts = self.exchange.present.setdefault(presence.key, {})
        counts[name] = counts.get(name, 0) + 1
        if counts[name] == 1:
            self._tell(presence, name, True)

        def undo() -> None:
            counts[name] -= 1
            if not counts[name]:
                del counts[name]
                self._tell(presence, name, False)

        return Declaration(self, undo)

    def watch(self, presence: Presence, handler: Callable[[str, bool], None]) -> Closable:
        """Call `handler(name, present)` now and on every change."""
        self._check_open()
        watcher = Watcher(self, presence, handler)
        for name in self.exchange.present.get(presence.key, {}):
            self._loop.call_soon(watcher.tell, name, True)
        return watcher

    @property
    def is_closed(self) -> bool:
        """Return whether the bus is closed, or being closed."""
        return self._closed.done()

    async def close(self) -> None:
        """Close everything that was declared here."""
        if self._closed.done():
            return
        self._closed.set_result(None)
        self.dispatcher.close()
        for declaration in list(self.declarations):
            declaration.close()
        tasks = self._tasks - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        if tasks:
            _, left = await asyncio.wait(tasks, timeout=CLOSE_PATIENCE_S)
            for task in left:
                log.error("%s goes on although the bus is closed", task.get_name())

    def spawn(self, work: Any, name: str) -> asyncio.Task[Any]:
        """Run the coroutine `work` as a task that ends with the bus."""
        task = self._loop.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._forget)
        return task

    async def _wait_for(
        self, reply: "asyncio.Task[R]", request: Request[Q, R], key: str, timeout_s: float
    ) -> R:
        """Return what `reply` comes to, unless the time or the bus ends before."""
        await asyncio.wait({reply, self._closed}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        if self._closed.done():
            raise BusClosedError(f"{key} was not answered: the bus is closed")
        if not reply.done():
            raise no_answer(request, key, timeout_s)
        if reply.cancelled():
            raise RefusedError(shutting_down(request))
        return reply.result()

    def _forget(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if not task.cancelled():
            task.exception()  # seen: whoever asked may have gone

    def _tell(self, presence: Presence, name: str, present: bool) -> None:  # noqa: FBT001
        for watcher in self.exchange.watchers.get(presence.key, ()):
            self._loop.call_soon(watcher.tell, name, present)

    def _check_open(self) -> None:
        if self._closed.done():
            raise BusClosedError("the bus is closed")
