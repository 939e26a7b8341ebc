"""Liveliness tokens of rmw_zenoh, by which nodes and their endpoints announce themselves.

    node      @ros2_lv/<domain>/<session>/<node id>/<node id>/NN/<enclave>/<namespace>/<node>
    endpoint  @ros2_lv/<domain>/<session>/<node id>/<id>/<MP|MS|SS|SC>/<enclave>/<namespace>/<node>
              /<name>/<type>/<hash>/<qos>

Names have `%` for `/`. Lyrical and later may add a chunk; further chunks are ignored.

Quality of service as rmw_zenoh writes it into tokens: a field that is the default stays empty.

`<reliability>:<durability>:<history>,<depth>:<deadline s>,<ns>:<lifespan s>,<ns>:<liveliness>,<lease s>,<ns>`
"""

import re
from dataclasses import dataclass

import xxhash

from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType

PRESENCE = "@ros2_lv"
"""First chunk of the tokens of nodes and their endpoints."""

EVERY_TOKEN = f"{PRESENCE}/**"

NAME = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
DDS_TYPE = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_", re.ASCII)
HASH = re.compile(r"\w+", re.ASCII)


def data_key(domain: int, name: str, kind: RosType) -> str:
    """Return the key of topic or service `name` (resolved: `/user1/pointing_ray`) in `domain`.

    Raises:
        ValueError: If `name` is not a resolved ROS name.
    """
    return f"{domain}/{resolved(name)[1:]}/{kind.dds_name}/{kind.hash}"


def resolved(name: str) -> str:
    """Return `name`, of a node, topic or service.

    Raises:
        ValueError: If it is not resolved (`/user1/pointing_ray`); its key would mean something else.
    """
    if not NAME.fullmatch(name):
        raise ValueError(
            f"{name!r} is not a full ROS name: chunks of letters, digits and underscores, each after a slash "
            "and beginning with no digit, such as /user1/pointing_ray"
        )
    return name


def dds_type(text: str, type_hash: str) -> RosType:
    """Return the type that middlewares write as `text` (`std_msgs::msg::dds_::Bool_`).

    Raises:
        ValueError: If it , or the hash, is not written that way.
    """
    found = DDS_TYPE.fullmatch(text)
    if found is None or not HASH.fullmatch(type_hash):
        raise ValueError(f"{text!r} with the hash {type_hash!r} is not a type as DDS writes it")
    return RosType(name="/".join(found.groups()), hash=type_hash)


DEFAULT_DEPTH = 42
"""Default depth of rmw_zenoh. ROS nodes use 10 or 1 instead."""

RELIABLE, BEST_EFFORT = 1, 2
TRANSIENT_LOCAL, VOLATILE = 1, 2
KEEP_LAST, KEEP_ALL = 1, 2

ENDLESS_NS = 2**63 - 1
"""Infinite time in ROS, of which seconds and nanoseconds are omitted separately."""
NS_PER_S = 1_000_000_000


def qos_text(qos: Qos) -> str:
    """Return `qos` exactly as a genuine node writes it, since peers hash the text."""
    reliability = "" if qos.reliable else f"{BEST_EFFORT}"
    durability = f"{TRANSIENT_LOCAL}" if qos.latched else ""
    depth = "" if qos.depth == DEFAULT_DEPTH else f"{qos.depth}"
    return f"{reliability}:{durability}:,{depth}:,:{_time_text(qos.lifespan_ns)}:,,"


def qos_of(text: str) -> Qos:
    """Return reliability, durability, depth and lifespan of `text`; other fields are not used.

    Raises:
        ValueError: If it is not written that way.
    """
    try:
        reliability, durability, history, *rest = text.split(":")
        kept, depth = history.split(",")
        _choice(kept, KEEP_LAST, KEEP_ALL)
        return Qos(
            reliable=_choice(reliability, RELIABLE, BEST_EFFORT) == RELIABLE,
            latched=_choice(durability, VOLATILE, TRANSIENT_LOCAL) == TRANSIENT_LOCAL,
            depth=_natural(depth) if depth else DEFAULT_DEPTH,
            lifespan_ns=_time_ns(rest[1]) if len(rest) > 1 else None,
        )
    except ValueError as error:
        raise ValueError(f"{text!r} is not a quality of service as rmw_zenoh writes it") from error


def _choice(text: str, default: int, other: int) -> int:
    if text in {"", f"{default}"}:
        return default
    if text == f"{other}":
        return other
    raise ValueError(text)


def _time_text(time_ns: int | None) -> str:
    parts = divmod(ENDLESS_NS if time_ns is None else time_ns, NS_PER_S)
    endless = divmod(ENDLESS_NS, NS_PER_S)
    return ",".join(
        "" if part == default else f"{part}" for part, default in zip(parts, endless, strict=True)
    )


def _time_ns(text: str) -> int | None:
    """Return a time, or None if it is infinite."""
    s, ns = text.split(",")
    endless_s, endless_ns = divmod(ENDLESS_NS, NS_PER_S)
    time_ns = (_natural(s) if s else endless_s) * NS_PER_S + (_natural(ns) if ns else endless_ns)
    return None if time_ns == ENDLESS_NS else time_ns


def _natural(text: str) -> int:
    """Return the number written in plain digits; `int` alone would accept signs, blanks and underscores."""
    if not (text.isascii() and text.isdigit()) or len(text) > 18:
        raise ValueError(text)
    return int(text)


NODE = "NN"
CODES: dict[EndpointKind, str] = {"publisher": "MP", "subscriber": "MS", "server": "SS", "client": "SC"}
KINDS: dict[str, EndpointKind] = {code: kind for kind, code in CODES.items()}

ENCLAVE = "/"
"""Enclave of nodes that do not run under SROS 2."""
BRIDGE = "/pointit/bridge"
"""Enclave of PointIt bridges, by which they recognize each other whatever their nodes' names."""

NODE_CHUNKS, ENDPOINT_CHUNKS = 9, 13

MAX_CHARACTERS = 4096
"""Maximum length, far above that of the longest names in ROS."""

DIGITS = re.compile(r"[0-9]{1,18}", re.ASCII)
SESSION = re.compile(r"[0-9a-f]{1,32}")


@dataclass(frozen=True, kw_only=True)
class NodeToken:
    """Token of a node."""

    domain: int
    session: str
    """Zenoh's id of it: up to 32 hexadecimal digits."""
    node_id: str
    """Number of the entity in its session; rmw_zenoh counts nodes and endpoints alike."""
    node: str
    """Its full name: `/user1/belt`."""
    enclave: str = ENCLAVE

    @property
    def text(self) -> str:
        """Return the token.

        Raises:
            ValueError: If the name is no full ROS name.
        """
        return self._chunks(self.node_id, NODE)

    def _chunks(self, entity_id: str, code: str) -> str:
        namespace, _, name = resolved(self.node).rpartition("/")
        ids = f"{PRESENCE}/{self.domain}/{self.session}/{self.node_id}/{entity_id}"
        return f"{ids}/{code}/{mangled(self.enclave)}/{mangled(namespace)}/{name}"


@dataclass(frozen=True, kw_only=True)
class EndpointToken(NodeToken):
    """Token of an endpoint."""

    endpoint_id: str
    kind: EndpointKind
    name: str
    """Name of the topic or service, resolved."""
    type: RosType
    qos: Qos

    @property
    def text(self) -> str:
        """Return the token.

        Raises:
            ValueError: If a name is no full ROS name.
        """
        node = self._chunks(self.endpoint_id, CODES[self.kind])
        name = mangled(resolved(self.name))
        return f"{node}/{name}/{self.type.dds_name}/{self.type.hash}/{qos_text(self.qos)}"

    @property
    def gid(self) -> bytes:
        """Return the endpoint's 16 bytes, which peers compute from the token."""
        return gid(self.text)


def parsed(text: str) -> NodeToken | EndpointToken:
    """Return a parsed foreign token; chunks after the thirteenth are ignored.

    The text of the result may differ from `text`: hash `text` for the gid of a foreign endpoint.

    Raises:
        ValueError: If it is no such token.
    """
    chunks = text.split("/", ENDPOINT_CHUNKS) if len(text) <= MAX_CHARACTERS else []
    if len(chunks) < NODE_CHUNKS or chunks[0] != PRESENCE or not all(chunks):
        raise ValueError(f"{text[:100]!r} is not a token of a ROS node")
    _, domain, session, node_id, entity_id, code, enclave, namespace, name = chunks[:NODE_CHUNKS]
    if not SESSION.fullmatch(session) or not DIGITS.fullmatch(domain):
        raise ValueError(f"{text[:100]!r} has a domain or session that is none")
    node = resolved(f"{unmangled(namespace).rstrip('/')}/{name}")
    own = NodeToken(
        domain=int(domain), session=session, node_id=node_id, node=node, enclave=unmangled(enclave)
    )
    if code == NODE:
        return own
    if code not in KINDS or len(chunks) < ENDPOINT_CHUNKS:
        raise ValueError(f"{text[:100]!r} is neither of a node nor of an endpoint")
    topic, dds_name, type_hash, qos = chunks[NODE_CHUNKS:ENDPOINT_CHUNKS]
    return EndpointToken(
        **vars(own),
        endpoint_id=entity_id,
        kind=KINDS[code],
        name=resolved(unmangled(topic)),
        type=dds_type(dds_name, type_hash),
        qos=qos_of(qos),
    )


def mangled(name: str) -> str:
    """Return a name as one chunk; the root is `%`."""
    return name.replace("/", "%") or "%"


def unmangled(chunk: str) -> str:
    """Return the name in a chunk."""
    return chunk.replace("%", "/")


def gid(token: str) -> bytes:
    """Return the 16 bytes that identify the endpoint with this token: its XXH3, little endian."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")
