"""Part of the view and of the summary of a run that an optional room brings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from pointit.launch.run.monitor import Monitor


@dataclass(frozen=True, kw_only=True)
class DisplayPart:
    """Display functions for the observations of a run."""

    rows: Callable[[Monitor, int], RenderableType | None]
    """Returns its table at a terminal's width, or None if it has nothing to show."""
    lines: Callable[[Monitor], Sequence[Text]]
    """Returns lines below the table, left out first in a low terminal."""
    summary: Callable[[Mapping[str, Any]], Sequence[str]]
    """Returns sentences on the summary of a run."""
