"""Resolves typed keys to rows of the topic table, each with a name or all names."""

import difflib
from collections.abc import Iterable, Sequence

from pointit.cli.common.lazy import UnknownNameError
from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import KeyNameError
from pointit.schemas.topics import ANY, PRESENCES, REQUESTS, TOPICS
from pointit.services.registry import add_installed

Wanted = tuple[AnyTopic, str]
"""A row, and the value of its placeholder: a name, `*` for all, or `""` if it has none."""

EVERYTHING = "**"


def resolve(typed: str) -> list[Wanted]:
    """Return the topics that match `typed`.

    `users/anna/imu` is one key, `users/*/imu` or `users/{user}/imu` those of all users, `users/anna/*` all
    of anna's, and `**` at the end matches any rest.

    Raises:
        UnknownNameError: If no topic matches; suggests similar keys.
    """
    add_installed()
    parts = typed.strip("/").split("/")
    wanted: list[Wanted] = []
    for topic in TOPICS:
        name = _match(parts, topic.key.split("/"))
        if name is None:
            continue
        try:
            topic.at(name)
        except KeyNameError as error:
            raise UnknownNameError(f"key {typed!r}: {error}") from error
        wanted.append((topic, name))
    if not wanted:
        raise UnknownNameError(f"no topic has the key {typed!r}; {_advice(parts)}")
    return wanted


def resolve_all(typed: Iterable[str]) -> list[Wanted]:
    """Return the topics that match any of `typed`, each row and name once."""
    return list(dict.fromkeys(wanted for key in typed for wanted in resolve(key)))


def _match(parts: Sequence[str], pattern: Sequence[str]) -> str | None:
    """Return the part for the placeholder of `pattern`, `""` if it has none, or None if it does not match."""
    if parts[-1] == EVERYTHING:
        head = parts[:-1]
        parts = [*head, *[ANY] * (len(pattern) - len(head))]
    if len(parts) != len(pattern):
        return None
    name = ""
    for part, own in zip(parts, pattern, strict=True):
        if _is_placeholder(own):
            name = ANY if part in (ANY, own) else part
        elif part not in (ANY, own):
            return None
    return name


def _advice(parts: Sequence[str]) -> str:
    for what, rows in (("something to ask for", REQUESTS), ("presence", PRESENCES)):
        for row in rows:
            if _match(parts, row.key.split("/")) is not None:
                hint = "; ask with `pointit service call`" if rows is REQUESTS else ""
                return f"{row.key} is {what} ({row.about}), not a topic{hint}"
    known = [filled(topic.key, parts) for topic in TOPICS]
    near = difflib.get_close_matches("/".join(parts), known, n=3, cutoff=0.5)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return "`pointit topic list` shows them all"


def filled(key: str, parts: Sequence[str]) -> str:
    """Return `key` with the placeholder replaced by the typed part."""
    own = key.split("/")
    return "/".join(
        parts[i] if _is_placeholder(part) and i < len(parts) and parts[i] else part
        for i, part in enumerate(own)
    )


def _is_placeholder(part: str) -> bool:
    return part.startswith("{")
