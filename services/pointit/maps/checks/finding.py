"""What is found to be wrong with a map."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a map."""

    severity: Literal["error", "warning"]
    """Errors make something impossible that the map promises; warnings are probably mistakes."""
    where: str
    """Section and name in the file, `strips.17`."""
    text: str
    """What is wrong and what to do, a sentence that goes on from `where: `."""


def error(where: str, text: str) -> Finding:
    """Return a finding that makes something impossible."""
    return Finding("error", where, text)


def warning(where: str, text: str) -> Finding:
    """Return a finding that is probably a mistake."""
    return Finding("warning", where, text)
