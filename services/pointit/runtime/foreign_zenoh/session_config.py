"""Zenoh configuration of a plain session that joins a foreign network."""

from dataclasses import dataclass
from typing import Any, Literal

import zenoh

from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import ENDPOINT
from pointit.runtime.zenoh.session import config_of

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
    """The way to join: connect as a peer or a client, or be the router that others connect to."""

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
        "timestamping/enabled": True,  # without which nothing is kept for readers that come late
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
