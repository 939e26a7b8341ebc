"""The bus of a simulated process: a broker of its own for its own readers, and the network for all others.

It has the structure of `ZenohBus`.
"""

import asyncio
import functools
from collections.abc import Sequence
from typing import Any

from pointit.runtime.bus.contract import (
    REQUEST_TIMEOUT_S,
    UNDECLARE_S,
    AnyTopic,
    Declaration,
    Handler,
    Recall,
    Tap,
)
from pointit.runtime.bus.mailbox import Mailbox, TapMailbox
from pointit.runtime.bus.memory_bus import (
    LocalBroker,
    MailboxSubscription,
    MemoryBus,
    MemoryPublisher,
    PresenceWatcher,
    RetainedStateServer,
)
from pointit.runtime.errors import NoAnswerError
from pointit.schemas.problems import ROUTER_LOST, Problem
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import ANY, KEEPER_ALIVE, Delivery, Presence, Request
from tests.simulation.kernel.process import Process
from tests.simulation.network.network import Network
from tests.simulation.network.router import Retained, Session

FIRST_LOOK_S = 0.001
"""Time from `watch` until the process knows who is present, s."""


class SimulatedPublisher(MemoryPublisher[Any]):
    """A publisher, as `ZenohPublisher`."""

    def __init__(self, bus: "SimulatedBus", topic: AnyTopic, name: str) -> None:
        self._process = bus.process
        self._network = bus.network
        self._topic = topic
        self._key_name = name
        self._writer = bus.network.messages.add_writer(bus.session, topic, name)
        self._retires = False
        super().__init__(bus, topic, name, self._pass_on)

    def put(self, message: Any) -> None:
        """Send `message`, unless the process dies before."""
        process = self._process
        process.pass_point("put")
        if process.is_dead:
            return
        for observe in self._network.put_observers:
            observe(process, self._topic, self._key_name, message)
        super().put(message)
        process.pass_point("after put")
        process.pass_point(f"after {self._topic.key}")

    def _pass_on(self, message: Any) -> None:
        self._network.messages.send(self._writer, message)

    def close_nowait(self) -> None:
        """Stop writing. Others may fetch what was lost for a moment."""
        self._retires = True
        self.close()

    def _undeclare(self) -> None:
        super()._undeclare()
        messages = self._network.messages
        if self._retires:
            self._network.router.timeline.after(UNDECLARE_S, messages.remove_writer, self._writer)
        else:
            messages.remove_writer(self._writer)


class SimulatedSubscription(MailboxSubscription):
    """A subscription, as `ZenohSubscription`."""

    def __init__(self, bus: "SimulatedBus", topic: AnyTopic, mailbox: Mailbox, name: str) -> None:
        super().__init__(bus, topic, mailbox, name)
        self._messages = bus.network.messages
        self._reader = self._messages.add_reader(bus.session, topic, name, mailbox)

    def _undeclare(self) -> None:
        super()._undeclare()
        self._messages.remove_reader(self._reader)


class SimulatedWatcher(PresenceWatcher):
    """Reports the names that its process sees present."""

    def update(self, names: set[str]) -> None:
        """Report those that have come and gone."""
        for name in sorted(self._known - names):
            self.notify(name, present=False)
        for name in sorted(names - self._known):
            self.notify(name, present=True)


class SimulatedBus(MemoryBus):
    """The bus of a simulated process."""

    def __init__(self, network: Network, process: Process, site: str = "lab") -> None:
        """Connect `process`. Call this in its context."""
        super().__init__(LocalBroker())
        self.network = network
        self.process = process
        self.is_connected = False
        self.own_tokens: list[tuple[str, str]] = []
        self.served_retained: list[Retained] = []
        self._site_name = site
        self._retained_readers: list[tuple[AnyTopic, str, Mailbox]] = []
        self._keepers: set[str] = set()
        """Names of the keepers that it sees."""
        self.session: Session = network.router.attach(self)

    @property
    def site(self) -> str:
        """Return the name of the site."""
        return self._site_name

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return the problem of the connection, if there is one."""
        if self.is_connected or self.process.is_dead:
            return ()
        sentence = "the router does not answer; trying again"
        return (Problem(code=ROUTER_LOST, sentence=sentence, subject="router"),)

    def publisher(self, topic: AnyTopic, name: str = "") -> Any:
        """Declare a writer."""
        self._check_open()
        return SimulatedPublisher(self, topic, name)

    def subscribe(
        self,
        topic: AnyTopic,
        handler: Handler[Any],
        name: str = ANY,
        *,
        retained: bool = True,
        queue_all: bool = False,
    ) -> Any:
        """Declare a reader."""
        self._check_open()
        mailbox = Mailbox(topic, handler, self.dispatcher, retained=retained, queue_all=queue_all)
        return self._read(topic, mailbox, name, is_retained=retained)

    def tap(self, topic: AnyTopic, handler: Tap, name: str = ANY) -> Any:
        """Declare a reader of every message."""
        self._check_open()
        return self._read(topic, TapMailbox(topic, handler, self.dispatcher), name, is_retained=True)

    def _read(self, topic: AnyTopic, mailbox: Mailbox, name: str, *, is_retained: bool) -> Any:
        subscription = SimulatedSubscription(self, topic, mailbox, name)
        if topic.delivery is Delivery.STATE and is_retained:
            self._retained_readers = [each for each in self._retained_readers if each[2].accepts_retained]
            self._retained_readers.append((topic, name, mailbox))
            for keeper in sorted(self._keepers):
                self._ask_keeper(keeper, topic, name, mailbox)
        return subscription

    # Retained states

    def serve_retained(self, topics: Sequence[AnyTopic], recall: Recall) -> Any:
        """Serve the states of writers that are gone."""
        self._check_open()
        local = RetainedStateServer(self, topics, recall)
        entry = (frozenset(topic.key for topic in topics), recall)
        self.served_retained.append(entry)
        token = self._add_token(KEEPER_ALIVE.key, self._keeper_name)

        def undo() -> None:
            local.close()
            self.served_retained.remove(entry)
            token.close()

        return Declaration(undo, self.declarations)

    @property
    def _keeper_name(self) -> str:
        return f"p{self.process.pid}"

    def _ask_keeper(self, keeper: str, topic: AnyTopic, name: str, mailbox: Mailbox) -> None:
        router = self.network.router
        for session in router.sessions.values():
            if f"p{session.process.pid}" == keeper and session is not self.session:
                answer = functools.partial(self._answer_as_keeper, session, topic, name, mailbox)
                router.carry(self.session, session, "query", answer)

    def _answer_as_keeper(self, keeper: Session, topic: AnyTopic, name: str, mailbox: Mailbox) -> None:
        for keys, recall in keeper.bus.served_retained:
            if topic.key not in keys:
                continue
            for state_name, message in list(recall(topic)):
                if name in (ANY, state_name) or not topic.placeholder:
                    deliver = functools.partial(mailbox.offer_retained, state_name, message)
                    self.network.router.carry(keeper, self.session, "data", deliver)

    # Requests

    async def call(
        self, request: Request[Any, Any], query: Any, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> Any:
        """Return the reply to `query`, of this process's own server if it has one."""
        self._check_open()
        if self.exchange.handler_for(request, name) is not None:
            return await super().call(request, query, name, timeout_s=timeout_s)
        key = request.at(name)
        if not self.is_connected:
            raise NoAnswerError(f"{request.server} cannot be asked for {key}: {self.problem}")
        reply = self.spawn(self.network.requests.ask(self.session, request, query, name), f"call {key}")
        try:
            return await self._wait_for(reply, request, key, timeout_s)
        finally:
            reply.cancel()

    # Presence

    def announce(self, presence: Presence, name: str) -> Any:
        """Be present as `name`."""
        self._check_open()
        presence.at(name)  # raises on a name that cannot stand in the key
        return self._add_token(presence.key, name)

    def _add_token(self, key: str, name: str) -> Declaration:
        token = (key, name)
        self.own_tokens.append(token)
        self.network.presence.announce(self.session, token)
        self._loop.call_soon(self.update_tokens)

        def undo() -> None:
            self.own_tokens.remove(token)
            self.network.presence.withdraw(self.session, token)
            self._loop.call_soon(self.update_tokens)

        return Declaration(undo, self.declarations)

    def watch(self, presence: Presence, handler: PresenceHandler) -> Any:
        """Report who comes and goes."""
        self._check_open()
        watcher = SimulatedWatcher(self, presence, handler)
        self._loop.call_later(FIRST_LOOK_S, self.update_tokens)
        return watcher

    async def list_present(self, presence: Presence) -> set[str]:
        """Return the present names, as the router tells them."""
        await asyncio.sleep(2 * self.network.router.delay_s(self.session))
        return self._names_of(presence.key)

    def _names_of(self, key: str) -> set[str]:
        names: set[str] = set()
        for token in (*self.own_tokens, *self.session.tokens):
            if token[0] == key:
                names.add(token[1])
        return names

    def update_tokens(self) -> None:
        """Report each presence that has changed, and ask keepers that have come."""
        if self.is_closed:
            return
        for key, watchers in list(self.exchange.watchers.items()):
            for watcher in list(watchers):
                if isinstance(watcher, SimulatedWatcher):
                    watcher.update(self._names_of(key))
        keepers = self._names_of(KEEPER_ALIVE.key) - {self._keeper_name}
        arrived = keepers - self._keepers
        self._keepers = keepers
        for keeper in sorted(arrived):
            for topic, name, mailbox in self._retained_readers:
                if mailbox.accepts_retained:
                    self._ask_keeper(keeper, topic, name, mailbox)

    async def close(self) -> None:
        """Close all declarations, and the session."""
        if self._closed.done():
            return
        await super().close()
        self.network.router.detach(self.session)
