"""Text for people: foreign text made safe to show on a terminal, in a log or on a page; rounded numbers."""

import re
import unicodedata

LONGEST_SENTENCE = 600
"""Characters of a foreign sentence that are shown."""

_SPACE = re.compile(r"\s+")


def plain(text: str) -> str:
    """Return `text` with `?` for each character that Python calls not printable, such as controls.

    Line breaks stay; tabs and all kinds of spaces become spaces.
    """
    return text if text.isprintable() else "".join(map(_plain, text))


def one_line(text: str, most: int = LONGEST_SENTENCE) -> str:
    """Return `text` as `plain`, on one line and of at most `most` characters."""
    shown = plain(_SPACE.sub(" ", text[: 2 * most]).strip())
    return shown if len(shown) <= most else f"{shown[: most - 1]}…"


def _plain(letter: str) -> str:
    if letter.isprintable() or letter == "\n":
        return letter
    return " " if letter == "\t" or unicodedata.category(letter) == "Zs" else "?"


def round_beyond(value: float, limit: float = 0.0, digits: int = 1) -> str:
    """Return `value` rounded to `digits` behind the point, on the same side of `limit` as `value`.

    A message that compares both stays true: 0.52 beyond a limit of 0.5 is "0.6", not "0.5".
    """
    rounded, step = round(value, digits), 10.0**-digits
    if value > limit >= rounded:
        rounded += step
    elif value < limit <= rounded:
        rounded -= step
    return f"{rounded:.{digits}f}"
