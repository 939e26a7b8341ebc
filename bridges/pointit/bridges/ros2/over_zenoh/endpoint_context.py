"""What the ends of one backend on Zenoh share."""

from collections.abc import Callable

from pointit.bridges.ros2.graph.backend import Closable
from pointit.bridges.ros2.graph.backend_warnings import BackendWarnings
from pointit.bridges.ros2.over_zenoh.attachment import Attachment
from pointit.bridges.ros2.over_zenoh.graph import LivelinessDirectory
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from pointit.runtime.foreign_zenoh.raw_session import RawSession


class EndpointContext:
    """The session, how ROS is written in it, and whose messages are our own."""

    def __init__(
        self,
        session: RawSession,
        dialect: RmwZenoh,
        complaints: BackendWarnings,
        roster: LivelinessDirectory,
        *,
        now_ns: Callable[[], int],
        max_bytes: int,
    ) -> None:
        """Share these.

        Args:
            session: ours alone.
            dialect: how ROS is written in it.
            complaints: where foreign bytes are complained about.
            roster: who is there, ourselves included.
            now_ns: what the time is, for attachments.
            max_bytes: of foreign messages; longer ones are dropped unread.
        """
        self.session = session
        self.dialect = dialect
        self.complaints = complaints
        self.roster = roster
        self.now_ns = now_ns
        self.max_bytes = max_bytes
        self.gids: set[bytes] = set()
        """Of the writers and clients we have: what carries one is our own."""
        self.ends: set[Closable] = set()
        """What is declared, whoever else refers to it: a token is gone with its last reference."""

    def is_own_gid(self, gid: bytes) -> bool:
        """Return True if nobody here is to hear what carries `gid`: we have said it, or another PointIt."""
        return gid in self.gids or gid in self.roster.bridged

    def announce(self, token: str) -> "Announcement":
        """Be in the graph with `token` until it is closed."""
        return Announcement(self, token)


class Announcement:
    """A token of ours."""

    def __init__(self, seat: EndpointContext, token: str) -> None:
        self._seat = seat
        self._text = token
        self._token: Closable | None = seat.session.token(token)
        seat.roster.announce(token)

    def close(self) -> None:
        """Be gone."""
        token, self._token = self._token, None
        if token is not None:
            token.close()
            self._seat.roster.retract(self._text)


class SequenceCounter:
    """Numbers what one end of ours sends."""

    def __init__(self, seat: EndpointContext, token: str) -> None:
        self._seat = seat
        self._gid = seat.dialect.gid(token)
        self._seq = 0
        seat.gids.add(self._gid)

    def next(self) -> Attachment:
        """Return where the next message comes from."""
        self._seq += 1
        return Attachment(sequence=self._seq, stamp_ns=self._seat.now_ns(), gid=self._gid)

    def close(self) -> None:
        """Send no more."""
        self._seat.gids.discard(self._gid)
