"""The parts of commands that optional rooms bring: all there are, each with the rooms that it needs."""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from pointit.runtime.host.extras import OptionalPart

if TYPE_CHECKING:  # the listings need none of them
    from pointit.cli.common.run_part import RunPart
    from pointit.cli.display.summary import DisplayPart, LiveView

PersonCheck: TypeAlias = Callable[[str], None]
"""Checks whether a command may start the services of a person; raises ConfigError."""

_ROBOT_ROOMS = ("pointit.launch.robots", "pointit.services.user_sim")
_NAMES_ROOMS = ("pointit.speech", "pointit.services.selector.methods.estimate", "pointit.diagnosis")

RUN_PARTS: tuple[OptionalPart["RunPart"], ...] = (
    OptionalPart("pointit.cli.page:PAGE_PART", ("pointit.launch.page", "pointit.bridges.web")),
    OptionalPart(
        "pointit.cli.recordings.run_recorder:RECORDER_PART",
        ("pointit.launch.recorder", "pointit.services.recorder"),
    ),
    OptionalPart("pointit.cli.things.run_things:THINGS_PART", ("pointit.diagnosis",)),
    OptionalPart("pointit.cli.things.run_things:NAMES_PART", _NAMES_ROOMS),
)
"""Panels of options of `run`, in the order of its help."""

LIVE_VIEWS: tuple[OptionalPart["LiveView"], ...] = (
    OptionalPart("pointit.cli.display.view:on_screen", ("pointit.cli.common.keyboard",)),
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
    OptionalPart("pointit.cli.site.site:check_person", ("pointit.access",)),
)
"""Checks before a person joins a site."""
