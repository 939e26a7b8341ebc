"""Part of `pointit run` that an optional room brings: a panel of options, and services beside the run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import Beside, MakeWatcher, Scenario


@dataclass(frozen=True, kw_only=True)
class Added:
    """Outcome of the options for one run."""

    beside: Sequence[Beside] = ()
    services: Sequence[str] = ()
    """Names of services that it puts there, for `--set`."""
    settings: Sequence[str] = ()
    """Parameters of services, as in `--set`, which wins over them."""
    notes: Sequence[str] = ()
    """Sentences to print at the start."""
    closing_note: str = ""
    """Sentence to print below the summary."""
    watchers: Sequence[MakeWatcher] = ()
    """Factories of further observers of each scenario of the run."""
    moves_wrists: bool = False
    """People may point with it, so that each gets an imu-bridge."""


@dataclass(frozen=True, kw_only=True)
class RunPart:
    """A panel of options of `run`."""

    heading: str
    names: Sequence[str]
    """Names of the options."""
    options: Callable[[Any], Any]
    """Adds the options to a command."""
    add: Callable[[Scenario, Choices, Mapping[str, Any]], Added]
    """Checks the values of the options of `run`; raises PointItError. Returns what they put beside it."""
