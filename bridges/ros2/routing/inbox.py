"""Input from ROS: topics forwarded to our bus, and ROS services answered by PointIt services.

No core: it waits for messages.
"""

import asyncio
import functools
from collections import Counter
from collections.abc import Callable, Coroutine, Iterable
from typing import Any

from pointit.bridges.ros2.graph.backend import BackendHandle, Graph
from pointit.bridges.ros2.graph.node_backend import BackendWarnings
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.rate_limiter import RateLimiter, reclaim_delay_s
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    InboundRoute,
    ServiceRoute,
    Taken,
)
from pointit.bridges.ros2.routing.site import RosSite
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import Timer, WallClock
from pointit.runtime.errors import BusError, RefusedError, RequestError
from pointit.schemas import Message, Reply
from pointit.schemas.topics import Request, Topic

BURST_S = 0.03
"""Burst of a route with a limit of bytes, in seconds of its rate."""

MAX_ASKED = 64
"""Maximum number of open requests of ROS nodes; more are refused."""


class InputSubscription:
    """Receives messages. Above the rate, the newest (of each person, if it names people) is handled later."""

    def __init__(self, route: InboundRoute, name: str, site: RosSite, take: Callable[[bytes], None]) -> None:
        """Subscribe.

        Args:
            route: of which name in ROS.
            name: for its placeholder; `""` if it has none.
            site: shared.
            take: called with the CDR of accepted messages.
        """
        self._route = route
        self._site = site
        self._warnings = BackendWarnings(site.bus)
        self._take = take
        self._loop = asyncio.get_running_loop()
        self._message_limiter = RateLimiter(route.rate_hz)
        self._byte_limiter = RateLimiter(route.bytes_hz, early_s=BURST_S)
        self._waiting: dict[str, bytes] = {}
        """Newest message by person, or by `""` if messages name no people; as received."""
        self._timer = Timer(site.bus.call_later, self._process_due)
        self._ros = route.ros_name(site.state, name)
        kind = site.state.types.kind(route.type)
        backend = site.backend
        self._end = backend.subscribe(self._ros, kind, route.qos, self._on_message)

    def close(self) -> None:
        """Unsubscribe."""
        self._end.close()
        self._timer.cancel()
        self._warnings.close()

    def _on_message(self, cdr: bytes) -> None:
        route = self._route
        is_unlimited = route.rate_hz is None and route.bytes_hz is None
        if is_unlimited or len(cdr) > route.max_bytes:
            self._take(cdr)  # too long messages are rejected unread
            return
        people: tuple[str, ...] = ("",)
        if route.people is not None:
            people = route.people(cdr, self._site.state)
        if not people:
            return
        wait_s = self._wait_s()
        if not self._timer.is_running and wait_s <= 0.0:
            self._pass_on(cdr)
            return

        # Too early: it waits, and replaces the message that waits for the same person
        for user in people:
            self._waiting.pop(user, None)  # keeps the order: no message is followed by an older one
            self._waiting[user] = cdr
        if route.bytes_hz is not None:
            bytes_wait_s = self._byte_limiter.wait_s(self._loop.time())
            if bytes_wait_s > 0.0:
                self._show_amount(route.bytes_hz)
        self._timer.start(wait_s)

    def _show_amount(self, bytes_hz: float) -> None:
        sentence = (
            f"{self._ros} brings more of people than the {bytes_hz / 1e6:g} MB a second that are "
            "read: of each the newest counts; publish their frames less often, or apart from all others"
        )
        self._warnings.show_briefly(f"amount from {self._ros}", sentence)

    def _process_due(self) -> None:
        while self._waiting and self._wait_s() <= 0.0:
            # The same message may wait for several people: it is processed once
            oldest = next(iter(self._waiting.values()))
            self._waiting = {name: cdr for name, cdr in self._waiting.items() if cdr is not oldest}
            self._pass_on(oldest)
        if self._waiting:
            self._timer.start(self._wait_s())

    def _wait_s(self) -> float:
        now_s = self._loop.time()
        return max(self._message_limiter.wait_s(now_s), self._byte_limiter.wait_s(now_s))

    def _pass_on(self, cdr: bytes) -> None:
        now_s = self._loop.time()
        self._message_limiter.sent(now_s)
        self._byte_limiter.sent(now_s, len(cdr))
        self._take(cdr)


class Inbox:
    """All input."""

    def __init__(
        self, routes: Iterable[InboundRoute], services: Iterable[ServiceRoute], site: RosSite
    ) -> None:
        self._site = site
        self._wall = WallClock()
        self._loop = asyncio.get_running_loop()
        self._routes = tuple(routes)
        self._services = tuple(services)
        self._served: frozenset[str] = frozenset()
        """Services that other nodes offer."""
        self._ends: dict[tuple[str, str], BackendHandle] = {}
        """Declared endpoints in ROS, by route and name."""
        self._reclaims: dict[tuple[str, str], asyncio.TimerHandle | None] = {}
        """Routes left to others, as `_ends`, and the timer to reclaim them once they are free."""
        self._publishers: dict[str, tuple[str, Publisher[Any]]] = {}
        """Our publishers by key, with the name they are about."""
        self._counts: Counter[str] = Counter()
        """Numbers of our last messages, by key."""
        self._asked: set[asyncio.Task[None]] = set()
        self._open = 0
        """Number of open requests."""
        self._names: set[str] = {""}
        self._declare("")

    def join(self, user: str) -> None:
        """Subscribe to the routes about `user`."""
        if user not in self._names:
            self._names.add(user)
            self._declare(user)
            context = ConversionContext(self._site.state, user, self._site.clock.now_ns())
            for route in self._routes:
                if route.on_presence is None:
                    continue
                outputs = route.on_presence(context)
                if outputs:
                    self._process(outputs, _subject(route, self._site.state, ""))

    def leave(self, user: str) -> None:
        """Unsubscribe from the routes about `user`."""
        self._names.discard(user)
        for key in [key for key in self._ends if key[1] == user]:
            self._ends.pop(key).close()
        for key in [key for key in self._reclaims if key[1] == user]:
            self._cancel_reclaim(key)

        # No warnings remain, nor what the converters remember
        rows: tuple[InboundRoute | ServiceRoute, ...] = (*self._routes, *self._services)
        for route in rows:
            if "{" in route.ros:
                subject = _subject(route, self._site.state, user)
                self._site.bus.clear("message", subject)
        for route in self._routes:
            if route.forgets is not None:
                route.forgets(user)

        # Their messages end at all readers
        for topic_key, (name, publisher) in tuple(self._publishers.items()):
            if name == user:
                del self._publishers[topic_key]
                publisher.close()

    def listen(self, route: InboundRoute, name: str) -> BackendHandle:
        """Receive what `route` has about `name` until the returned endpoint is closed."""
        process = functools.partial(self._on_message, route, name)
        return InputSubscription(route, name, self._site, process)

    def stop_writing(self, route: InboundRoute, name: str) -> None:
        """Stop publishing messages of `route` about `name`: another writer does."""
        for topic in route.into:
            key = topic.at(name)
            if key in self._publishers:
                _, publisher = self._publishers.pop(key)
                publisher.close()
        subject = _subject(route, self._site.state, name)
        self._site.bus.clear("message", subject)

    def publish(self, output: BusOutput) -> None:
        """Publish on our bus, numbered."""
        message = output.what
        if isinstance(output.at, Request) or not isinstance(message, Message):
            return
        key = output.at.at(output.name)
        self._counts[key] += 1
        numbered = message.model_copy(update={"seq": self._counts[key]})
        self._publisher(output.at, output.name).put(numbered)

    def on_graph(self, graph: Graph) -> None:
        """Leave services to other nodes that offer them."""
        names: list[str] = []
        for endpoint in graph.endpoints:
            if endpoint.kind == "server" and not endpoint.is_ours:
                names.append(endpoint.name)
        self._served = frozenset(names)
        for name in self._names:
            self._declare_services(name)

    def close(self) -> None:
        """Close all endpoints."""
        for end in self._ends.values():
            end.close()
        self._ends.clear()
        for key in tuple(self._reclaims):
            self._cancel_reclaim(key)
        for task in self._asked:
            task.cancel()

    def _declare(self, name: str) -> None:
        """Declare all routes about `name`, or about nobody if it is `""`."""
        placeholder = "user" if name else ""
        for route in self._routes:
            if bool(name) != ("{" in route.ros):
                continue
            if name and route.of_ros_users:
                continue  # declared for ROS-only users alone, by `listen`
            for topic in route.into:
                if not isinstance(topic, Request) and topic.placeholder == placeholder:
                    self._publisher(topic, name)
            self._ends[route.name, name] = self.listen(route, name)
        self._declare_services(name)

    def _declare_services(self, name: str) -> None:
        for route in self._services:
            if bool(name) != ("{" in route.ros):
                continue
            key = route.name, name
            if route.yields and route.ros_name(self._site.state, name) in self._served:
                self._cancel_reclaim(key)
                self._reclaims[key] = None
                if key in self._ends:
                    self._ends.pop(key).close()
            elif key not in self._reclaims:
                self._serve(route, name)
            elif self._reclaims[key] is None:  # free again
                serve = functools.partial(self._serve, route, name)
                self._reclaims[key] = self._site.bus.call_later(reclaim_delay_s(), serve)

    def _serve(self, route: ServiceRoute, name: str) -> None:
        key = route.name, name
        self._cancel_reclaim(key)
        if key not in self._ends:
            state = self._site.state
            service = route.ros_name(state, name)
            answer = functools.partial(self._answer, route, name)
            self._ends[key] = self._site.backend.serve(service, state.types.kind(route.type), answer)

    def _cancel_reclaim(self, key: tuple[str, str]) -> None:
        timer = self._reclaims.pop(key, None)
        if timer is not None:
            timer.cancel()

    def _on_message(self, route: InboundRoute, name: str, cdr: bytes) -> None:
        state = self._site.state
        clock = self._site.clock
        subject = _subject(route, state, name)
        try:
            value = state.types.decode(route.type, cdr, max_bytes=route.max_bytes)
        except ValueError as error:
            sentence = f"what came {subject} was dropped: {error}"
            self._site.bus.warn("message", sentence, subject)
            return
        now_ns = clock.now_ns()
        wall_ns = self._wall.now_ns()
        outputs = route.convert(value, name, state, now_ns=now_ns, wall_ns=wall_ns)
        self._process(outputs, subject)

    def _process(self, outputs: Taken, subject: str) -> None:
        """Publish and query. The route's warning is cleared when all queries have succeeded, not before."""
        warnings: list[ConversionWarning] = []
        queries: list[BusOutput] = []
        for item in outputs:
            if isinstance(item, ConversionWarning):
                warnings.append(item)
            elif isinstance(item.at, Request):
                queries.append(item)
        if warnings or not queries:
            self._warn(subject, warnings)
        for item in outputs:
            if isinstance(item, BusOutput):
                self.publish(item)
        if queries:
            self._ask_soon(queries, subject, is_well=not warnings)

    def _publisher(self, topic: Topic[Any], name: str) -> Publisher[Any]:
        key = topic.at(name)
        if key not in self._publishers:
            publisher = self._site.bus.publisher(topic, name)
            self._publishers[key] = name, publisher
        return self._publishers[key][1]

    def _ask_soon(self, queries: list[BusOutput], subject: str, *, is_well: bool) -> None:
        accepted = queries[: MAX_ASKED - self._open]
        if len(accepted) < len(queries):
            is_well = False
            sentence = f"what came {subject} was dropped: {MAX_ASKED} wishes are open already"
            self._site.bus.warn("message", sentence, subject)
        self._open += len(accepted)

        async def ask() -> None:
            try:
                replies = await asyncio.gather(*(self._ask(query, subject) for query in accepted))
            finally:
                self._open -= len(accepted)
            is_refused = any(isinstance(reply, str) for reply in replies)
            if is_well and not is_refused:
                self._site.bus.clear("message", subject)

        self._run(ask)

    def _run(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        task = self._loop.create_task(work())
        self._asked.add(task)
        task.add_done_callback(self._asked.discard)

    async def _ask(self, output: BusOutput, subject: str) -> Reply | str:
        """Return the reply, or the reason of a refusal, which is a warning too."""
        try:
            reply: Reply = await self._site.bus.call(output.at, output.what, output.name)  # pyrefly: ignore[bad-argument-type, bad-specialization]  # a row of both kinds
        except (BusError, RequestError) as error:
            sentence = f"what came {subject} was not done: {error}"
            self._site.bus.warn("message", sentence, subject)
            return sentence
        return reply

    async def _answer(self, route: ServiceRoute, name: str, cdr: bytes) -> bytes:
        """Answer a request of ROS.

        Raises:
            RefusedError: If it was refused, and its response has no field for that.
        """
        state = self._site.state
        types = state.types
        subject = _subject(route, state, name)
        response = types.response_of(route.type)
        try:
            request_type = types.request_of(route.type)
            value = types.decode(request_type, cdr, max_bytes=route.max_bytes)
        except ValueError as error:
            sentence = f"what came {subject} was refused: {error}"
            self._site.bus.warn("message", sentence, subject)
            if not route.has_result:
                raise RefusedError(sentence) from error
            return types.encode(response, types.make(response))

        # Ask our service that does it, unless the request cannot be converted
        now_ns = self._site.clock.now_ns()
        context = ConversionContext(state, name, now_ns, wall_ns=self._wall.now_ns())
        request = route.asks(value, context)
        refusal = ""
        reply: Reply | None = None
        try:
            if isinstance(request, ConversionWarning):
                refusal = request.sentence
                self._warn(subject, [request])
            else:
                result = await self._ask(request, subject)
                if isinstance(result, str):
                    refusal = result
                else:
                    reply = result
                    self._site.bus.clear("message", subject)
        finally:  # also when this is cancelled: the route may wait for the result
            answer = route.response(value, reply, context)

        # A response without a field for a refusal is replaced by an error
        if reply is None and not route.has_result:
            raise RefusedError(refusal)
        return types.encode(response, answer)

    def _warn(self, subject: str, warnings: list[ConversionWarning]) -> None:
        sentences = [warning.sentence for warning in warnings[:3]]
        self._site.bus.warn("message", "; ".join(sentences), subject)


def _subject(route: InboundRoute | ServiceRoute, state: ConversionState, name: str) -> str:
    return f"from {route.ros_name(state, name)}{route.reader}"
