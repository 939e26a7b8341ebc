"""The parts of commands that optional rooms bring: all there are, each with the rooms that it needs."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from pointit.runtime.host.extras import Part

if TYPE_CHECKING:  # the listings need none of them
    from pointit.cli.common.run_part import RunPart
    from pointit.cli.display.display_part import DisplayPart
    from pointit.runtime.config.plugins import PluginGroup

# imported in functions: only if the rooms are there
# ruff: noqa: PLC0415

PersonCheck: TypeAlias = Callable[[str], None]
"""Checks whether a command may start the services of a person; raises ConfigError."""
PluginGroups: TypeAlias = Mapping[str, "PluginGroup[Any]"]
"""Plug-ins by their kind."""


def _page() -> "RunPart":
    from pointit.cli.page.run_page import PAGE_PART

    return PAGE_PART


def _recorder() -> "RunPart":
    from pointit.cli.recordings.run_recorder import RECORDER_PART

    return RECORDER_PART


def _things() -> "RunPart":
    from pointit.cli.things.run_things import THINGS_PART

    return THINGS_PART


def _names() -> "RunPart":
    from pointit.cli.things.run_names import NAMES_PART

    return NAMES_PART


def _names_display() -> "DisplayPart":
    from pointit.cli.things.run_names import NAMES_DISPLAY

    return NAMES_DISPLAY


def _things_display() -> "DisplayPart":
    from pointit.cli.things.run_things import THINGS_DISPLAY

    return THINGS_DISPLAY


def _robots() -> "DisplayPart":
    from pointit.cli.robots.robots_view import ROBOTS_DISPLAY

    return ROBOTS_DISPLAY


def _truth_display() -> "DisplayPart":
    from pointit.cli.inspect.truth_view import TRUTH_DISPLAY

    return TRUTH_DISPLAY


def _credentials() -> PersonCheck:
    from pointit.cli.site.person_check import check_person

    return check_person


def _plugins() -> PluginGroups:
    from pointit.plugins import GROUPS
    from pointit.speech.recogniser import RECOGNISERS

    return {**GROUPS, "recogniser": RECOGNISERS}


RUN_PARTS: Sequence[Part["RunPart"]] = (
    (("pointit.cli.page", "pointit.launch.page", "pointit.bridges.web"), _page),
    (("pointit.cli.recordings", "pointit.launch.recorder", "pointit.services.recorder"), _recorder),
    (("pointit.cli.things",), _things),
    (("pointit.cli.things", "pointit.speech", "pointit.services.selector.methods.estimate"), _names),
)
"""Panels of options of `run`, in the order of its help."""

DISPLAY_PARTS: Sequence[Part["DisplayPart"]] = (
    (("pointit.cli.robots", "pointit.launch.robots", "pointit.services.user_sim"), _robots),
    (("pointit.cli.inspect",), _truth_display),
    (("pointit.cli.things",), _things_display),
    (("pointit.cli.things", "pointit.speech", "pointit.services.selector.methods.estimate"), _names_display),
)
"""Parts of the view and the summary of a run, in their order."""

PERSON_CHECKS: Sequence[Part[PersonCheck]] = ((("pointit.cli.site", "pointit.access"), _credentials),)
"""Checks before a person joins a site."""

PLUGIN_GROUPS: Sequence[Part[PluginGroups]] = (
    (("pointit.plugins", "pointit.services.robot", "pointit.speech"), _plugins),
)
"""Plug-ins that are listed."""
