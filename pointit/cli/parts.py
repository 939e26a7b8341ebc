"""Parts of commands that optional rooms bring: options of `pointit run`, its view, checks of people."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from pointit.runtime.host.extras import OptionalPart

if TYPE_CHECKING:  # the listings need none of them
    from pointit.cli.summary import DisplayPart, LiveView
    from pointit.launch.plan.launches import Choices
    from pointit.launch.plan.plan import Beside, MakeWatcher, Scenario

PersonCheck: TypeAlias = Callable[[str], None]
"""Checks whether a command may start the services of a person; raises ConfigError."""

_NAMES_ROOMS = ("pointit.bridges.speaker", "pointit.services.selector.methods.estimate", "pointit.diagnosis")

LIVE_VIEWS: tuple[OptionalPart["LiveView"], ...] = (
    OptionalPart("pointit.cli.view:on_screen", ("pointit.cli.common.keyboard",)),
)
"""The view of a run in the terminal. Without one, a run logs."""

DISPLAY_PARTS: tuple[OptionalPart["DisplayPart"], ...] = (
    OptionalPart("pointit.cli.robots:ROBOTS_DISPLAY", ("pointit.launch.robots", "pointit.services.user_sim")),
    OptionalPart("pointit.cli.inspect.pose_errors:TRUTH_DISPLAY"),
    OptionalPart("pointit.cli.things.run_things:THINGS_DISPLAY", ("pointit.diagnosis",)),
    OptionalPart("pointit.cli.things.run_things:NAMES_DISPLAY", _NAMES_ROOMS),
)
"""Parts of the view and the summary of a run, in their order."""

PERSON_CHECKS: tuple[OptionalPart[PersonCheck], ...] = (
    OptionalPart("pointit.cli.site:check_person", ("pointit.access",)),
)
"""Checks before a person joins a site."""


@dataclass(frozen=True, kw_only=True)
class RunAddition:
    """Services, parameters and sentences that options add to one run."""

    beside: Sequence["Beside"] = ()
    services: Sequence[str] = ()
    """Names of services that it puts there, for `--set`."""
    site_services: Sequence[str] = ()
    """Services that it adds to those of the scenario."""
    settings: Sequence[str] = ()
    """Parameters of services, as in `--set`, which wins over them."""
    notes: Sequence[str] = ()
    """Sentences to print at the start."""
    closing_note: str = ""
    """Sentence to print below the summary."""
    watchers: Sequence["MakeWatcher"] = ()
    """Factories of further observers of each scenario of the run."""
    moves_wrists: bool = False
    """People may point with it, so that each gets an imu-bridge."""


def joined_addition(additions: Iterable[RunAddition]) -> RunAddition:
    """Return all `additions` to a run as one, in their order."""
    beside: list[Beside] = []
    services: list[str] = []
    site_services: list[str] = []
    settings: list[str] = []
    notes: list[str] = []
    closing_notes: list[str] = []
    watchers: list[MakeWatcher] = []
    moves_wrists = False
    for addition in additions:
        beside += addition.beside
        services += addition.services
        site_services += addition.site_services
        settings += addition.settings
        notes += addition.notes
        watchers += addition.watchers
        moves_wrists = moves_wrists or addition.moves_wrists
        if addition.closing_note:
            closing_notes.append(addition.closing_note)
    return RunAddition(
        beside=beside,
        services=services,
        site_services=site_services,
        settings=settings,
        notes=notes,
        closing_note=" ".join(closing_notes),
        watchers=watchers,
        moves_wrists=moves_wrists,
    )


@dataclass(frozen=True, kw_only=True)
class RunPart:
    """A panel of options of `run`."""

    heading: str
    names: Sequence[str]
    """Names of the options."""
    options: Callable[[Any], Any]
    """Adds the options to a command."""
    add: "Callable[[Scenario, Choices, Mapping[str, Any]], RunAddition]"
    """Checks the values of the options of `run`; raises PointItError. Returns what they put beside it."""


RUN_PARTS: tuple[OptionalPart[RunPart], ...] = (
    OptionalPart("pointit.cli.page:PAGE_PART", ("pointit.launch.page", "pointit.bridges.web")),
    OptionalPart("pointit.cli.recordings.run_recorder:RECORDER_PART", ("pointit.services.recorder",)),
    OptionalPart(
        "pointit.cli.things.run_things:THINGS_PART", ("pointit.diagnosis", "pointit.services.reactions")
    ),
    OptionalPart("pointit.cli.things.run_things:NAMES_PART", _NAMES_ROOMS),
)
"""Panels of options of `run`, in the order of its help."""
