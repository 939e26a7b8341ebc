"""A session on a foreign Zenoh network, with keys unchanged, raw bytes and attachments.

Samples arrive on Zenoh's threads, all else in the loop that opened the session. No call in the loop waits for
a reader elsewhere.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import zenoh

from pointit.runtime.bus.contract import Closable, Declaration
from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.runtime.errors import BusClosedError, BusError, ConfigError, ConnectError, ListenError
from pointit.runtime.foreign_zenoh.pubsub import RawPublisher, RawSample
from pointit.runtime.foreign_zenoh.queries import IncomingQuery, RawQuerier, RawQueryable
from pointit.runtime.link.link import ENDPOINT
from pointit.runtime.zenoh.connections import Connections
from pointit.runtime.zenoh.declarations import declare_caching_subscriber, declare_subscriber
from pointit.runtime.zenoh.liveliness import LivelinessSubscriber
from pointit.runtime.zenoh.session import close_session, config_of, is_in_use
from pointit.runtime.zenoh.session import open_first as open_session

log = logging.getLogger(__name__)


Mode = Literal["peer", "client", "router"]
CONNECT_TIMEOUT_MS = 1000
"""Duration of one attempt at most. Closing a session waits for the current attempt."""
SCOUTING_DELAY_MS = 500
"""Time that a peer waits for other peers when it opens."""
QUERY_TIMEOUT_MS = 600_000
"""Lifetime of forwarded queries. Our own have deadlines of their own."""
SEND_BATCHES = 16
"""Batches of 64 KB that wait for a slower link before messages are dropped."""
MAX_MESSAGE_BYTES = 16 * 1024 * 1024
"""Size limit of reassembled messages, unless we route for others."""


@dataclass(frozen=True, kw_only=True)
class RawLink:
    """Role in the network: a peer, a client, or the router that others connect to."""

    endpoint: str
    """Address to connect to, or of a router: to listen on."""
    mode: Mode = "peer"
    remedy: str = ""
    """Advice if nothing answers there, for people."""


def plain_configuration(link: RawLink) -> zenoh.Config:
    """Return Zenoh's configuration for `link`.

    Raises:
        ConfigError: the endpoint is not one.
    """
    if not ENDPOINT.fullmatch(link.endpoint):
        raise ConfigError(f"{link.endpoint!r} is no address; write one like tcp/127.0.0.1:7447")
    is_router = link.mode == "router"
    settings: dict[str, Any] = {
        "mode": link.mode,
        "connect/endpoints": [] if is_router else [link.endpoint],
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        # Peers announce themselves only to the router. Of two peers one connects to the other.
        "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
        "scouting/gossip/autoconnect": {"router": [], "peer": ["router", "peer"]},
        "scouting/gossip/autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
        "timestamping/enabled": True,  # otherwise no messages are cached for late readers
        "queries_default_timeout": QUERY_TIMEOUT_MS,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": CONNECT_TIMEOUT_MS,
        # a peer that does not read makes us drop, not wait
        "transport/link/tx/queue/congestion_control/drop": {
            "wait_before_drop": 0,
            "max_wait_before_drop_fragments": 0,
        },
        "transport/link/tx/queue/size/data": SEND_BATCHES,
    }
    if is_router:
        settings |= {"listen/endpoints": [link.endpoint], "scouting/delay": 0}
    else:
        settings["transport/link/rx/max_message_size"] = MAX_MESSAGE_BYTES
    if link.mode == "peer":
        settings |= {
            "listen/endpoints": ["tcp/127.0.0.1:0"],
            "connect/timeout_ms": -1,  # with the next line: opens at once, and goes on trying
            "connect/exit_on_failure": False,
            "scouting/delay": SCOUTING_DELAY_MS,
        }
    elif link.mode == "client":
        settings |= {"connect/timeout_ms": CONNECT_TIMEOUT_MS, "listen/endpoints": []}
    return config_of(settings)


async def open_raw_session(
    link: RawLink, *, patience_s: float | None = None, on_wait: Callable[[str], None] = log.warning
) -> "RawSession":
    """Return an open session; may be cancelled at any time.

    A peer opens within a second, with or without others. A client is retried for `patience_s`, or without
    end. In the latter case `on_wait` is called once, with a sentence.

    Raises:
        ConfigError: If the endpoint is invalid.
        ListenError: If the router's address is in use.
        ConnectError: If nothing answered the client within `patience_s`.
    """
    sentence = f"nobody answers at {link.endpoint}{link.remedy and f': {link.remedy}'}"

    async def problem_of(error: zenoh.ZError) -> BusError:
        if link.mode == "client":
            return ConnectError(sentence)
        taken = "a router is running there already: join it as a peer, or " if is_in_use(error) else ""
        return ListenError(f"cannot listen on {link.endpoint}; {taken}choose another address")

    session = await open_session(
        [plain_configuration(link)],
        (link.endpoint,),
        problem_of,
        patience_s=patience_s,
        on_wait=lambda: on_wait(f"{sentence}; trying again until somebody does"),
    )
    return RawSession(session, link)


class RawSession:
    """Our declarations on that network. Closing it undeclares all."""

    def __init__(self, session: zenoh.Session, link: RawLink) -> None:
        """Use `session`, which is closed with this; `open_raw_session` is the usual way in."""
        self.zid = str(session.info.zid())
        self.dispatcher = Dispatcher()
        """Wakes the loop; closed with this session."""
        self.on_change: Callable[[], None] | None = None
        """Called when `problem` has changed."""
        self._session = session
        self._link = link
        self._connections = Connections(session, (link.endpoint,), self._on_connections)
        self._had_router = False
        self._was_left = False
        self._problem = self.problem

    @property
    def problem(self) -> str:
        """Return a message if a required connection is missing, else `""`."""
        link = self._link
        if link.mode == "router" or any(self._connections.routers.values()):
            return ""
        remedy = link.remedy and f": {link.remedy}"
        if self._had_router:
            return f"the router at {link.endpoint} is lost, trying again until it is back{remedy}"
        if self._connections:
            return (
                f"who answers at {link.endpoint} is no router and passes nothing on; if it is a "
                f"`pointit run`, let that --listen elsewhere{remedy}"
            )
        return f"no router answers at {link.endpoint}, trying again until one does{remedy}"

    def publisher(self, key: str, *, cache_size: int = 0, reliable: bool = True) -> RawPublisher:
        """Declare a writer of `key`, which keeps its last `cache_size` messages for late readers."""
        self._check_open()
        return RawPublisher(self._session, key, cache_size, reliable)

    def subscriber(
        self, key: str, handler: Callable[[RawSample], None], *, cache_size: int = 0, reliable: bool = True
    ) -> Closable:
        """Call `handler` on Zenoh's threads for samples of others on `key`, which may have wildcards.

        `cache_size`: number of a writer's last messages to fetch from caches. `reliable`: fetch those lost on
        the way, too.
        """
        self._check_open()

        def on_sample(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                handler(RawSample(sample))

        if not cache_size:
            return Declaration(declare_subscriber(self._session, key, on_sample).undeclare)
        declared = declare_caching_subscriber(
            self._session, key, on_sample, history=cache_size, recovers=reliable, is_announced=True
        )
        return Declaration(declared.undeclare)

    def token(self, key: str) -> Closable:
        """Declare the token `key` until closed, or until this process dies."""
        self._check_open()
        token: Any = self._session.liveliness().declare_token(key)
        return Declaration(token.undeclare)

    def watch_tokens(self, pattern: str, handler: Callable[[Mapping[str, bool]], None]) -> Closable:
        """Call `handler` with added (True) and removed (False) tokens of `pattern`, now and on changes."""
        self._check_open()
        return LivelinessSubscriber(self._session, pattern, handler, self.dispatcher)

    def queryable(self, key: str, handler: Callable[[IncomingQuery], None], *, max_bytes: int) -> Closable:
        """Call `handler` in the loop for every question to `key`; it must answer each, once."""
        self._check_open()
        return RawQueryable(self._session, key, self.dispatcher, handler, max_bytes)

    def querier(self, key: str, *, max_bytes: int) -> RawQuerier:
        """Declare a querier at `key`. Answers longer than `max_bytes` are dropped unread."""
        self._check_open()
        return RawQuerier(self._session, key, self.dispatcher, max_bytes)

    def stop(self) -> None:
        """Stop running handlers and reject declarations: the first half of `close`."""
        self.dispatcher.close()

    async def close(self) -> None:
        """Close. No handler runs afterwards, and all declarations are removed."""
        self.stop()
        if not self._was_left:
            self._was_left = True
            await close_session(self._session)

    def _check_open(self) -> None:
        if self.dispatcher.is_closed:
            raise BusClosedError("the session was closed")

    def _on_connections(self) -> None:
        if self.dispatcher.is_closed:
            return
        self._had_router |= any(self._connections.routers.values())
        before, self._problem = self._problem, self.problem
        if self._problem != before and self.on_change is not None:
            self.on_change()
