"""Text that others have written, made safe to show to people: on a terminal, in a log, on a page."""

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
