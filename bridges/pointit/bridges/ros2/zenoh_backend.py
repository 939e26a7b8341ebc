"""A node in a ROS 2 graph on Zenoh, whichever way ROS is written there."""

import asyncio
import logging
from collections.abc import Callable

from pointit.bridges.ros2.backend import Closable, Graph, Qos, RosType, Server
from pointit.bridges.ros2.complaints import Complaints
from pointit.bridges.ros2.dialect import Dialect
from pointit.bridges.ros2.findings import Finding, findings
from pointit.bridges.ros2.graph import Roster
from pointit.bridges.ros2.seat import Seat
from pointit.bridges.ros2.zenoh_services import ServiceClient, ServiceDesk
from pointit.bridges.ros2.zenoh_topics import TopicReader, TopicWriter
from pointit.runtime.errors import BusClosedError
from pointit.runtime.health import Warnings
from pointit.runtime.zenoh_plain import PlainSession

log = logging.getLogger(__name__)

SETTLE_S = 0.05
"""How long changes of the graph are gathered: a node that starts has twenty endpoints."""


class ZenohBackend:
    """Our node; see `pointit.bridges.ros2.backend.Backend` for the contract."""

    def __init__(
        self,
        session: PlainSession,
        dialect: Dialect,
        warnings: Warnings,
        *,
        node: str,
        domain: int,
        distro: str,
        now_ns: Callable[[], int],
        max_bytes: int,
        needs: str = "",
    ) -> None:
        """Appear in the graph; must be called in the loop.

        Args:
            session: belongs to this backend alone, which closes it.
            dialect: how ROS is written there.
            warnings: where is shown what will not work, and what to do.
            node: our full name.
            domain: ours.
            distro: the ROS distribution of the others.
            now_ns: what the time is, for attachments.
            max_bytes: of foreign messages; longer ones are dropped unread.
            needs: what other nodes need to be seen, for people.
        """
        self._session = session
        self._node = node
        self._domain = domain
        self._distro = distro
        self._needs = needs
        self._loop = asyncio.get_running_loop()
        self._complaints = Complaints(warnings)
        self._refreshing: asyncio.TimerHandle | None = None
        self._roster = Roster(dialect.read, domain, self._refresh_soon)
        self._seat = Seat(
            session, dialect, self._complaints, self._roster, now_ns=now_ns, max_bytes=max_bytes
        )
        self._graph = self._roster.graph()
        self._findings: tuple[Finding, ...] = ()
        self._watchers: list[_Watch] = []
        self._clients: dict[tuple[str, RosType], ServiceClient] = {}
        self._calls: set[asyncio.Task[bytes]] = set()
        session.on_change = self._refresh_soon
        token = dialect.node_token()
        self._announcement = self._seat.announce(token) if token else None
        session.tokens(dialect.tokens, self._roster.change)
        self._refresh_soon()

    @property
    def node(self) -> str:
        """Return our node's full name."""
        return self._node

    @property
    def trouble(self) -> str:
        """Return one sentence on what is wrong with the connection itself; empty when nothing is."""
        return self._session.trouble

    @property
    def notes(self) -> tuple[str, ...]:
        """Return why nothing happens where nothing is wrong: nobody is there, nobody subscribes."""
        return tuple(each.sentence for each in self._findings if each.is_note)

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> TopicWriter:
        """Declare a publisher of the resolved name `topic`."""
        return TopicWriter(self._seat, topic, kind, qos)

    def subscribe(self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]) -> TopicReader:
        """Call `handler(cdr)` for what others publish; what we publish ourselves never comes back."""
        return TopicReader(self._seat, topic, kind, qos, handler)

    def serve(self, service: str, kind: RosType, server: Server) -> ServiceDesk:
        """Answer requests to `service`."""
        return ServiceDesk(self._seat, service, kind, server)

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        """Return the CDR of a server's response.

        Raises:
            TimeoutError: nobody serves it, or not within `timeout_s`; or it refuses.
            BusClosedError: the backend was closed meanwhile.
        """
        if self._session.is_closed:
            raise BusClosedError("the backend was closed")
        client = self._clients.get((service, kind))
        if client is None:
            client = self._clients[service, kind] = ServiceClient(self._seat, service, kind)
        call = self._loop.create_task(client.call(request, timeout_s=timeout_s), name=f"call {service}")
        self._calls.add(call)
        try:
            await asyncio.wait([call])
        finally:
            self._calls.discard(call)
            call.cancel()
        if call.cancelled():
            raise BusClosedError("the backend was closed while it waited for an answer")
        return call.result()

    def watch(self, handler: Callable[[Graph], None]) -> Closable:
        """Call `handler` with the graph now, and whenever it has changed."""
        watch = _Watch(handler, self._watchers)
        handler(self._graph)
        return watch

    async def close(self) -> None:
        """Leave the graph; no handler runs afterwards."""
        if self._session.is_closed:
            return
        if self._refreshing is not None:
            self._refreshing.cancel()
        self._watchers.clear()
        for call in self._calls:
            call.cancel()
        self._session.stop()  # so that ends do not undeclare themselves one by one
        for end in tuple(self._seat.ends):
            end.close()
        await self._session.close()
        self._complaints.close()

    def _refresh_soon(self) -> None:
        if self._refreshing is None and not self._session.is_closed:
            self._refreshing = self._loop.call_later(SETTLE_S, self._refresh)

    def _refresh(self) -> None:
        self._refreshing = None
        if self._session.is_closed:
            return
        graph = self._roster.graph()
        self._findings = findings(graph, domain=self._domain, distro=self._distro, needs=self._needs)
        wrong = {each.about: each.sentence for each in self._findings if not each.is_note}
        if self.trouble:
            wrong["router"] = self.trouble
        self._complaints.stand(wrong)
        if graph == self._graph:
            return
        self._graph = graph
        for watch in tuple(self._watchers):
            try:
                watch.handler(graph)
            except Exception:
                log.exception("a handler of the ROS graph failed")


class _Watch:
    """One who wants to know the graph."""

    def __init__(self, handler: Callable[[Graph], None], among: "list[_Watch]") -> None:
        self.handler = handler
        self._among = among
        among.append(self)

    def close(self) -> None:
        """Hear no more."""
        if self in self._among:
            self._among.remove(self)
