"""A node in a ROS 2 graph on Zenoh."""

from collections.abc import Callable

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType, Server
from pointit.bridges.ros2.graph.node_backend import NodeBackend
from pointit.bridges.ros2.over_zenoh.endpoint_context import Announcement, EndpointContext
from pointit.bridges.ros2.over_zenoh.graph import LivelinessDirectory
from pointit.bridges.ros2.over_zenoh.keys import EVERY_TOKEN
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from pointit.bridges.ros2.over_zenoh.services import ZenohServiceClient, ZenohServiceServer
from pointit.bridges.ros2.over_zenoh.topics import ZenohReader, ZenohWriter
from pointit.runtime.clock import Timer
from pointit.runtime.foreign_zenoh.raw_session import RawSession
from pointit.runtime.service.surroundings import WarningSink

NEEDS = "they need RMW_IMPLEMENTATION=rmw_zenoh_cpp, the same ROS_DOMAIN_ID and the same router"
"""Conditions for other nodes to be seen."""
UNSEEN_S = 1.0
"""Interval of checking which topics exchange messages; nodes without a token are reported the second time."""
SETTLE_S = 0.05
"""Time (s) to gather changes of the graph: a node that starts has twenty endpoints."""


class ZenohBackend(NodeBackend[EndpointContext]):
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
        self._directory = LivelinessDirectory(rmw.read, config.domain_id, self._refresh_soon)
        context = EndpointContext(
            config, warnings, session=session, rmw=rmw, directory=self._directory, now_ns=now_ns
        )
        super().__init__(context, config, distro=config.distro, needs=NEEDS, matching="definition")
        self._refresh_timer = Timer(context.loop.call_later, self._refresh)
        self._look_timer = Timer(context.loop.call_later, self._look)
        session.on_change = self._refresh_soon
        self._announcement = Announcement(context, rmw.node_token())
        session.watch_tokens(EVERY_TOKEN, self._directory.change)
        self._refresh_soon()
        self._look_timer.start(UNSEEN_S)

    @property
    def problem(self) -> str:
        """Return an error message if the connection itself fails, else `""`."""
        return self._session.problem

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> ZenohWriter:
        """Declare a publisher of the resolved name `topic`."""
        return ZenohWriter(self._context, topic, kind, qos)

    def subscribe(self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]) -> ZenohReader:
        """Call `handler(cdr)` for what others publish; what we publish ourselves never comes back."""
        return ZenohReader(self._context, topic, kind, qos, handler)

    def serve(self, service: str, kind: RosType, server: Server) -> ZenohServiceServer:
        """Answer requests to `service`."""
        return ZenohServiceServer(self._context, service, kind, server)

    def _client(self, service: str, kind: RosType) -> ZenohServiceClient:
        return ZenohServiceClient(self._context, service, kind)

    async def close(self) -> None:
        """Leave the graph; no handler runs afterwards."""
        if self._context.is_closed:
            return
        self._look_timer.cancel()
        self._refresh_timer.cancel()
        self._session.stop()  # so that endpoints do not undeclare themselves one by one
        self._close_endpoints()
        await self._session.close()

    def _look(self) -> None:
        """Update the topics that exchange messages with us, with or without a token."""
        ends: set[tuple[EndpointKind, str]] = set()
        for end in self._context.ends:
            if isinstance(end, ZenohWriter) and end.is_read:
                ends.add(("subscriber", end.name))
            elif isinstance(end, ZenohReader) and end.has_heard:
                end.has_heard = False
                ends.add(("publisher", end.name))
        self._directory.exchange(ends)
        self._look_timer.start(UNSEEN_S)

    def _refresh_soon(self) -> None:
        if not self._context.is_closed:
            self._refresh_timer.start(SETTLE_S)

    def _refresh(self) -> None:
        self._graph_monitor.show(self._directory.graph(), {"router": self.problem} if self.problem else {})
