"""Where ROS's router is and where PointIt's: one port of one machine cannot be both."""

import re
from collections.abc import Iterable

from pointit.runtime.errors import ConfigError

ENDPOINT = re.compile(r"(?P<protocol>\w+)/(?P<host>\[[^]]+\]|[^/:\s]+):(?P<port>\d{1,5})([?#].*)?")
"""What has a port; of the rest, no two are the same here."""
HERE = frozenset({"127.0.0.1", "[::1]", "localhost", "0.0.0.0", "[::]"})  # noqa: S104 - compared, not bound
"""Hosts that are this machine, or include it."""
STREAMS = frozenset({"tcp", "tls", "ws"})
"""Protocols that share the ports of TCP."""

Place = tuple[bool, str, int]
"""Whether its port is one of TCP's, its host, its port."""


def place_of(endpoint: str) -> Place | None:
    """Return where `endpoint` is, the same for every way to write this machine; none: it has no port."""
    found = ENDPOINT.fullmatch(endpoint)
    if found is None:
        return None
    host = found["host"].lower()
    return found["protocol"] in STREAMS, "" if host in HERE else host, int(found["port"])


def check_apart(endpoint: str, ours: Iterable[str]) -> None:
    """Make sure that ROS's router is not looked for where PointIt itself is.

    Args:
        endpoint: where ROS's router is.
        ours: where this process connects or listens for PointIt.

    Raises:
        ConfigError: it is one of `ours`.
    """
    place = place_of(endpoint)
    for own in ours:
        if place is not None and place_of(own) == place:
            raise ConfigError(
                f"backend.endpoint {endpoint} is where this command has PointIt itself ({own}), and one port "
                "is either ROS's router or PointIt's: say with --connect where PointIt is (a run with --ros2 "
                "is at tcp/127.0.0.1:7448), or with backend.endpoint where ROS's router is"
            )
