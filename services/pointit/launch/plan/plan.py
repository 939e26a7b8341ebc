"""Everything a run needs to know, decided before it starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pointit.launch.plan.beside import Beside
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.schemas import RunScenario


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run needs to know."""

    name: str
    launches: Sequence[Launch]
    """Services of the scenario or the person, without those beside it."""
    link: Link
    target_kinds: Sequence[str] = ()
    seed: int = 0
    duration_s: float | None = None
    is_limited: bool = False
    """The duration was requested: the run ends then, even with viewers."""
    speed: float = 1.0
    processes: bool = False
    may_move: bool = False
    """The listen address is only the default: use the next port if it is in use."""
    scored: bool = True
    """A whole scenario: print a summary at the end, and fail if there was no cursor."""
    view: bool = True
    person: str = ""
    """The only person whose activity is reported and drawn, or `""` for all."""
    notes: Sequence[str] = ()
    """Messages to print at the start."""
    afterword: str = ""
    """Message to print below the summary."""
    summary: Path | None = None
    as_json: bool = False
    beside: Sequence[Beside] = ()
    """Services that stay when the scenario changes, such as a page and a recorder."""
    scenario: str = ""
    """Name of the running scenario, or `""` for one person's part."""
    scenarios: Sequence[str] = ()
    """Names of the scenarios that can be requested instead."""
    localizes: bool = False
    """People are localized by pointing at lamps."""
    another: "Callable[[RunScenario, Plan], Plan] | None" = None
    """Makes the plan that replaces the running one on request; raises ConfigError. Thread-safe."""

    @property
    def users(self) -> list[str]:
        """Return the users whose services it starts, in order."""
        return list(dict.fromkeys(launch.user for launch in self.launches if launch.user))

    @property
    def instances(self) -> list[str]:
        """Return the instance names of all that it starts."""
        return [launch.instance for launch in self.launches] + [each.instance for each in self.beside]
