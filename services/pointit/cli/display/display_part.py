"""The live view of a run, and parts of it and of the summary, that optional rooms bring."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, TypeAlias

from rich.console import Console, RenderableType
from rich.text import Text

from pointit.launch.run.monitor import Monitor
from pointit.launch.run.running_scenario import RunningScenario


@dataclass(frozen=True, kw_only=True)
class DisplayPart:
    """Display functions for the observations of a run."""

    rows: Callable[[Monitor, int], RenderableType | None]
    """Returns its table at a terminal's width, or None if it has nothing to show."""
    lines: Callable[[Monitor], Sequence[Text]]
    """Returns lines below the table, left out first in a low terminal."""
    summary: Callable[[Mapping[str, Any]], Sequence[str]]
    """Returns sentences on the summary of a run."""


LiveView: TypeAlias = Callable[
    [RunningScenario, Console, Callable[[], float | None], Callable[[], bool], Sequence[DisplayPart]],
    AbstractContextManager[None],
]
"""Draws a scenario in a terminal while the context is open. The two functions return the monotonic time when
the run ends by itself, if ever, and True if a page is open, for which it continues."""
