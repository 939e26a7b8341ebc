"""A problem found in a map."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class MapFinding:
    """One problem of a map."""

    severity: Literal["error", "warning"]
    """Errors make a function of the map impossible. Warnings are probable mistakes."""
    where: str
    """Section and name in the file, `strips.17`."""
    text: str
    """Problem and remedy, a sentence that continues `where: `."""


def error(where: str, text: str) -> MapFinding:
    """Return a finding that makes a function impossible."""
    return MapFinding("error", where, text)


def warning(where: str, text: str) -> MapFinding:
    """Return a probable mistake."""
    return MapFinding("warning", where, text)
