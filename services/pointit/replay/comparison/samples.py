"""Messages as plain values that can be compared."""

from typing import Any, NamedTuple, cast

from pointit.recording.entries import Entry, Exchange
from pointit.schemas import Message

IGNORED = frozenset(("seq",))
"""Fields that say nothing about what happened: a replay counts from its own beginning."""


class Sample(NamedTuple):
    """A message, as it is compared."""

    key: str
    time_ns: int
    """When it was put, time of the recording."""
    stamp_ns: int
    content: dict[str, Any]
    """Its fields."""


def sample_of(entry: Entry) -> Sample | None:
    """Return the message or the answered request of `entry`, or None if it is neither."""
    body = entry.body
    if not isinstance(body, Message | Exchange):
        return None
    content = {name: value for name, value in body.model_dump().items() if name not in IGNORED}
    return Sample(entry.key, entry.time_ns, body.stamp_ns, content)


class Leaf(NamedTuple):
    """A field in which two messages differ."""

    field: str
    """Path in the message, without the numbers of list items: `objects.position_m`."""
    difference: float | None
    """Its size, s for times, in the field's own unit else. None if it is no number."""
    is_exact: bool = False
    """True if any difference counts, because values are bytes, such as pixels."""


def differences(one: object, other: object, field: str = "") -> list[Leaf]:
    """Return the fields in which two plain values differ at all."""
    if one == other:
        return []
    a_number, other_number = _number(one), _number(other)
    if a_number is not None and other_number is not None:
        size = abs(a_number - other_number)
        return [Leaf(field, size / 1e9 if field.endswith("_ns") else float(size))]
    if isinstance(one, dict) and isinstance(other, dict):
        a, b = cast("dict[str, Any]", one), cast("dict[str, Any]", other)
        path = f"{field}." if field else ""
        return [leaf for name in a | b for leaf in differences(a.get(name), b.get(name), f"{path}{name}")]
    if isinstance(one, bytes) and isinstance(other, bytes):
        is_comparable = len(one) == len(other)
        worst = max((abs(x - y) for x, y in zip(one, other, strict=False)), default=0)
        return [Leaf(field, float(worst) if is_comparable else None, is_exact=True)]
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        c, d = cast("list[Any]", one), cast("list[Any]", other)
        if len(c) != len(d):
            return [Leaf(field, None)]
        return [leaf for x, y in zip(c, d, strict=True) for leaf in differences(x, y, field)]
    return [Leaf(field, None)]


def _number(value: object) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
