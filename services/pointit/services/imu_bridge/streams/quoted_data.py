"""Received bytes in messages to people."""

import codecs

MIN_READABLE = 0.8
"""Smallest share of readable characters in text."""
_UNREADABLE = "\ufffd"


def quoted(data: bytes, max_bytes: int = 40) -> str:
    """Return the first `max_bytes` bytes: quoted text with escaped control characters, else hexadecimal."""
    shown = data[:max_bytes]
    letters = _decoded(shown, "replace")
    readable = sum(each != _UNREADABLE and (each.isprintable() or each in "\t\r\n") for each in letters)
    if readable < MIN_READABLE * len(letters):
        return shown.hex(" ")
    text = _decoded(shown, "backslashreplace")
    return "'" + "".join(each if each.isprintable() else repr(each)[1:-1] for each in text) + "'"


def _decoded(data: bytes, errors: str) -> str:
    """Return UTF-8 `data` as text, without a character that is cut off at its end."""
    return codecs.getincrementaldecoder("utf-8")(errors).decode(data)
