"""A node in a ROS 2 graph on Zenoh."""

import asyncio
from collections.abc import Callable

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType, Server
from pointit.bridges.ros2.graph.backend_warnings import BackendWarnings
from pointit.bridges.ros2.graph.graph_monitor import GraphMonitor
from pointit.bridges.ros2.over_zenoh.endpoint_context import EndpointContext
from pointit.bridges.ros2.over_zenoh.graph import LivelinessDirectory
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from pointit.bridges.ros2.over_zenoh.services import RosServiceServer, ServiceClient
from pointit.bridges.ros2.over_zenoh.topics import TopicReader, TopicWriter
from pointit.bridges.ros2.routing.calls import Calls
from pointit.runtime.errors import BusClosedError
from pointit.runtime.foreign_zenoh.raw_session import RawSession
from pointit.runtime.service.surroundings import WarningSink

NEEDS = "they need RMW_IMPLEMENTATION=rmw_zenoh_cpp, the same ROS_DOMAIN_ID and the same router"
"""Conditions for other nodes to be seen."""
UNSEEN_S = 1.0
"""Interval of checking which topics exchange messages; nodes without a token are reported the second time."""
SETTLE_S = 0.05
"""Time (s) to gather changes of the graph: a node that starts has twenty endpoints."""


class ZenohBackend:
    """Our node; see `pointit.bridges.ros2.graph.backend.Backend` for the contract."""

    def __init__(
        self,
        session: RawSession,
        rmw: RmwZenoh,
        warnings: WarningSink,
        config: BackendConfig,
        now_ns: Callable[[], int],
    ) -> None:
        """Appear in the graph; must be called in the loop. `session` is closed by this backend."""
        self._session = session
        self.node = config.node
        self._loop = asyncio.get_running_loop()
        self._warnings = BackendWarnings(warnings)
        self._refreshing: asyncio.TimerHandle | None = None
        self._directory = LivelinessDirectory(rmw.read, config.domain_id, self._refresh_soon)
        self._context = EndpointContext(
            session, rmw, self._warnings, self._directory, now_ns, config.max_message_bytes
        )
        self._graph_monitor = GraphMonitor(
            self._warnings, domain=config.domain_id, distro=config.distro, needs=NEEDS, matching="definition"
        )
        self.watch = self._graph_monitor.watch
        self._clients: dict[tuple[str, RosType], ServiceClient] = {}
        self._calls = Calls()
        session.on_change = self._refresh_soon
        self._announcement = self._context.announce(rmw.node_token())
        session.watch_tokens(rmw.tokens, self._directory.change)
        self._refresh_soon()
        self._looking = self._loop.call_later(UNSEEN_S, self._look)

    @property
    def problem(self) -> str:
        """Return an error message if the connection itself fails, else `""`."""
        return self._session.problem

    @property
    def notes(self) -> tuple[str, ...]:
        """Return explanations why nothing happens where nothing is wrong: no nodes, no subscribers."""
        return self._graph_monitor.notes

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> TopicWriter:
        """Declare a publisher of the resolved name `topic`."""
        return TopicWriter(self._context, topic, kind, qos)

    def subscribe(self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]) -> TopicReader:
        """Call `handler(cdr)` for what others publish; what we publish ourselves never comes back."""
        return TopicReader(self._context, topic, kind, qos, handler)

    def serve(self, service: str, kind: RosType, server: Server) -> RosServiceServer:
        """Answer requests to `service`."""
        return RosServiceServer(self._context, service, kind, server)

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        """Return the CDR of a server's response.

        Raises:
            TimeoutError: If no node serves it, or not within `timeout_s`; or it refuses.
            BusClosedError: If the backend was closed meanwhile.
        """
        if self._session.is_closed:
            raise BusClosedError("the backend was closed")
        client = self._clients.get((service, kind))
        if client is None:
            client = self._clients[service, kind] = ServiceClient(self._context, service, kind)
        return await self._calls.answered(client.call(request, timeout_s=timeout_s), f"call {service}")

    async def close(self) -> None:
        """Leave the graph; no handler runs afterwards."""
        if self._session.is_closed:
            return
        self._looking.cancel()
        if self._refreshing is not None:
            self._refreshing.cancel()
        self._graph_monitor.close()
        self._calls.close()
        self._session.stop()  # so that endpoints do not undeclare themselves one by one
        for end in tuple(self._context.ends):
            end.close()
        await self._session.close()
        self._warnings.close()

    def _look(self) -> None:
        """Update the topics that exchange messages with us, with or without a token."""
        self._looking.cancel()
        ends: set[tuple[EndpointKind, str]] = set()
        for end in self._context.ends:
            if isinstance(end, TopicWriter) and end.is_read:
                ends.add(("subscriber", end.topic))
            elif isinstance(end, TopicReader) and end.has_heard:
                end.has_heard = False
                ends.add(("publisher", end.topic))
        self._directory.exchange(ends)
        self._looking = self._loop.call_later(UNSEEN_S, self._look)

    def _refresh_soon(self) -> None:
        if self._refreshing is None and not self._session.is_closed:
            self._refreshing = self._loop.call_later(SETTLE_S, self._refresh)

    def _refresh(self) -> None:
        self._refreshing = None
        if self._session.is_closed:
            return
        self._graph_monitor.show(self._directory.graph(), {"router": self.problem} if self.problem else {})
