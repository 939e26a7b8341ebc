"""The wire of rmw_zenoh: keys, liveliness tokens, attachments, and the graph that tokens tell.

    node      @ros2_lv/<domain>/<session>/<node id>/<node id>/NN/<enclave>/<namespace>/<node>
    endpoint  @ros2_lv/<domain>/<session>/<node id>/<id>/<MP|MS|SS|SC>/<enclave>/<namespace>/<node>
              /<name>/<type>/<hash>/<qos>

Names have `%` for `/`. Lyrical and later may add a chunk; further chunks are ignored.

Quality of service as rmw_zenoh writes it into tokens: a field that is the default stays empty.

`<reliability>:<durability>:<history>,<depth>:<deadline s>,<ns>:<lifespan s>,<ns>:<liveliness>,<lease s>,<ns>`
"""

import itertools
import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import xxhash

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph, Qos, RosType

GID_BYTES = 16

_FORMAT = struct.Struct("<qqB16s")


@dataclass(frozen=True, kw_only=True, slots=True)
class Attachment:
    """Origin of a message: endpoint, time and number."""

    sequence: int
    """1 for an endpoint's first message, and so on; with `gid` it identifies a request."""
    stamp_ns: int
    """Time of sending, by the system clock."""
    gid: bytes
    """The 16 bytes of the endpoint's token. A reply has those of the request."""


def packed(attachment: Attachment) -> bytes:
    """Return its 33 bytes."""
    return _FORMAT.pack(attachment.sequence, attachment.stamp_ns, GID_BYTES, attachment.gid)


def unpacked(data: bytes | None) -> Attachment:
    """Return the attachment in `data`, which may be foreign.

    Raises:
        ValueError: If it is none: not 33 bytes with a matching length field.
    """
    if data is None:
        raise ValueError("they have no attachment, so no node of rmw_zenoh has sent them")
    if len(data) != _FORMAT.size:
        raise ValueError(
            f"an attachment of {len(data)} bytes, rmw_zenoh's has {_FORMAT.size}: update ros-*-rmw-zenoh-cpp "
            "there"
        )
    sequence, stamp_ns, length, sender = _FORMAT.unpack(data)
    if length != GID_BYTES:
        raise ValueError(f"an attachment with a gid of {length} bytes, rmw_zenoh's has {GID_BYTES}")
    return Attachment(sequence=sequence, stamp_ns=stamp_ns, gid=sender)


PRESENCE = "@ros2_lv"
"""First chunk of the tokens of nodes and their endpoints."""

EVERY_TOKEN = f"{PRESENCE}/**"

NAME = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
DDS_TYPE = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_", re.ASCII)
HASH = re.compile(r"\w+", re.ASCII)


def data_key(domain: int, name: str, kind: RosType) -> str:
    """Return the key of topic or service `name` (resolved: `/user1/pointing_ray`) in `domain`."""
    return f"{domain}/{name[1:]}/{kind.dds_name}/{kind.hash}"


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
        """Return the token."""
        return self._chunks(self.node_id, NODE)

    def _chunks(self, entity_id: str, code: str) -> str:
        namespace, _, name = self.node.rpartition("/")
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
        """Return the token."""
        node = self._chunks(self.endpoint_id, CODES[self.kind])
        name = mangled(self.name)
        return f"{node}/{name}/{self.type.dds_name}/{self.type.hash}/{qos_text(self.qos)}"


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


MAX_TOKENS = 20_000
"""Maximum number of stored foreign tokens; further ones are ignored."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Content of a token: a node, or one of its endpoints with `endpoint`."""

    node: str
    domain: int
    endpoint: Endpoint | None = None
    bridge_gid: bytes | None = None
    """Gid in messages of this endpoint if it is another PointIt's."""


class LivelinessDirectory:
    """The tokens that are alive."""

    def __init__(self, read: Callable[[str], Seen], domain: int, on_change: Callable[[], None]) -> None:
        """Create an empty graph.

        Args:
            read: parses a token; raises `ValueError` if it cannot.
            domain: our ROS_DOMAIN_ID.
            on_change: called when the graph has changed.
        """
        self._read = read
        self._on_change = on_change
        self._domain = domain
        self._seen: dict[str, Seen] = {}
        self._own: set[str] = set()
        self.bridged: set[bytes] = set()
        """Gids in messages of other PointIts, of any domain."""

    def announce(self, token: str) -> None:
        """Add a token of ours. It stays even if others report its end, as lost routers do."""
        self._own.add(token)
        self.change({token: True})

    def retract(self, token: str) -> None:
        """Remove a token of ours."""
        self._own.discard(token)
        self.change({token: False})

    def change(self, tokens: Mapping[str, bool]) -> None:
        """Add tokens (True) or remove them (False)."""
        changed = False
        for token, present in tokens.items():
            if not present and token in self._own:
                continue
            if not present:
                gone = self._seen.pop(token, None)
                if gone is not None:
                    changed = True
                    self.bridged -= {gone.bridge_gid}
            elif token not in self._seen and len(self._seen) < MAX_TOKENS:
                try:
                    seen = self._seen[token] = self._read(token)
                except ValueError:
                    continue
                changed = True
                if seen.bridge_gid is not None:
                    self.bridged.add(seen.bridge_gid)
        if changed:
            self._on_change()

    def graph(self) -> Graph:
        """Return the graph: the nodes of our domain, the endpoints of every domain."""
        return Graph(
            nodes=frozenset(seen.node for seen in self._seen.values() if seen.domain == self._domain),
            endpoints=frozenset(seen.endpoint for seen in self._seen.values() if seen.endpoint is not None),
        )


class RmwZenoh:
    """Encoder and decoder for one session of ours with one node; numbers its entities."""

    def __init__(self, *, session: str, node: str, domain: int, enclave: str = ENCLAVE) -> None:
        """Create the context with the node.

        Args:
            session: Zenoh's id of the session.
            node: our node's full name.
            domain: ROS_DOMAIN_ID.
            enclave: enclave of our node. `BRIDGE` for one that other bridges recognise.

        Raises:
            ValueError: If `node` is no full ROS name.
        """
        self._domain = domain
        self._ids = itertools.count()
        self._own = NodeToken(
            domain=domain, session=session, node_id=str(next(self._ids)), node=node, enclave=enclave
        )

    def key(self, name: str, kind: RosType) -> str:
        """Return the key of `name`; other type hashes have other keys."""
        return data_key(self._domain, name, kind)

    def node_token(self) -> str:
        """Return our node's token."""
        return self._own.text

    def endpoint_token(self, kind: EndpointKind, name: str, of: RosType, qos: Qos) -> str:
        """Return the token of a new endpoint: 13 chunks, so Lyrical sends it whole messages, not buffers."""
        endpoint_id = str(next(self._ids))
        return EndpointToken(
            **vars(self._own), endpoint_id=endpoint_id, kind=kind, name=name, type=of, qos=qos
        ).text

    def read(self, token: str) -> Seen:
        """Return the content of a foreign token.

        Raises:
            ValueError: If it is none.
        """
        found = parsed(token)
        if not isinstance(found, EndpointToken):
            return Seen(node=found.node, domain=found.domain)
        is_ours = found.session == self._own.session
        is_bridge = self._own.enclave == found.enclave == BRIDGE and not is_ours
        endpoint = Endpoint(
            kind=found.kind,
            node=found.node,
            name=found.name,
            type=found.type,
            qos=found.qos,
            domain=found.domain,
            is_ours=is_ours,
            is_bridge=is_bridge,
        )
        origin = gid(token) if is_bridge else None
        return Seen(node=found.node, domain=found.domain, endpoint=endpoint, bridge_gid=origin)
