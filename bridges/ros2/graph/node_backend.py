"""A node in the ROS graph: parts that are the same for every middleware, and its warnings.

No core: it waits for a network and keeps time.
"""

import abc
import asyncio
import collections
import functools
import logging
import threading
from collections.abc import Callable, Coroutine, Hashable, Mapping
from typing import Any, Generic, Protocol, TypeVar

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import BackendHandle, Graph, Qos, RosType, Server
from pointit.bridges.ros2.graph.findings import GraphFinding, Matching, findings
from pointit.bridges.ros2.types.types import MAX_BYTES
from pointit.runtime.bus.contract import Declaration
from pointit.runtime.bus.mailbox import Dispatcher
from pointit.runtime.errors import BusClosedError, RefusedError
from pointit.runtime.service.plugin_guard import WarningSink

log = logging.getLogger(__name__)

Handler = Callable[[Graph], None]
T = TypeVar("T")

QUIET_S = 10.0
"""A warning about messages is cleared this long (s) after its last cause."""
MIN_CAPACITY = 64
"""Minimum number of messages queued for the loop, even if a topic's QoS keeps fewer."""


class BackendWarnings:
    """Permanent warnings, replaced as a whole; brief ones, which expire; held ones. In the loop."""

    def __init__(self, warnings: WarningSink) -> None:
        self._warnings = warnings
        self._standing: dict[str, str] = {}
        self._held: set[str] = set()
        self._passing: dict[str, asyncio.TimerHandle] = {}
        self._loop = asyncio.get_running_loop()

    def replace_all(self, sentences: Mapping[str, str]) -> None:
        """Replace all permanent warnings by these, by subject."""
        ended = [about for about in self._standing if about not in sentences]
        for about in ended:
            del self._standing[about]
            self._warnings.clear("graph", about)
        for about, sentence in sentences.items():
            previous = self._standing.get(about)
            if previous != sentence:
                self._standing[about] = sentence
                self._warnings.warn("graph", sentence, about)
                if previous is None:  # a changed one is logged once, as its figures may change often
                    log.warning("%s", sentence)

    def show_briefly(self, about: str, sentence: str) -> None:
        """Show a warning until its cause is absent for a while; `about` must differ from permanent ones."""
        timer = self._passing.pop(about, None)
        if timer is None:
            log.warning("%s", sentence)
        else:
            timer.cancel()
        self._warnings.warn("graph", sentence, about)
        self._passing[about] = self._loop.call_later(QUIET_S, self._fade, about)

    def show_losses(self, topic: str, oversized: int, overrun: int, max_bytes: int) -> None:
        """Show briefly how many messages on `topic` were too long or came too fast."""
        reasons: list[str] = []
        if oversized:
            reasons.append(f"{oversized} were longer than {max_bytes} bytes")
        if overrun:
            reasons.append(f"{overrun} came faster than they could be handled")
        self.show_briefly(f"losses of {topic}", f"dropped messages on {topic}: {' and '.join(reasons)}")

    def show(self, about: str, sentence: str) -> None:
        """Show a warning until `clear`; `about` must not be of another kind of warning."""
        if about not in self._held:
            log.warning("%s", sentence)
        self._held.add(about)
        self._warnings.warn("graph", sentence, about)

    def clear(self, about: str) -> None:
        """Clear a held warning, if there is one."""
        if about in self._held:
            self._held.discard(about)
            self._warnings.clear("graph", about)

    def close(self) -> None:
        """Clear all warnings."""
        self.replace_all({})
        for about in tuple(self._held):
            self.clear(about)
        for about, timer in tuple(self._passing.items()):
            timer.cancel()
            self._fade(about)

    def _fade(self, about: str) -> None:
        del self._passing[about]
        self._warnings.clear("graph", about)


class GraphMonitor:
    """Begins with an empty graph. In the loop."""

    def __init__(
        self, warnings: BackendWarnings, *, domain: int, distro: str, needs: str, matching: Matching
    ) -> None:
        """Report problems to `warnings`; other parameters as for `findings`."""
        self._warnings = warnings
        self._find_problems = functools.partial(
            findings, domain=domain, distro=distro, needs=needs, matching=matching
        )
        self._graph = Graph(nodes=frozenset(), endpoints=frozenset())
        self._findings: tuple[GraphFinding, ...] = ()
        self._handlers: dict[Declaration, Handler] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Return explanations why nothing happens where nothing is wrong: no nodes, no subscribers."""
        return tuple(finding.sentence for finding in self._findings if finding.is_note)

    def watch(self, handler: Handler) -> BackendHandle:
        """Call `handler` with the graph now, and whenever it has changed."""
        handler(self._graph)
        watch = Declaration(lambda: self._handlers.pop(watch, None))
        self._handlers[watch] = handler
        return watch

    def show(self, graph: Graph, wrong: Mapping[str, str]) -> None:
        """Set the graph; report its problems, and those in `wrong`."""
        self._findings = self._find_problems(graph)
        problems = {finding.about: finding.sentence for finding in self._findings if not finding.is_note}
        self._warnings.replace_all({**problems, **wrong})
        if graph == self._graph:
            return
        self._graph = graph
        for watch, handler in tuple(self._handlers.items()):
            if watch not in self._handlers:  # closed by a previous handler
                continue
            try:
                handler(graph)
            except Exception:
                log.exception("a handler of the ROS graph failed")

    def close(self) -> None:
        """Remove all watchers."""
        self._handlers.clear()


class NodeContext:
    """State that the endpoints of one node share. Created in the loop."""

    max_bytes = MAX_BYTES
    """Maximum size of foreign messages; longer ones are dropped unread."""

    def __init__(self, warnings: WarningSink, dispatcher: Dispatcher) -> None:
        self.warnings = BackendWarnings(warnings)
        self.dispatcher = dispatcher
        self.loop = asyncio.get_running_loop()
        self.ends: set[BackendHandle] = set()
        """Declared endpoints, kept alive here, without those that failed."""

    @property
    def is_closed(self) -> bool:
        """Return True if the backend is closed."""
        return self.dispatcher.is_closed

    def check_open(self) -> None:
        """Raise `BusClosedError` when the backend is closed."""
        if self.is_closed:
            raise BusClosedError("the backend was closed")


C = TypeVar("C", bound=NodeContext)


class RosEndpoint(abc.ABC, Generic[C]):
    """An endpoint of our node."""

    def __init__(self, context: C, name: str) -> None:
        self.name = name
        """Resolved name of its topic or service."""
        self.is_closed = False
        self._context = context

    def close(self) -> None:
        """Leave the graph; no handler runs afterwards."""
        if not self.is_closed:
            self.is_closed = True
            if not self._context.is_closed:
                self._undeclare()
            self._context.ends.discard(self)

    @abc.abstractmethod
    def _undeclare(self) -> None:
        """Withdraw the declarations of the middleware, which is still open."""


class RosServiceServer(RosEndpoint[C]):
    """Answers requests to one service, each in a task."""

    def __init__(self, context: C, service: str, server: Server) -> None:
        super().__init__(context, service)
        self._server = server
        self._tasks: dict[Hashable, asyncio.Task[None]] = {}
        """Tasks of open requests, by the id of the request."""

    def close(self) -> None:
        """Stop serving; open requests are dropped."""
        super().close()
        for task in self._tasks.values():
            task.cancel()

    def _start(self, request: Hashable, work: Coroutine[Any, Any, None]) -> None:
        task = self._context.loop.create_task(work, name=f"answer {self.name}")
        self._tasks[request] = task
        task.add_done_callback(lambda _task: self._tasks.pop(request, None))

    async def _response(self, request: bytes, decode: Callable[[bytes], T]) -> T:
        """Return the decoded response of the server.

        Raises:
            RefusedError: If it refuses, or has failed: its client must not wait for ever.
        """
        try:
            return decode(await self._server(request))
        except RefusedError:
            raise
        except Exception as error:
            log.exception("a request to %s could not be answered", self.name)
            raise RefusedError(f"{type(error).__name__}: {error}") from error


class MessageQueue(Generic[T]):
    """Messages of one topic on their way from threads of the middleware to the loop."""

    def __init__(self, context: NodeContext, topic: str, handler: Callable[[T], None], qos: Qos) -> None:
        """Call `handler` in the loop."""
        self._context = context
        self._topic = topic
        self._handler = handler
        self._lock = threading.Lock()
        capacity = max(qos.depth, MIN_CAPACITY)
        self._messages: collections.deque[T] = collections.deque(maxlen=capacity)
        self._is_scheduled = False
        self._is_closed = False
        self.oversized = 0
        """Number of messages dropped because they were too long."""
        self.overrun = 0
        """Number of messages dropped because the loop was busy."""
        self._lost = 0
        """Number of dropped messages at the last warning."""

    def put(self, message: T, *, is_oversized: bool) -> None:
        """Add a message, or count it as dropped. Any thread."""
        with self._lock:
            if is_oversized:
                self.oversized += 1
            else:
                self.overrun += len(self._messages) == self._messages.maxlen
                self._messages.append(message)
            if self._is_scheduled:
                return
            self._is_scheduled = True
        self._context.dispatcher.schedule(self)

    def close(self) -> None:
        """Handle no further messages."""
        self._is_closed = True

    def drain(self) -> None:
        """Handle the waiting messages. Runs in the loop."""
        with self._lock:
            messages = tuple(self._messages)
            self._messages.clear()
            self._is_scheduled = False
            oversized = self.oversized
            overrun = self.overrun

        # One warning a batch, with the totals: a flood of messages is no flood of warnings
        lost = oversized + overrun
        if lost != self._lost and not self._is_closed:
            self._lost = lost
            self._context.warnings.show_losses(self._topic, oversized, overrun, self._context.max_bytes)
        for message in messages:
            if self._is_closed or self._context.is_closed:
                return
            try:
                self._handler(message)
            except Exception:
                if self._context.dispatcher.should_log(self._topic, "error"):
                    log.exception("what arrived on %s could not be handled", self._topic)


class RosServiceClient(Protocol):
    """Client of one service."""

    async def call(self, request: bytes, *, timeout_s: float) -> bytes:
        """Return the response's CDR; raises as `Backend.call`."""
        ...


class NodeBackend(abc.ABC, Generic[C]):
    """Our node without its endpoints; see `pointit.bridges.ros2.graph.backend.Backend` for the contract."""

    def __init__(
        self, context: C, config: BackendConfig, *, distro: str, needs: str, matching: Matching
    ) -> None:
        """Create with an empty graph. `distro`, `needs` and `matching` as for `findings`."""
        self.node = config.node
        self._context = context
        self._graph_monitor = GraphMonitor(
            context.warnings, domain=config.domain_id, distro=distro, needs=needs, matching=matching
        )
        self.watch = self._graph_monitor.watch
        self._clients: dict[tuple[str, RosType], RosServiceClient] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Return explanations why nothing happens where nothing is wrong: no nodes, no subscribers."""
        return self._graph_monitor.notes

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        """Return the CDR of a server's response.

        Raises:
            TimeoutError: If no node serves it, or not within `timeout_s`; or it refuses; or we lack its type.
            BusClosedError: If the backend is closed.
        """
        self._context.check_open()
        client = self._clients.get((service, kind))
        if client is None:
            client = self._clients[service, kind] = self._client(service, kind)
        return await client.call(request, timeout_s=timeout_s)

    @abc.abstractmethod
    def _client(self, service: str, kind: RosType) -> RosServiceClient:
        """Return a new client of `service`."""

    def _close_endpoints(self) -> None:
        """Close all but the connection, which no longer calls us."""
        self._graph_monitor.close()
        for end in tuple(self._context.ends):
            end.close()
        self._context.warnings.close()
