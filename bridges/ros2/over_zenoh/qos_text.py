"""Quality of service as rmw_zenoh writes it into tokens: a field that is the default stays empty.

`<reliability>:<durability>:<history>,<depth>:<deadline s>,<ns>:<lifespan s>,<ns>:<liveliness>,<lease s>,<ns>`
"""

from pointit.bridges.ros2.graph.backend import Qos

DEFAULT_DEPTH = 42
"""Default depth of rmw_zenoh. ROS nodes use 10 or 1 instead."""

RELIABLE = 1
BEST_EFFORT = 2
TRANSIENT_LOCAL = 1
VOLATILE = 2
KEEP_LAST = 1
KEEP_ALL = 2

ENDLESS_NS = 2**63 - 1
"""Infinite time in ROS, of which seconds and nanoseconds are omitted separately."""
NS_PER_S = 1_000_000_000


def qos_text(qos: Qos) -> str:
    """Return `qos` exactly as a genuine node writes it, since peers hash the text."""
    reliability = "" if qos.reliable else f"{BEST_EFFORT}"
    durability = f"{TRANSIENT_LOCAL}" if qos.latched else ""
    depth = "" if qos.depth == DEFAULT_DEPTH else f"{qos.depth}"
    lifespan = _time_text(qos.lifespan_ns)
    return f"{reliability}:{durability}:,{depth}:,:{lifespan}:,,"


def qos_of(text: str) -> Qos:
    """Return reliability, durability, depth and lifespan of `text`; other fields are not used.

    Raises:
        ValueError: If it is not written that way.
    """
    try:
        reliability, durability, history, *rest = text.split(":")
        history_kind, depth = history.split(",")
        _choice(history_kind, KEEP_LAST, KEEP_ALL)
        is_reliable = _choice(reliability, RELIABLE, BEST_EFFORT) == RELIABLE
        is_latched = _choice(durability, VOLATILE, TRANSIENT_LOCAL) == TRANSIENT_LOCAL
        depth_number = _natural(depth) if depth else DEFAULT_DEPTH
        lifespan_ns = _time_ns(rest[1]) if len(rest) > 1 else None
        return Qos(reliable=is_reliable, latched=is_latched, depth=depth_number, lifespan_ns=lifespan_ns)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a quality of service as rmw_zenoh writes it") from error


def _choice(text: str, default: int, other: int) -> int:
    if text in {"", f"{default}"}:
        return default
    if text == f"{other}":
        return other
    raise ValueError(text)


def _time_text(time_ns: int | None) -> str:
    parts = divmod(ENDLESS_NS if time_ns is None else time_ns, NS_PER_S)
    endless = divmod(ENDLESS_NS, NS_PER_S)
    texts: list[str] = []
    for part, default in zip(parts, endless, strict=True):
        texts.append("" if part == default else f"{part}")
    return ",".join(texts)


def _time_ns(text: str) -> int | None:
    """Return a time, or None if it is infinite."""
    seconds, nanoseconds = text.split(",")
    endless_s, endless_ns = divmod(ENDLESS_NS, NS_PER_S)
    whole_s = _natural(seconds) if seconds else endless_s
    rest_ns = _natural(nanoseconds) if nanoseconds else endless_ns
    time_ns = whole_s * NS_PER_S + rest_ns
    return None if time_ns == ENDLESS_NS else time_ns


def _natural(text: str) -> int:
    """Return the number written in plain digits; `int` alone would accept signs, blanks and underscores."""
    is_digits = text.isascii() and text.isdigit()
    if not is_digits or len(text) > 18:
        raise ValueError(text)
    return int(text)
