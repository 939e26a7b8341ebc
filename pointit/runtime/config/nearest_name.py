"""Advice for a name that does not exist."""

import difflib
from collections.abc import Iterable


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return `did you mean a or b?` with the up to three of `names` that are similar, or `""`."""
    similar = difflib.get_close_matches(name, list(names), n=3, cutoff=0.6)
    return f"did you mean {' or '.join(similar)}?" if similar else ""


def nearest(name: str, names: Iterable[str]) -> str:
    """Return `did you mean a or b?`, or `there are a, b, c` (or `none`) if no name is similar."""
    known = list(names)
    listed = ", ".join(known) or "none"
    return did_you_mean(name, known) or f"there are {listed}"
