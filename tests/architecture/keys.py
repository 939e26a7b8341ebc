"""Recognizes keys of the topic table in string literals."""

import re
from collections.abc import Iterable

from pointit.schemas.topics import PRESENCES, REQUESTS, TOPICS


def patterns() -> list[str]:
    """Return the part of each key that identifies it in other text: all, or the part before the placeholder.

    Keys of one word (`map`, `objects`) are everyday words and cannot be identified.
    """
    heads = {row.key.partition("{")[0] for row in (*TOPICS, *REQUESTS, *PRESENCES)}
    return sorted(head for head in heads if "/" in head)


def finder(wanted: Iterable[str]) -> re.Pattern[str]:
    """Matches a key wherever it begins: at the start, or after anything but a word, dot or dash.

    The part before a placeholder must be followed by a name, `{`, `*`, or the end of an f-string's piece.
    """
    alternatives = "|".join(
        re.escape(each) + (r"(?=[\w{*$]|\Z)" if each.endswith("/") else r"(?![\w-])") for each in wanted
    )
    return re.compile(rf"(?<![\w.\-])(?:{alternatives})")
