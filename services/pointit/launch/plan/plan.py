"""Everything a run needs to know, decided before it begins."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pointit.launch.plan.page import Page
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.schemas import RunScenario


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run needs to know."""

    name: str
    launches: Sequence[Launch]
    """Of the scenario or the person; not the page's."""
    link: Link
    target_kinds: Sequence[str] = ()
    seed: int = 0
    duration_s: float | None = None
    is_limited: bool = False
    """The duration was asked for: it ends then, whoever looks on."""
    speed: float = 1.0
    processes: bool = False
    may_move: bool = False
    """The address to listen on is only the default: take the next port when it is taken."""
    scored: bool = True
    """A whole scenario: sum it up at the end, and without any cursor it has failed."""
    view: bool = True
    person: str = ""
    """Only this person's part is told and drawn; empty for everybody's."""
    notes: Sequence[str] = ()
    """Sentences that are said at the start."""
    afterword: str = ""
    """A sentence that is said below the summary."""
    summary: Path | None = None
    as_json: bool = False
    page: Page | None = None
    browser: bool = False
    """Open the page in a browser, where somebody sits."""
    scenario: str = ""
    """That runs; empty: one person's part."""
    scenarios: Sequence[str] = ()
    """That can be asked for instead; empty: none."""
    localizes: bool = False
    """People are found by pointing at lamps."""
    another: "Callable[[RunScenario, Plan], Plan] | None" = None
    """Makes the plan of what is asked for in place of a plan that runs; raises ConfigError. In any thread."""

    @property
    def users(self) -> list[str]:
        """Return whose services it starts, in order."""
        return list(dict.fromkeys(launch.user for launch in self.launches if launch.user))

    @property
    def instances(self) -> list[str]:
        """Return the names of all that it starts."""
        page = [] if self.page is None else [self.page.instance]
        return [launch.instance for launch in self.launches] + page
