"""Context shared by the endpoints of one backend on Zenoh."""

from collections.abc import Callable

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType
from pointit.bridges.ros2.graph.node_backend import NodeContext
from pointit.bridges.ros2.over_zenoh.attachment import Attachment
from pointit.bridges.ros2.over_zenoh.graph import LivelinessDirectory
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from pointit.bridges.ros2.over_zenoh.token import gid
from pointit.runtime.foreign_zenoh.raw_session import RawSession
from pointit.runtime.service.surroundings import WarningSink


class EndpointContext(NodeContext):
    """The session, the encoding of ROS in it, and the ids of our own endpoints."""

    def __init__(
        self,
        config: BackendConfig,
        warnings: WarningSink,
        *,
        session: RawSession,
        rmw: RmwZenoh,
        directory: LivelinessDirectory,
        now_ns: Callable[[], int],
    ) -> None:
        """`directory`: nodes and endpoints, ours included; `now_ns`: clock for attachments."""
        super().__init__(config, warnings, session.dispatcher)
        self.session = session
        self.rmw = rmw
        self.directory = directory
        self.now_ns = now_ns
        self.gids: set[bytes] = set()
        """Ids of our endpoints: messages with them are our own."""

    def is_own_gid(self, gid: bytes) -> bool:
        """Return True if messages with `gid` are to be ignored: they are ours or of another PointIt."""
        return gid in self.gids or gid in self.directory.bridged

    def announce(self, kind: EndpointKind, name: str, of: RosType, qos: Qos) -> "Announcement":
        """Declare a token of a new endpoint in the graph until the result is closed."""
        return Announcement(self, self.rmw.endpoint_token(kind, name, of, qos))


class Announcement:
    """A token of ours; numbers the messages of its endpoint."""

    def __init__(self, context: EndpointContext, token: str) -> None:
        self._context = context
        self._text = token
        self._gid = gid(token)
        self._sequence = 0
        context.gids.add(self._gid)
        self._token = context.session.token(token)
        context.directory.announce(token)

    def next(self) -> Attachment:
        """Return the attachment of the next message."""
        self._sequence += 1
        return Attachment(sequence=self._sequence, stamp_ns=self._context.now_ns(), gid=self._gid)

    def close(self) -> None:
        """Remove it from the graph."""
        self._token.close()
        self._context.directory.retract(self._text)
        self._context.gids.discard(self._gid)
