"""Output to ROS: converts, limits and encodes every route, for every name that it is about.

No core: it sends messages and keeps time.
"""

import asyncio
import functools
from collections.abc import Callable, Iterable

from pointit.bridges.ros2.graph.backend import Graph, Writer
from pointit.bridges.ros2.routing.rate_limiter import RateLimiter, reclaim_delay_s
from pointit.bridges.ros2.routing.route_types import OutboundRoute
from pointit.bridges.ros2.routing.site import RosSite
from pointit.runtime.clock import Timer
from pointit.schemas import Message
from pointit.schemas.topics import Topic


class _Line:
    """One route to one name in ROS."""

    def __init__(
        self, route: OutboundRoute, ros: str, site: RosSite, has_reader: Callable[[str], bool]
    ) -> None:
        self.route = route
        self.ros = ros
        self._site = site
        self._has_reader = has_reader
        """True if the ROS graph shows a subscriber."""
        self._is_read = False
        self._rate_limiter = RateLimiter(route.rate_hz)
        self._loop = asyncio.get_running_loop()
        self._writer: Writer | None = None
        self._waiting: dict[str, tuple[Message, str]] = {}
        """Messages delayed by the rate limit, by name if each has a message of its own."""
        self._due_timer = Timer(site.bus.call_later, self._send_waiting)
        self._repeat_timer = Timer(site.bus.call_later, self._repeat)
        self._reclaim_timer = Timer(site.bus.call_later, self._advertise)
        self._later: list[asyncio.TimerHandle] = []
        self._last: dict[str, tuple[Message, str, float]] = {}
        """Messages to repeat with their arrival times, by key of `_waiting`."""
        self._sent: dict[str, tuple[bytes, ...]] = {}
        """Last values sent, for routes that send only changes, by key of `_waiting`."""
        self._is_refused = False
        self._advertise()

    def make_room(self, *, is_given: bool) -> None:
        """Yield to other publishers of this name until shortly after they end."""
        if is_given:
            self._reclaim_timer.cancel()
            self._end_writer()
        elif self._writer is None and not self._reclaim_timer.is_running:
            self._reclaim_timer.start(reclaim_delay_s())

    def look(self) -> None:
        """Notify the route when the first subscriber appears."""
        is_read = self._has_readers
        is_first = is_read and not self._is_read
        if is_first and self.route.begins is not None:
            self.route.begins()
        self._is_read = is_read

    def close(self) -> None:
        """Remove it from the graph, after its last value."""
        if self.route.has_end:
            types = self._site.state.types
            empty = types.make(self.route.type)
            self._put(types.encode(self.route.type, empty))
        for timer in (self._due_timer, self._repeat_timer, self._reclaim_timer):
            timer.cancel()
        for later in self._later:
            later.cancel()
        self._end_writer()
        self._site.bus.clear("message", self.ros)

    def _advertise(self) -> None:
        kind = self._site.state.types.kind(self.route.type)
        backend = self._site.backend
        self._writer = backend.advertise(self.ros, kind, self.route.qos)
        self._sent = {}

    def _end_writer(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def take(self, message: Message, name: str) -> None:
        """Send `message` as soon as the route's rate allows; of delayed ones, the newest."""
        wait_s = self._rate_limiter.wait_s(self._loop.time())
        if not self._due_timer.is_running and wait_s <= 0.0:
            self._rate_limiter.sent(self._loop.time())
            self._send(message, name)
            return
        self._waiting[self._key_of(name)] = message, name
        self._due_timer.start(wait_s)

    def forget(self, name: str) -> None:
        """Forget what was sent about `name`."""
        if self.route.forgets is not None:
            self.route.forgets(name)
        self._last.pop(name, None)
        if self.route.is_each:
            self._waiting.pop(name, None)
            self._sent.pop(name, None)

    def _send_waiting(self) -> None:
        waiting = self._waiting
        self._waiting = {}
        self._rate_limiter.sent(self._loop.time())
        for message, name in waiting.values():
            self._send(message, name)

    def _send(self, message: Message, name: str) -> None:
        if self.route.repeat_hz is not None:
            key = self._key_of(name)
            self._last[key] = message, name, self._loop.time()
            self._repeat_later()
        self._write(message, name)

    def _write(self, message: Message, name: str, *, again_ns: int | None = None) -> None:
        if self._writer is None:
            return
        if not (self._has_readers or self._keeps):
            return
        encode = self._site.state.types.encode
        try:
            values = self.route.convert(message, name, self._site.state, again_ns=again_ns)
            cdrs = tuple([encode(self.route.type, value) for value in values])
        except ValueError as error:
            self._is_refused = True
            sentence = f"{self.ros} could not be sent to ROS: {error}"
            self._site.bus.warn("message", sentence, self.ros)
            return
        if self._is_refused:
            self._is_refused = False
            self._site.bus.clear("message", self.ros)

        # Equal values are compared as bytes: a NaN does not equal itself
        if self.route.on_change:
            key = self._key_of(name)
            if cdrs == self._sent.get(key):
                return
            self._sent[key] = cdrs

        # The first value at once, the others one after the other
        self._later = [timer for timer in self._later if timer.when() > self._loop.time()]
        for count, cdr in enumerate(cdrs):
            if count and self.route.apart_s:
                put = functools.partial(self._put, cdr)
                timer = self._site.bus.call_later(count * self.route.apart_s, put)
                self._later.append(timer)
            else:
                self._put(cdr)

    def _key_of(self, name: str) -> str:
        return name if self.route.is_each else ""

    @property
    def _has_readers(self) -> bool:
        """Return True if there is a subscriber.

        The graph does not show a node that is older than the router, but its middleware knows that it
        subscribes.
        """
        if self._has_reader(self.ros):
            return True
        return self._writer is not None and self._writer.is_read

    @property
    def _keeps(self) -> bool:
        """Return True if messages sent now matter to late joiners."""
        return self.route.qos.lasts or self.route.on_change

    def _put(self, cdr: bytes) -> None:
        if self._writer is not None:
            self._writer.put(cdr)

    def _repeat_later(self) -> None:
        if self.route.repeat_hz is not None and self._last:
            self._repeat_timer.start(1.0 / self.route.repeat_hz)

    def _repeat(self) -> None:
        oldest_s = self._loop.time() - self.route.repeat_for_s
        self._last = {key: last for key, last in self._last.items() if last[2] > oldest_s}
        for message, name, _ in self._last.values():
            self._write(message, name, again_ns=self._site.clock.now_ns())
        self._repeat_later()


class Outbox:
    """All output."""

    def __init__(self, routes: Iterable[OutboundRoute], site: RosSite) -> None:
        """Appear in the graph with every route without a person."""
        self._site = site
        self._read: frozenset[str] = frozenset()
        self._given: frozenset[str] = frozenset()
        """Names that other nodes publish."""
        self._lines: dict[tuple[str, str], _Line] = {}
        """By route and name for its placeholder."""
        self._routes: dict[Topic[Message], list[OutboundRoute]] = {}
        for route in routes:
            for topic in route.reads:
                self._routes.setdefault(topic, []).append(route)
            if "{" not in route.ros:
                self._line(route, "")

    @property
    def topics(self) -> tuple[Topic[Message], ...]:
        """Return our topics that are forwarded."""
        return tuple(self._routes)

    def take(self, topic: Topic[Message], message: Message, name: str) -> None:
        """Send `message`, which the state has already, by all its routes."""
        for route in self._routes.get(topic, ()):
            if route.has_user_publisher and name in self._site.state.ros_users:
                continue
            placeholder = name if "{" in route.ros else ""
            self._line(route, placeholder).take(message, name)

    def join(self, user: str) -> None:
        """Add the routes about `user`, without those that a ROS-only user's own nodes publish."""
        is_ros_user = user in self._site.state.ros_users
        routes: dict[str, OutboundRoute] = {}
        for readers in self._routes.values():
            for route in readers:  # a route that reads several topics is listed at each
                routes[route.name] = route
        for route in routes.values():
            if "{user}" not in route.ros:
                continue
            if is_ros_user and route.has_user_publisher:
                line = self._lines.pop((route.name, user), None)
                if line is not None:
                    line.close()
            else:
                self._line(route, user)

    def leave(self, user: str) -> None:
        """Remove the routes about `user`."""
        for key, line in tuple(self._lines.items()):
            if key[1] == user and "{user}" in line.route.ros:
                del self._lines[key]
                line.close()
        self._forget(user, "user")

    def end(self, instance: str) -> None:
        """Forget what was sent about a service that has gone."""
        self._forget(instance, "service")

    def look(self, graph: Graph) -> None:
        """Update subscribers, and yield names that others publish."""
        readers: list[str] = []
        publishers: list[str] = []
        for endpoint in graph.endpoints:
            if endpoint.is_ours:
                continue
            if endpoint.kind == "subscriber":
                readers.append(endpoint.name)
            elif endpoint.kind == "publisher":
                publishers.append(endpoint.name)
        self._read = frozenset(readers)
        self._given = frozenset(publishers)
        for line in self._lines.values():
            self._yield(line)
            line.look()

    def close(self) -> None:
        """Remove all routes."""
        for line in self._lines.values():
            line.close()
        self._lines.clear()

    def _line(self, route: OutboundRoute, name: str) -> _Line:
        key = route.name, name
        line = self._lines.get(key)
        if line is None:
            ros = route.ros_name(self._site.state, name)
            line = _Line(route, ros, self._site, self._has_reader)
            self._lines[key] = line
            self._yield(line)
        return line

    def _forget(self, name: str, placeholder: str) -> None:
        for line in self._lines.values():
            if any(topic.placeholder == placeholder for topic in line.route.reads):
                line.forget(name)

    def _yield(self, line: _Line) -> None:
        if line.route.yields:
            name = line.route.yields_to or line.ros
            line.make_room(is_given=name in self._given)

    def _has_reader(self, ros: str) -> bool:
        return ros in self._read
