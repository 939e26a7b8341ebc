"""Formatting of foreign names in messages: a few of many."""

from collections.abc import Iterable

from pointit.bridges.ros2.graph.backend import Endpoint
from pointit.schemas.text import first_of, one_line

MAX_SHOWN = 3
"""Maximum number of listed names, unless the message is about them."""
MAX_NAME = 80
"""Maximum characters of a foreign name in a message."""


def nodes(endpoints: Iterable[Endpoint], of_one: str = "", of_many: str = "") -> str:
    """Return the nodes of `endpoints`, and the verb that fits."""
    names = sorted({endpoint.node for endpoint in endpoints})
    listing = first_of((one_line(name, MAX_NAME) for name in names), MAX_SHOWN)
    if len(names) == 1:
        return f"node {listing} {of_one}".rstrip()
    return f"nodes {listing} {of_many}".rstrip()
