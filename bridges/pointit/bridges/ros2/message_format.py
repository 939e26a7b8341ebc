"""Names and texts of others in sentences: a few of many, no longer than a line."""

from collections.abc import Iterable

from pointit.bridges.ros2.graph.backend import Endpoint

MAX_SHOWN = 3
"""Names that a sentence lists, unless it is about them."""
MAX_NAME = 80
"""Characters of a foreign name that a sentence shows."""
MAX_HASH = 20
"""Characters of a type's hash that a sentence shows."""


def nodes(endpoints: Iterable[Endpoint], of_one: str = "", of_many: str = "") -> str:
    """Return who has `endpoints`, and the verb that fits."""
    names = sorted({each.node for each in endpoints})
    is_one = len(names) == 1
    found = listed(short(name) for name in names)
    return f"node{'' if is_one else 's'} {found} {of_one if is_one else of_many}".rstrip()


def listed(names: Iterable[str], most: int = MAX_SHOWN) -> str:
    """Return the first `most` of `names`, and how many more there are."""
    found = list(names)
    more = len(found) - most
    return ", ".join(found[:most]) + (f" and {more} more" if more > 0 else "")


def short(name: str) -> str:
    """Return a name, or how it begins."""
    return name if len(name) <= MAX_NAME else f"{name[:MAX_NAME]}…"


def short_hash(text: str) -> str:
    """Return a type's hash, or how it begins."""
    return text if len(text) <= MAX_HASH else f"{text[:MAX_HASH]}…"


def shown(text: str, most: int) -> str:
    """Return at most `most` characters of a foreign text, as a sentence for a terminal can have them."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:most])
