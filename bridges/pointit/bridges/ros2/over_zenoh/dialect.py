"""How ROS is written on Zenoh: keys, tokens and attachments; `rmw_zenoh.py` and `ros2dds.py` are two ways."""

from typing import Protocol

from pointit.bridges.ros2.backend import EndpointKind, Qos, RosType
from pointit.bridges.ros2.findings import Matching
from pointit.bridges.ros2.over_zenoh.attachment import Attachment
from pointit.bridges.ros2.over_zenoh.graph import Seen


class Dialect(Protocol):
    """One way to write ROS on Zenoh; pure."""

    @property
    def tokens(self) -> str:
        """Return the pattern of everybody's tokens, of every domain."""
        ...

    @property
    def matching(self) -> Matching:
        """Return what two ends must have in common."""
        ...

    def key(self, name: str, kind: RosType) -> str:
        """Return where messages or requests of the resolved `name` are exchanged."""
        ...

    def strays(self, topic: str) -> str:
        """Return the pattern of keys where messages of `topic` may go astray; empty where there are none."""
        ...

    def astray(self, key: str, topic: str, kind: RosType) -> str:
        """Return what is wrong with messages of `topic` at `key`, and what to do; empty when nothing is."""
        ...

    def node_token(self) -> str:
        """Return our node's token; empty where nodes have none."""
        ...

    def endpoint_token(self, kind: EndpointKind, name: str, of: RosType, qos: Qos) -> str:
        """Return the token of a new endpoint of ours; no two are the same."""
        ...

    def read(self, token: str) -> Seen:
        """Return what a token of anybody says.

        Raises:
            ValueError: it is none.
        """
        ...

    def gid(self, token: str) -> bytes:
        """Return the 16 bytes that name the endpoint with this token."""
        ...

    def pack(self, origin: Attachment) -> bytes | None:
        """Return the attachment of a message, request or response; none where there are none."""
        ...

    def unpack(self, attachment: bytes | None) -> Attachment | None:
        """Return what somebody's attachment says; none where there are none.

        Raises:
            ValueError: it is none; its text says what it is, and what to do.
        """
        ...
