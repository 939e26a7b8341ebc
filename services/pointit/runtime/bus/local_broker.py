"""Message broker of one process, and the declarations and tasks of each participant."""

import asyncio
import logging
import weakref
from collections.abc import Coroutine, Iterator
from typing import Any, Protocol, TypeVar

from pointit.runtime.bus.contract import AnyTopic, Declaration
from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.runtime.bus.mailbox import Mailbox
from pointit.runtime.errors import PointItError
from pointit.schemas import Message, Query, Reply
from pointit.schemas.topics import ANY, Request

log = logging.getLogger(__name__)

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
T = TypeVar("T")
Q_contra = TypeVar("Q_contra", bound=Query, contravariant=True)
R_co = TypeVar("R_co", bound=Reply, covariant=True)


class RequestServer(Protocol[Q_contra, R_co]):
    """Answers one request in this process."""

    wanted: str
    """Name for which it answers. `*` for all."""

    def handle(self, query: Q_contra, name: str) -> asyncio.Task[R_co]:
        """Start a task that answers `query`. It raises no error except `RefusedError`."""
        ...


class RetainedStateProvider(Protocol):
    """Delivers the last states of writers that are gone."""

    def deliver(self, topic: AnyTopic, wanted: str, mailbox: Mailbox) -> None:
        """Deliver the retained states of `topic` under the name `wanted`, or under all."""
        ...


class PresenceWatcher(Protocol):
    """Receives changes of presence."""

    def notify(self, name: str, present: bool) -> None:  # noqa: FBT001 - the handler's own signature
        """Report that `name` is present or gone."""
        ...


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
            mailboxes = _Mailboxes(mailbox for wanted, mailbox in self._entries if wanted in (ANY, name))
            self._by_name[name] = mailboxes
        return mailboxes

    def add(self, wanted: str, mailbox: Mailbox) -> None:
        """Add the reader of the name `wanted`, or of all."""
        self._entries.append((wanted, mailbox))
        for name, mailboxes in self._by_name.items():
            if wanted in (ANY, name):
                mailboxes.append(mailbox)

    def remove(self, wanted: str, mailbox: Mailbox) -> None:
        """Remove an added reader."""
        self._entries.remove((wanted, mailbox))
        for name, mailboxes in self._by_name.items():
            if wanted in (ANY, name):
                mailboxes.remove(mailbox)


class LocalBroker:
    """Shared state of the participants of one process: readers, last values, servers, presence."""

    def __init__(self) -> None:
        self.readers: dict[str, TopicReaders] = {}
        """By topic key."""
        self.states: dict[str, dict[str, Message]] = {}
        """Last values of present writers, by topic key and name."""
        self.request_servers: dict[str, list[RequestServer[Any, Any]]] = {}
        """Servers by request key."""
        self.present: dict[str, dict[str, int]] = {}
        """Number of announcements by presence key and name."""
        self.watchers: dict[str, list[PresenceWatcher]] = {}
        self.retained_servers: list[RetainedStateProvider] = []
        """Servers of retained states of writers that are gone."""

    def readers_of(self, topic: AnyTopic) -> TopicReaders:
        """Return the readers of `topic`."""
        return self.readers.setdefault(topic.key, TopicReaders())

    def handler_for(self, request: Request[Q, R], name: str) -> RequestServer[Q, R] | None:
        """Return the server of `request` for `name` in this process, or None."""
        for server in self.request_servers.get(request.key, ()):
            if server.wanted in (ANY, name):
                return server
        return None


class Participant:
    """Part of a bus that its endpoints need: the broker, its declarations, and tasks that end with it."""

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
