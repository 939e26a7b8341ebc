"""Connection of a process to the network: site, addresses, credentials and lease. Loads no Zenoh."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pointit.runtime.errors import ConfigError
from pointit.runtime.link.credentials import Credentials

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""The address where `pointit run` listens and every other command connects, on this machine only."""
DEFAULT_SITE = "lab"

MAX_PORT = 65535
ENDPOINT = re.compile(
    r"(tcp|udp|tls|quic|ws)/(\[[\w:.%]+\]|[^/:\s]+):(?P<port>\d{1,5})([?#]\S*)?|(serial|unixsock-stream|unixpipe|vsock)/\S+"
)
"""Addresses that Zenoh accepts: host and port, or those of other protocols (`serial//dev/ttyUSB0`)."""
ROUTER_LOST = "router at {where} lost {ago_s:.0f} s ago; trying again"
"""Sentence in the health of every service of a process that has lost its router."""
LEASE_MS = 3000
"""A peer that is silent this long is taken for gone: a stopped process is noticed within 5 s."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """Connection of a process: it listens and relays for its clients, or connects, or neither."""

    site: str = DEFAULT_SITE
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    router: bool = False
    """Route for everybody, without being a member of the site."""
    credentials: Credentials | None = None
    """Proof of identity for a router that requires it."""

    @property
    def addresses(self) -> tuple[str, ...]:
        """Return the addresses to listen on, or if there are none, to connect to."""
        return self.listen or self.connect


def check_addresses(link: Link) -> None:
    """Check the addresses of `link`, and that its credentials allow them.

    Raises:
        ConfigError: If one is no address, or does not fit the credentials.
    """
    for endpoint in (*link.listen, *link.connect):
        found = ENDPOINT.fullmatch(endpoint)
        if not found:
            raise ConfigError(f"{endpoint!r} is no address; write one like {DEFAULT_ENDPOINT}")
        if found["port"] and not (endpoint in link.connect) <= int(found["port"]) <= MAX_PORT:
            raise ConfigError(f"{endpoint!r}: there is no port {found['port']}; use one up to {MAX_PORT}")
    if link.credentials is not None:
        for endpoint in link.connect:
            link.credentials.check_endpoint(endpoint)


def ports_of(endpoints: Sequence[str]) -> set[int]:
    """Return the ports of addresses that have one."""
    found = (ENDPOINT.fullmatch(endpoint.partition("#")[0]) for endpoint in endpoints)
    return {int(address["port"]) for address in found if address and address["port"]}


ROOM = "@may"
"""The part of a key that stands before the identity and the permission under test."""
VERBS = ("writes", "reads", "serves", "asks")
"""The permissions."""
JOIN = "joins"
"""Permission to join, granted below `ROOM` to every identity with any right."""
