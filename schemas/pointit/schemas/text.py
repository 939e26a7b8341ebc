"""Text for people: foreign text made safe to show, mistakes in data, rounded numbers."""

import re
import unicodedata

from pydantic_core import ErrorDetails

LONGEST_SENTENCE = 600
"""Characters of a foreign sentence that are shown."""

_WANTED = {
    "greater_than": "must be above {gt}", "greater_than_equal": "must be at least {ge}",
    "less_than": "must be below {lt}", "less_than_equal": "must be at most {le}",
    "finite_number": "must be a finite number", "literal_error": "use one of {expected}",
    "bool": "write true or false", "dict": "write a mapping of names to values", "float": "write a number",
    "int": "write a whole number", "list": "write a list such as [a, b]", "path": "write the path of a file",
    "string": "write text", "tuple": "write a list such as [a, b]", "missing": "is missing; give it a value",
    "extra_forbidden": "is no field of it; leave it out",
}  # fmt: skip
"""Advice by pydantic's error type, or by its first word (`int_parsing`, `int_type`)."""

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


def describe_mistake(detail: ErrorDetails) -> str:
    """Return a message on a value that pydantic refuses, without the value."""
    what = detail["type"]
    wanted = _WANTED.get(what) or (
        _WANTED.get(what.partition("_")[0]) if what.endswith(("_type", "_parsing", "_from_float")) else None
    )
    if wanted is None:
        return detail["msg"].removeprefix("Value error, ").replace("Input should ", "must ")
    limits = {name: str(value).removesuffix(".0") for name, value in detail.get("ctx", {}).items()}
    return wanted.format(**limits)
