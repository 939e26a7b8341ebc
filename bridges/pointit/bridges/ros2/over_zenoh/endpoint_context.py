"""Context shared by the endpoints of one backend on Zenoh."""

from collections.abc import Callable
from dataclasses import dataclass, field

from pointit.bridges.ros2.graph.backend import Closable
from pointit.bridges.ros2.graph.backend_warnings import BackendWarnings
from pointit.bridges.ros2.over_zenoh.attachment import Attachment
from pointit.bridges.ros2.over_zenoh.graph import LivelinessDirectory
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from pointit.runtime.foreign_zenoh.raw_session import RawSession


@dataclass(eq=False)
class EndpointContext:
    """The session, the encoding of ROS in it, and the ids of our own endpoints."""

    session: RawSession
    rmw: RmwZenoh
    warnings: BackendWarnings
    directory: LivelinessDirectory
    """Nodes and endpoints, ours included."""
    now_ns: Callable[[], int]
    """Clock for attachments."""
    max_bytes: int
    """Maximum size of foreign messages; longer ones are dropped unread."""
    gids: set[bytes] = field(default_factory=set[bytes])
    """Ids of our publishers and clients: messages with them are our own."""
    ends: set[Closable] = field(default_factory=set[Closable])
    """Declared endpoints, kept alive here: a token is gone with its last reference."""

    def is_own_gid(self, gid: bytes) -> bool:
        """Return True if messages with `gid` are to be ignored: they are ours or of another PointIt."""
        return gid in self.gids or gid in self.directory.bridged

    def announce(self, token: str) -> "Announcement":
        """Keep `token` in the graph until the result is closed."""
        return Announcement(self, token)


class Announcement:
    """A token of ours."""

    def __init__(self, context: EndpointContext, token: str) -> None:
        self._context = context
        self._text = token
        self._token: Closable | None = context.session.token(token)
        context.directory.announce(token)

    def close(self) -> None:
        """Remove it from the graph."""
        token, self._token = self._token, None
        if token is not None:
            token.close()
            self._context.directory.retract(self._text)


class SequenceCounter:
    """Numbers the messages of an endpoint of ours."""

    def __init__(self, context: EndpointContext, token: str) -> None:
        self._context = context
        self._gid = context.rmw.gid(token)
        self._seq = 0
        context.gids.add(self._gid)

    def next(self) -> Attachment:
        """Return the attachment of the next message."""
        self._seq += 1
        return Attachment(sequence=self._seq, stamp_ns=self._context.now_ns(), gid=self._gid)

    def close(self) -> None:
        """Send no more."""
        self._context.gids.discard(self._gid)
