"""A node in a ROS 2 graph on Zenoh.

No core: it waits for a network.
"""

from collections.abc import Callable

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import Qos, RosType, Server
from pointit.bridges.ros2.graph.node_backend import NodeBackend
from pointit.bridges.ros2.over_zenoh.endpoints import (
    Announcement,
    EndpointContext,
    ZenohReader,
    ZenohServiceClient,
    ZenohServiceServer,
    ZenohWriter,
)
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import LivelinessDirectory, RmwZenoh
from pointit.bridges.ros2.over_zenoh.token import EVERY_TOKEN
from pointit.runtime.clock import Timer
from pointit.runtime.foreign_zenoh import RawSession
from pointit.runtime.service.plugin_guard import WarningSink

NEEDS = "they need RMW_IMPLEMENTATION=rmw_zenoh_cpp, the same ROS_DOMAIN_ID and the same router"
"""Conditions for other nodes to be seen."""
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
            warnings, session=session, rmw=rmw, directory=self._directory, now_ns=now_ns
        )
        super().__init__(context, config, distro=config.distro, needs=NEEDS, matching="definition")
        self._refresh_timer = Timer(context.loop.call_later, self._refresh)
        session.on_change = self._refresh_soon
        self._announcement = Announcement(context, rmw.node_token())
        session.watch_tokens(EVERY_TOKEN, self._directory.change)
        self._refresh_soon()

    @property
    def problem(self) -> str:
        """Return an error message if the connection itself fails, else `""`."""
        return self._session.problem

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> ZenohWriter:
        """Declare a publisher of the resolved name `topic`."""
        return ZenohWriter(self._context, topic, kind, qos)

    def subscribe(self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]) -> ZenohReader:
        """Call `handler(cdr)` for messages of other nodes. Our own messages are not returned."""
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
        self._refresh_timer.cancel()
        self._session.stop()  # so that endpoints do not undeclare themselves one by one
        self._close_endpoints()
        await self._session.close()

    def _refresh_soon(self) -> None:
        if not self._context.is_closed:
            self._refresh_timer.start(SETTLE_S)

    def _refresh(self) -> None:
        problems = {"router": self.problem} if self.problem else {}
        self._graph_monitor.show(self._directory.graph(), problems)
