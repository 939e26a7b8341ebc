"""ROS as the bridge `zenoh-bridge-ros2dds` writes it on Zenoh, for robots on DDS behind one.

Unverified: written from the format's description, and never run against the real bridge.
"""

import hashlib
import itertools
import re

from pointit.bridges.ros2.backend import Endpoint, EndpointKind, Qos, RosType
from pointit.bridges.ros2.findings import Matching
from pointit.bridges.ros2.over_zenoh.attachment import Attachment
from pointit.bridges.ros2.over_zenoh.graph import Seen
from pointit.bridges.ros2.over_zenoh.keys import resolved

PATTERN = "@/*/@ros2_lv/**"

CODES: dict[str, EndpointKind] = {"MP": "publisher", "MS": "subscriber", "SS": "server", "SC": "client"}
KINDS = {kind: code for code, kind in CODES.items()}

SLASH = "§"
PLAIN = re.compile(r"\w{1,255}", re.ASCII)
"""Ids of sessions, parts of a type's name, hashes: what sentences tell of is shown on terminals."""

MAX_CHARACTERS = 4096
TOPIC_CHUNKS, SERVICE_CHUNKS = 7, 6


class Ros2Dds:
    """What one session of ours writes and reads: no domain, no hash in keys, no attachments, no nodes."""

    tokens = PATTERN
    matching: Matching = "topic"

    def __init__(self, *, session: str, node: str, domain: int) -> None:
        """Begin.

        Args:
            session: Zenoh's id of it.
            node: our node's full name; others do not see it.
            domain: what to say of everybody: bridges keep theirs to themselves.
        """
        self._session = session
        self._node = resolved(node)
        self._domain = domain
        self._ends = itertools.count()

    def key(self, name: str, kind: RosType) -> str:  # noqa: ARG002 - the format has no type in it
        """Return where `name` is exchanged."""
        return resolved(name)[1:]

    def strays(self, topic: str) -> str:  # noqa: ARG002 - there is only one place
        """Return nothing: a topic's name alone is its key."""
        return ""

    def astray(self, key: str, topic: str, kind: RosType) -> str:  # noqa: ARG002 - as above
        """Return nothing, as nothing goes astray."""
        return ""

    def node_token(self) -> str:
        """Return nothing: bridges do not tell of nodes."""
        return ""

    def endpoint_token(self, kind: EndpointKind, name: str, of: RosType, qos: Qos) -> str:
        """Return the token of an endpoint; a second one of the same kind and name has the same."""
        chunks = ["@", self._session, "@ros2_lv", KINDS[kind], _joined(resolved(name)[1:]), _joined(of.name)]
        if kind in ("publisher", "subscriber"):
            chunks.append(_qos_text(qos, of.hash))
        return "/".join(chunks)

    def read(self, token: str) -> Seen:
        """Return what a token of anybody says; raises `ValueError` when it is none."""
        chunks = token.split("/") if len(token) <= MAX_CHARACTERS else []
        if len(chunks) not in (TOPIC_CHUNKS, SERVICE_CHUNKS) or chunks[3] not in CODES:
            raise ValueError(f"{token[:100]!r} is not a token of a bridge to DDS")
        kind, kind_of_type = CODES[chunks[3]], chunks[5].split(SLASH)
        is_topic = kind in ("publisher", "subscriber")
        if (
            is_topic != (len(chunks) == TOPIC_CHUNKS)
            or len(kind_of_type) != 3
            or not all(map(PLAIN.fullmatch, (chunks[1], *kind_of_type)))
        ):
            raise ValueError(f"{token[:100]!r} is neither of a topic nor of a service")
        qos, type_hash = _qos_of(chunks[6]) if is_topic else (None, "")
        if type_hash and not PLAIN.fullmatch(type_hash):
            raise ValueError(f"{token[:100]!r} has a hash that is none")
        endpoint = Endpoint(
            kind=kind,
            node=f"behind bridge {chunks[1][:32]}",
            name=resolved("/" + chunks[4].replace(SLASH, "/")),
            type=RosType(name="/".join(kind_of_type), hash=type_hash),
            qos=qos,
            domain=self._domain,
            is_ours=chunks[1] == self._session,
        )
        return Seen(node=endpoint.node, domain=self._domain, endpoint=endpoint)

    def gid(self, token: str) -> bytes:
        """Return 16 bytes that name an endpoint of ours; they are never sent."""
        return hashlib.blake2b(f"{next(self._ends)} {token}".encode(), digest_size=16).digest()

    def pack(self, origin: Attachment) -> bytes | None:  # noqa: ARG002 - the format has no attachment
        """Return none."""
        return None

    def unpack(self, attachment: bytes | None) -> Attachment | None:  # noqa: ARG002 - read over, as above
        """Return none: who has sent something is not told; what bridges attach to requests is read over."""
        return None


def _joined(name: str) -> str:
    return name.replace("/", SLASH)


def _qos_text(qos: Qos, type_hash: str) -> str:
    """Return a QoS in the numbers of Cyclone DDS, and the type's hash behind it where there is one."""
    hashed = f":typehash={type_hash};" if type_hash.startswith("RIHS01_") else ""
    return f":{int(qos.reliable)}:{int(qos.latched)}:0,{qos.depth}{hashed}"


def _qos_of(text: str) -> tuple[Qos, str]:
    """Return a QoS and the type's hash, empty where it is not told; raises `ValueError`."""
    _, reliability, durability, history, *rest = [*text.split(":"), "", "", ""]
    digits = (reliability or "0", durability or "0", history.partition(",")[2] or "1")
    if not all(each.isascii() and each.isdigit() and len(each) <= 18 for each in digits):
        raise ValueError(f"{text[:100]!r} is not a quality of service as the bridge to DDS writes it")
    type_hash = "".join(each for each in rest if each.startswith("typehash="))
    return (
        Qos(reliable=digits[0] == "1", latched=digits[1] == "1", depth=int(digits[2])),
        type_hash.removeprefix("typehash=").partition(";")[0],
    )
