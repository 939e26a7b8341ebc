"""Formatting of foreign names and texts in messages: a few of many, at most a line."""

from collections.abc import Iterable
from typing import Literal

from pointit.bridges.ros2.graph.backend import Endpoint

MAX_SHOWN = 3
"""Maximum number of listed names, unless the message is about them."""
MAX_NAME = 80
"""Maximum characters of a foreign name in a message."""
MAX_HASH = 20
"""Maximum characters of a type's hash in a message."""


def nodes(endpoints: Iterable[Endpoint], of_one: str = "", of_many: str = "") -> str:
    """Return the nodes of `endpoints`, and the verb that fits."""
    names = sorted({each.node for each in endpoints})
    is_one = len(names) == 1
    found = listed(short(name) for name in names)
    return f"node{'' if is_one else 's'} {found} {of_one if is_one else of_many}".rstrip()


def listed(names: Iterable[str], max_count: int = MAX_SHOWN) -> str:
    """Return the first `max_count` of `names`, and the number of further ones."""
    found = list(names)
    more = len(found) - max_count
    return ", ".join(found[:max_count]) + (f" and {more} more" if more > 0 else "")


def short(name: str) -> str:
    """Return a name, shortened if it is long."""
    return name if len(name) <= MAX_NAME else f"{name[:MAX_NAME]}…"


def short_hash(text: str) -> str:
    """Return a type's hash, shortened."""
    return text if len(text) <= MAX_HASH else f"{text[:MAX_HASH]}…"


def shown(text: str, max_count: int) -> str:
    """Return at most `max_count` printable characters of a foreign text."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:max_count])


def holds_text(cdr: bytes, text: str) -> bool:
    """Return True if `text` is a string in `cdr`; decoding takes 200 times as long."""
    letters = text.encode()
    order: Literal["little", "big"] = "little" if cdr[1:2] == b"\1" else "big"
    return (len(letters) + 1).to_bytes(4, order) + letters in cdr  # the length excludes longer names
