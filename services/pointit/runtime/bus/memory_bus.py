"""Bus within one process, for tests, for `sim`, and as the inner half of the Zenoh bus.

Several buses may share one `LocalBroker`; each stands for one participant.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import TypeVar

from pointit.runtime.bus.contract import (
    REQUEST_TIMEOUT_S,
    AnyTopic,
    Closable,
    Declaration,
    Handler,
    Recall,
    Server,
    Subscription,
    Tap,
)
from pointit.runtime.bus.local_broker import (
    MailboxSubscription,
    MemoryPublisher,
    Participant,
    PresenceWatcher,
    RequestHandler,
    RetainedStateServer,
    no_answer,
    shutting_down,
)
from pointit.runtime.bus.mailbox import Mailbox, TapMailbox
from pointit.runtime.errors import BusClosedError, RefusedError
from pointit.schemas import Message, Query, Reply
from pointit.schemas.topics import ANY, Presence, Request, Topic

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
CLOSE_TIMEOUT_S = 1.0
"""Timeout for cancelled servers when the bus closes, s."""

log = logging.getLogger(__name__)


class MemoryBus(Participant):
    """A participant of a broker. See `pointit.runtime.bus.contract.Bus` for the contract."""

    @property
    def site(self) -> str:
        """Return a placeholder, since a single process has no site."""
        return "memory"

    @property
    def problem(self) -> str:
        """Return `""`: this bus works or is closed."""
        return ""

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
            self._tell(presence, name, True)

        def undo() -> None:
            counts[name] -= 1
            if not counts[name]:
                del counts[name]
                self._tell(presence, name, False)

        return Declaration(undo, self.declarations)

    def watch(self, presence: Presence, handler: Callable[[str, bool], None]) -> Closable:
        """Call `handler(name, present)` now and on every change."""
        self._check_open()
        watcher = PresenceWatcher(self, presence, handler)
        for name in self.exchange.present.get(presence.key, {}):
            self._loop.call_soon(watcher.notify, name, True)
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
        tasks = self._tasks - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        if tasks:
            _, left = await asyncio.wait(tasks, timeout=CLOSE_TIMEOUT_S)
            for task in left:
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

    def _tell(self, presence: Presence, name: str, present: bool) -> None:  # noqa: FBT001
        for watcher in self.exchange.watchers.get(presence.key, ()):
            self._loop.call_soon(watcher.notify, name, present)

    def _check_open(self) -> None:
        if self._closed.done():
            raise BusClosedError("the bus is closed")
