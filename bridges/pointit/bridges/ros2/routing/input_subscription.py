"""Subscription to one name in ROS, with its rate limits."""

import asyncio
from collections.abc import Callable

from pointit.bridges.ros2.graph.backend_warnings import BackendWarnings
from pointit.bridges.ros2.routing.rate_limit import RateLimiter
from pointit.bridges.ros2.routing.route_types import InboundRoute
from pointit.bridges.ros2.routing.site import Site
from pointit.runtime.clock import Timer

BURST_S = 0.03
"""Burst of a route with a limit of bytes, in seconds of its rate."""


class InputSubscription:
    """Receives messages. Above the rate, the newest (of each person, if it names people) is handled later."""

    def __init__(self, route: InboundRoute, name: str, site: Site, take: Callable[[bytes], None]) -> None:
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
        self._timer = Timer(site.bus.call_later, self._due)
        self._ros = route.ros_name(site.state, name)
        kind = site.state.types.kind(route.type)
        self._end = site.backend.subscribe(self._ros, kind, route.qos, self._on_message)

    def close(self) -> None:
        """Unsubscribe."""
        self._end.close()
        self._timer.cancel()
        self._warnings.close()

    def _on_message(self, cdr: bytes) -> None:
        route = self._route
        if len(cdr) > route.max_bytes or (route.rate_hz is None and route.bytes_hz is None):
            self._take(cdr)  # too long messages are rejected unread
            return
        people = ("",) if route.people is None else route.people(cdr, self._site.state)
        if not people:
            return
        wait_s = self._wait_s()
        if not self._timer.is_running and wait_s <= 0.0:
            self._pass(cdr)
            return
        for each in people:
            self._waiting.pop(each, None)  # keeps the order: no message is followed by an older one
            self._waiting[each] = cdr
        if route.bytes_hz is not None and self._byte_limiter.wait_s(self._loop.time()) > 0.0:
            self._warnings.show_briefly(
                f"amount from {self._ros}",
                f"{self._ros} brings more of people than the {route.bytes_hz / 1e6:g} MB a second that are "
                "read: of each the newest counts; publish their frames less often, or apart from all others",
            )
        self._timer.start(wait_s)

    def _due(self) -> None:
        while self._waiting and self._wait_s() <= 0.0:
            oldest = next(iter(self._waiting.values()))
            self._waiting = {name: cdr for name, cdr in self._waiting.items() if cdr is not oldest}
            self._pass(oldest)
        if self._waiting:
            self._timer.start(self._wait_s())

    def _wait_s(self) -> float:
        now_s = self._loop.time()
        return max(self._message_limiter.wait_s(now_s), self._byte_limiter.wait_s(now_s))

    def _pass(self, cdr: bytes) -> None:
        now_s = self._loop.time()
        self._message_limiter.sent(now_s)
        self._byte_limiter.sent(now_s, len(cdr))
        self._take(cdr)
