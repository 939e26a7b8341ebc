"""Formatting of foreign names in messages: a few of many."""

from collections.abc import Iterable

from pointit.bridges.ros2.graph.backend import Endpoint
from pointit.schemas.text import one_line

MAX_SHOWN = 3
"""Maximum number of listed names, unless the message is about them."""
MAX_NAME = 80
"""Maximum characters of a foreign name in a message."""


def nodes(endpoints: Iterable[Endpoint], of_one: str = "", of_many: str = "") -> str:
    """Return the nodes of `endpoints`, and the verb that fits."""
    names = sorted({each.node for each in endpoints})
    is_one = len(names) == 1
    found = listed(one_line(name, MAX_NAME) for name in names)
    return f"node{'' if is_one else 's'} {found} {of_one if is_one else of_many}".rstrip()


def listed(names: Iterable[str], max_count: int = MAX_SHOWN) -> str:
    """Return the first `max_count` of `names`, and the number of further ones."""
    found = list(names)
    more = len(found) - max_count
    return ", ".join(found[:max_count]) + (f" and {more} more" if more > 0 else "")
