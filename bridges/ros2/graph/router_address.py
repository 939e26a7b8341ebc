"""Addresses of routers of ROS and of PointIt, which must differ."""

import re
from collections.abc import Iterable

from pointit.runtime.errors import ConfigError

Place = tuple[bool, str, int]
"""True if the port is one of TCP's, host, port."""

ENDPOINT = re.compile(r"(?P<protocol>\w+)/(?P<host>\[[^]]+\]|[^/:\s]+):(?P<port>\d{1,5})([?#].*)?")
"""Endpoints with a port. Others are never compared."""
HERE = frozenset({"127.0.0.1", "[::1]", "localhost", "0.0.0.0", "[::]"})  # noqa: S104 - compared, not bound
"""Hosts that are this machine, or include it."""
STREAMS = frozenset({"tcp", "tls", "ws"})
"""Protocols that share the ports of TCP."""


def place_of(endpoint: str) -> Place | None:
    """Return the address of `endpoint`, unique for this machine's many names, or None without a port."""
    match = ENDPOINT.fullmatch(endpoint)
    if match is None:
        return None
    host = match["host"].lower()
    if host in HERE:
        host = ""
    return match["protocol"] in STREAMS, host, int(match["port"])


def check_apart(endpoint: str, ours: Iterable[str]) -> None:
    """Check that ROS's router is not looked for at PointIt's own address.

    Args:
        endpoint: address of ROS's router.
        ours: addresses where this process connects or listens for PointIt.

    Raises:
        ConfigError: If it is one of `ours`.
    """
    place = place_of(endpoint)
    if place is None:
        return
    for own in ours:
        if place_of(own) == place:
            raise ConfigError(
                f"backend.endpoint {endpoint} is where this command has PointIt itself ({own}), and one port "
                "is either ROS's router or PointIt's: say with --connect where PointIt is (a run with --ros2 "
                "is at tcp/127.0.0.1:7448), or with backend.endpoint where ROS's router is"
            )
