"""Bus within one process, for tests and inside the Zenoh bus: broker, participants, declarations.

Several buses may share one `LocalBroker`; each stands for one participant.
"""

import asyncio
import logging
import weakref
from collections.abc import Callable, Coroutine, Iterator, Sequence
from functools import partial
from typing import Any, Generic, TypeVar

from pointit.runtime.bus.contract import (
    MAX_IN_FLIGHT,
    REQUEST_TIMEOUT_S,
    AnyTopic,
    Closable,
    Declaration,
    Handler,
    Recall,
    Server,
    Subscription,
    SubscriptionStats,
    Tap,
)
from pointit.runtime.bus.mailbox import Dispatcher, Mailbox, TapMailbox
from pointit.runtime.errors import BusClosedError, NoAnswerError, PointItError, RefusedError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.schemas import Message, Query, Reply
from pointit.schemas.problems import Problem
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import ANY, Delivery, Presence, Request, Topic

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)

R = TypeVar("R", bound=Reply)
T = TypeVar("T")

CLOSE_TIMEOUT_S = 1.0
"""Timeout for cancelled servers when the bus closes, s."""


class _Mailboxes(list[Mailbox]):
    """A list that can be referenced weakly."""


class TopicReaders:
    """Readers of one topic in the order of their subscriptions."""

    def __init__(self) -> None:
        self._entries: list[tuple[str, Mailbox]] = []
        """The wanted name (or `*`) and the mailbox."""
        self._by_name = weakref.WeakValueDictionary[str, _Mailboxes]()
        """Mailboxes by the name of a publisher, while that exists."""

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[tuple[str, Mailbox]]:
        return iter(self._entries)

    def matching(self, name: str) -> list[Mailbox]:
        """Return the list of mailboxes for messages of `name`. It is updated, so publishers keep it."""
        mailboxes = self._by_name.get(name)
        if mailboxes is None:
            mailboxes = _Mailboxes()
            for reader_name, mailbox in self._entries:
                if reader_name in (ANY, name):
                    mailboxes.append(mailbox)
            self._by_name[name] = mailboxes
        return mailboxes

    def add(self, reader_name: str, mailbox: Mailbox) -> None:
        """Add the reader of the name `reader_name`, or of all."""
        self._entries.append((reader_name, mailbox))
        for name, mailboxes in self._by_name.items():
            if reader_name in (ANY, name):
                mailboxes.append(mailbox)

    def remove(self, reader_name: str, mailbox: Mailbox) -> None:
        """Remove an added reader."""
        self._entries.remove((reader_name, mailbox))
        for name, mailboxes in self._by_name.items():
            if reader_name in (ANY, name):
                mailboxes.remove(mailbox)


class LocalBroker:
    """Shared state of the participants of one process: readers, last values, servers, presence."""

    def __init__(self) -> None:
        self.readers: dict[str, TopicReaders] = {}
        """By topic key."""
        self.states: dict[str, dict[str, Message]] = {}
        """Last values of present writers, by topic key and name."""
        self.request_servers: dict[str, list[RequestHandler[Any, Any]]] = {}
        """Servers by request key."""
        self.present: dict[str, dict[str, int]] = {}
        """Number of announcements by presence key and name."""
        self.watchers: dict[str, list[PresenceWatcher]] = {}
        self.retained_servers: list[RetainedStateServer] = []
        """Servers of retained states of writers that are gone."""

    def readers_of(self, topic: AnyTopic) -> TopicReaders:
        """Return the readers of `topic`."""
        return self.readers.setdefault(topic.key, TopicReaders())

    def handler_for(self, request: Request[Q, R], name: str) -> "RequestHandler[Q, R] | None":
        """Return the server of `request` for `name` in this process, or None."""
        for server in self.request_servers.get(request.key, ()):
            if server.wanted in (ANY, name):
                return server
        return None


class Participant:
    """Part of a bus that its declarations need: the broker, its declarations, and tasks that end with it."""

    def __init__(self, exchange: LocalBroker | None = None) -> None:
        """Join `exchange`, or a new broker. Call this in the loop that will run handlers and tasks."""
        self.exchange = exchange if exchange is not None else LocalBroker()
        self.declarations: dict[Declaration, None] = {}
        self.dispatcher = Dispatcher()
        self._loop = asyncio.get_running_loop()
        self._closed = self._loop.create_future()
        self._tasks: set[asyncio.Task[Any]] = set()

    @property
    def is_closed(self) -> bool:
        """Return True if the bus is closed or closing."""
        return self._closed.done()

    def spawn(self, work: Coroutine[Any, Any, T], name: str) -> asyncio.Task[T]:
        """Run the coroutine `work` as a task that ends with the bus."""
        task = self._loop.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._forget)
        return task

    def _forget(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()  # retrieved: the caller may be gone
        if error is not None and not isinstance(error, PointItError):  # waiting callers get the error
            log.error("%s failed", task.get_name(), exc_info=error)


class MemoryPublisher(Declaration, Generic[M]):
    """Delivers messages to the readers of this process without copying, since they are frozen."""

    def __init__(
        self, bus: Participant, topic: Topic[M], name: str, send: Callable[[Message], None] | None = None
    ) -> None:
        """Write `topic.at(name)`. `send` gets each message for readers of other processes."""
        topic.at(name)  # raises on a name that cannot stand in the key
        self._bus = bus
        self._name = name
        self._mailboxes = bus.exchange.readers_of(topic).matching(name)
        self._send = send
        self._is_state = topic.delivery is Delivery.STATE
        self._states = bus.exchange.states.setdefault(topic.key, {})
        self._message = topic.message
        self._last: M | None = None
        self._open = True
        super().__init__(self._undeclare, bus.declarations)

    def put(self, message: M) -> None:
        """Send `message`."""
        if not self._open:
            raise BusClosedError(f"{self._message.__name__} cannot be sent: the bus is closed")
        if self._is_state:
            self._states[self._name] = self._last = message
        for mailbox in self._mailboxes:
            mailbox.put(self._name, message)
        if self._send is not None:
            self._send(message)

    def close_nowait(self) -> None:
        """Stop writing."""
        self.close()

    def _undeclare(self) -> None:
        self._open = False
        # A state's last value is removed with its writer, unless another one has put since
        if not self._is_state or self._last is None:
            return
        if self._states.get(self._name) is self._last:
            del self._states[self._name]


class MailboxSubscription(Declaration):
    """A mailbox in the broker's list of readers."""

    def __init__(self, bus: Participant, topic: AnyTopic, mailbox: Mailbox, name: str) -> None:
        if name != ANY:
            topic.at(name)
        self._mailbox = mailbox
        self._readers = bus.exchange.readers_of(topic)
        self._name = name
        self._readers.add(name, mailbox)
        super().__init__(self._undeclare, bus.declarations)
        if topic.delivery is Delivery.STATE:
            for key, state in bus.exchange.states.get(topic.key, {}).items():
                if name in (ANY, key):
                    mailbox.put(key, state)
            for retained_server in bus.exchange.retained_servers:
                retained_server.deliver(topic, name, mailbox)

    @property
    def traffic(self) -> SubscriptionStats:
        """Return the live counters."""
        return self._mailbox.traffic

    def _undeclare(self) -> None:
        self._mailbox.close()
        self._readers.remove(self._name, self._mailbox)


class RetainedStateServer(Declaration):
    """Retained states of one keeper, delivered to present readers and to each later one."""

    def __init__(self, bus: Participant, topics: Sequence[AnyTopic], recall: Recall) -> None:
        self.recall = recall
        self._keys = frozenset(topic.key for topic in topics)
        self._retained_servers = bus.exchange.retained_servers
        self._retained_servers.append(self)
        super().__init__(self._undeclare, bus.declarations)
        for topic in topics:
            for reader_name, mailbox in bus.exchange.readers_of(topic):
                self.deliver(topic, reader_name, mailbox)

    def deliver(self, topic: AnyTopic, reader_name: str, mailbox: Mailbox) -> None:
        """Deliver the retained states of `topic` under the name `reader_name`, or under all."""
        if topic.key in self._keys and mailbox.accepts_retained:
            for name, message in self.recall(topic):
                if reader_name in (ANY, name):
                    mailbox.offer_retained(name, message)

    def _undeclare(self) -> None:
        self._retained_servers.remove(self)


class PresenceWatcher(Declaration):
    """Reports each change of presence to a handler once."""

    def __init__(self, bus: Participant, presence: Presence, handler: PresenceHandler) -> None:
        self.presence = presence
        self._handler = handler
        self._known: set[str] = set()
        self._open = True
        self._watchers = bus.exchange.watchers.setdefault(presence.key, [])
        self._watchers.append(self)
        super().__init__(self._undeclare, bus.declarations)

    def notify(self, name: str, *, present: bool) -> None:
        """Report that `name` is present or gone. Called in the loop, never within `announce` or `close`."""
        if not self._open or present == (name in self._known):
            return
        if present:
            self._known.add(name)
        else:
            self._known.discard(name)
        try:
            self._handler(name, present=present)
        except Exception:  # an error of one handler must not stop the others
            log.exception("watcher of %s failed", self.presence.key)

    def _undeclare(self) -> None:
        self._open = False
        self._watchers.remove(self)


class RequestHandler(Declaration, Generic[Q, R]):
    """Server of one request. Each answer is a task that ends with the server, not with its caller."""

    def __init__(self, bus: Participant, request: Request[Q, R], server: Server[Q, R], name: str) -> None:
        self.request = request
        self._bus = bus
        self.wanted = name if request.placeholder else ANY
        self._server = server
        self._answers: set[asyncio.Task[R]] = set()
        self._request_servers = bus.exchange.request_servers.setdefault(request.key, [])
        self._request_servers.append(self)
        super().__init__(self._undeclare, bus.declarations)

    def handle(self, query: Q, name: str) -> asyncio.Task[R]:
        """Start a task that answers `query`. It raises no error except `RefusedError`."""
        is_busy = len(self._answers) >= MAX_IN_FLIGHT
        answering = self._answer(query, name, is_busy=is_busy)
        task = self._bus.spawn(answering, f"serve {self.request.key}")
        self._answers.add(task)
        task.add_done_callback(self._answers.discard)
        return task

    def _undeclare(self) -> None:
        self._request_servers.remove(self)
        for answer in self._answers:
            answer.cancel()

    async def _answer(self, query: Q, name: str, *, is_busy: bool) -> R:
        server = self.request.server
        key = self.request.key
        if is_busy:
            raise RefusedError(f"{server} is busy with {MAX_IN_FLIGHT} other requests for {key}; ask later")
        try:
            reply = await self._server(query, name)
            required = self.request.reply
            if not isinstance(reply, required):
                raise TypeError(f"the reply is a {type(reply).__name__}, not a {required.__name__}")  # noqa: TRY301
        except PointItError as error:  # its text is already written for users
            raise RefusedError(hide_secrets(str(error))) from error
        except Exception as error:
            log.exception("%s failed", key)
            cause = hide_secrets(f"{type(error).__name__}: {error}")
            raise RefusedError(f"{server} failed on {key}: {cause}") from error
        return reply


def shutting_down(request: Request[Any, Any]) -> str:
    """Return the refusal for callers of a server that is closing."""
    return f"{request.server} is shutting down"


def no_answer(request: Request[Any, Any], key: str, timeout_s: float | None = None) -> NoAnswerError:
    """Return the error for a missing answer. It names the service that should answer `key`."""
    waited = "" if timeout_s is None else f" within {timeout_s:g} s"
    doctor = advised_commands().command("pointit doctor")
    return NoAnswerError(f"{request.server} does not answer {key}{waited}; is it running? See {doctor}")


class MemoryBus(Participant):
    """A bus within one process: publish, subscribe, requests and presence, without a network.

    All participants of one `LocalBroker` hear each other. It has the contract of
    `pointit.runtime.bus.contract.Bus` as `ZenohBus` has it, checked by the same tests, so a service cannot
    tell them apart: tests and runs in one process use this one, and messages are handed over without being
    encoded.

        broker = LocalBroker()
        writer, reader = MemoryBus(broker), MemoryBus(broker)
        reader.subscribe(topics.RAY, lambda ray, user: print(user, ray.direction))
        writer.publisher(topics.RAY, "anna").put(ray)      # prints in the next turn of the loop
    """

    @property
    def site(self) -> str:
        """Return a placeholder, since a single process has no site."""
        return "memory"

    @property
    def problem(self) -> str:
        """Return one message of all problems, or `""`."""
        return "; ".join(problem.sentence for problem in self.problems)

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return none: this bus works or is closed."""
        return ()

    def publisher(self, topic: Topic[M], name: str = "") -> MemoryPublisher[M]:
        """Declare a writer of `topic.at(name)`."""
        self._check_open()
        return MemoryPublisher(self, topic, name)

    def subscribe(
        self,
        topic: Topic[M],
        handler: Handler[M],
        name: str = ANY,
        *,
        retained: bool = True,
        queue_all: bool = False,
    ) -> Subscription:
        """Call `handler(message, name)` for each message."""
        self._check_open()
        mailbox = Mailbox(topic, handler, self.dispatcher, retained=retained, queue_all=queue_all)
        return MailboxSubscription(self, topic, mailbox, name)

    def tap(self, topic: AnyTopic, handler: Tap, name: str = ANY) -> Subscription:
        """Call `handler` for every message at once."""
        self._check_open()
        return MailboxSubscription(self, topic, TapMailbox(topic, handler, self.dispatcher), name)

    def serve_retained(self, topics: Sequence[AnyTopic], recall: Recall) -> Closable:
        """Serve the last values of `topics` for writers that are gone."""
        self._check_open()
        return RetainedStateServer(self, topics, recall)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`."""
        return self.handler(request, server, name)

    def handler(self, request: Request[Q, R], server: Server[Q, R], name: str) -> RequestHandler[Q, R]:
        """Return the handler of `request` in this process."""
        self._check_open()
        request.at(name)
        return RequestHandler(self, request, server, name)

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of the server of `request` in this process."""
        self._check_open()
        key = request.at(name)
        server = self.exchange.handler_for(request, name)
        if server is None:
            raise no_answer(request, key)
        return await self._wait_for(server.handle(query, name), request, key, timeout_s)

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed."""
        self._check_open()
        presence.at(name)
        counts = self.exchange.present.setdefault(presence.key, {})
        counts[name] = counts.get(name, 0) + 1
        if counts[name] == 1:
            self._notify_watchers(presence, name, present=True)

        def undo() -> None:
            counts[name] -= 1
            if not counts[name]:
                del counts[name]
                self._notify_watchers(presence, name, present=False)

        return Declaration(undo, self.declarations)

    def watch(self, presence: Presence, handler: PresenceHandler) -> Closable:
        """Call `handler(name, present=…)` now and on every change."""
        self._check_open()
        watcher = PresenceWatcher(self, presence, handler)
        for name in self.exchange.present.get(presence.key, {}):
            self._loop.call_soon(partial(watcher.notify, name, present=True))
        return watcher

    @property
    def is_restricted(self) -> bool:
        """Return True if access rules apply."""
        return False

    async def denial_reason(self, verb: str, topic: AnyTopic, name: str) -> str:
        """Return `""`: within one process all rights are granted."""
        del verb, topic, name
        return ""

    async def list_present(self, presence: Presence) -> set[str]:
        """Return all names that are present now."""
        return set(self.exchange.present.get(presence.key, {}))

    async def close(self) -> None:
        """Close all declarations of this bus."""
        if self._closed.done():
            return
        self._closed.set_result(None)
        self.dispatcher.close()
        for declaration in list(self.declarations):
            declaration.close()
        # The task that closes the bus must not cancel itself
        tasks = self._tasks - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        if tasks:
            _, pending = await asyncio.wait(tasks, timeout=CLOSE_TIMEOUT_S)
            for task in pending:
                log.error("%s goes on although the bus is closed", task.get_name())

    async def _wait_for(
        self, reply: "asyncio.Task[R]", request: Request[Q, R], key: str, timeout_s: float
    ) -> R:
        await asyncio.wait({reply, self._closed}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        if self._closed.done():
            raise BusClosedError(f"{key} was not answered: the bus is closed")
        if not reply.done():
            raise no_answer(request, key, timeout_s)
        if reply.cancelled():
            raise RefusedError(shutting_down(request))
        return reply.result()

    def _notify_watchers(self, presence: Presence, name: str, *, present: bool) -> None:
        for watcher in self.exchange.watchers.get(presence.key, ()):
            self._loop.call_soon(partial(watcher.notify, name, present=present))

    def _check_open(self) -> None:
        if self._closed.done():
            raise BusClosedError("the bus is closed")
