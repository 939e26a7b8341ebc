"""Levels from which a recording is replayed: services that run again, and the entries that they write."""

from collections.abc import Iterable
from typing import Any, Literal, assert_never

from pointit.recording.entries import AnyRow, Entry
from pointit.runtime.errors import PointItError
from pointit.schemas import Feedback, SelectionEvent, UserPose, topics
from pointit.schemas.system import instance_of, split_instance
from pointit.services.pui.things import TRACKER

Level = Literal["edge", "rays", "cursors"]
"""Inputs taken from the recording: those of devices and other systems, or also rays, or also cursors."""

SERVICES: dict[Level, tuple[str, ...]] = {
    "edge": ("keeper", "pui", "localizer", "supervisor", "pointing", "goal", "selector", "led-driver"),
    "rays": ("keeper", "pui", "supervisor", "goal", "selector", "led-driver"),
    "cursors": ("selector", "led-driver"),
}
"""Services that run again, in the order in which they are started."""

OF_TRACKERS = ("left", "dispatched")
"""Selection events that trackers publish, not the selector."""

OF_SELECTOR = ("selected", "deselected")
"""Cues that only the selector gives."""

CALLED_BY_SERVICES: tuple[topics.Request[Any, Any], ...] = (
    topics.START_LOCALIZATION,
    topics.CANCEL_LOCALIZATION,
    topics.POINT_ANCHOR,
    topics.SET_POSE,
)
"""Requests of the supervisor. People and other programs may send them, too."""


OBSERVERS = ("recorder", "web", "ros2", "foxglove")
"""Processes that show a site or connect it with others. A site has its own, whatever a recording says."""


class ReplayError(PointItError):
    """A recording cannot be replayed; the message has the reason and the remedy."""


def is_about_site(row: AnyRow, name: str) -> bool:
    """Return True if `row` tells of `name` who runs or watches a site, not what happens there."""
    if row in (topics.SERVICE_ALIVE, *topics.ACCOUNTS):
        return split_instance(name)[0] in OBSERVERS
    return row is topics.DEPLOYMENT


class Split:
    """Division of a recording: entries that are recomputed, and its edge, which comes from the file."""

    def __init__(self, level: Level, recorded: Iterable[str]) -> None:
        """Choose among the `recorded` instances, such as `selector` and `pointing.anna`.

        Raises:
            ReplayError: None of the services of `level` is among them.
        """
        self._names = names = SERVICES[level]
        self.instances = frozenset(each for each in recorded if split_instance(each)[0] in names)
        """Instances that run again."""
        if not self.instances:
            raise ReplayError(
                f"the recording has no configuration of any service that --from {level} replays "
                f"({', '.join(names)}): none ran, it was imported, or its beginning is damaged; "
                "`pointit export` and `pointit page` read it all the same"
            )

    def is_recomputed(self, entry: Entry) -> bool:
        """Return True if a service that runs again writes what `entry` says."""
        row, body = entry.row, entry.body
        match row:
            case topics.Presence():
                if row is topics.SHARD_ALIVE:
                    return self.runs(*split_instance(entry.name))
                return row is topics.SERVICE_ALIVE and entry.name in self.instances
            case topics.Request():
                return self.runs(row.server, entry.name)
            case topics.Topic():
                pass
            case _:
                assert_never(row)
        if row in (topics.CONFIGURATION, topics.HEALTH, topics.SERVED):
            return entry.name in self.instances
        if row is topics.SELECTION_EVENTS and isinstance(body, SelectionEvent) and body.event in OF_TRACKERS:
            return False
        if row is topics.POSE and isinstance(body, UserPose) and body.method == "external":
            return False
        if row is topics.FEEDBACK and isinstance(body, Feedback) and body.cue in OF_SELECTOR:
            return self.runs("selector", "")
        if row is topics.FEEDBACK:
            return self.runs("supervisor", entry.name)
        return any(self.runs(writer, entry.name) for writer in _writers(row, entry.name))

    def rank(self, instance: str) -> int:
        """Return the place of a service in the order of starts."""
        service = split_instance(instance)[0]
        return self._names.index(service) if service in self._names else len(self._names)

    def runs(self, service: str, name: str) -> bool:
        """Return True if `service` runs again, for the person `name` if it is one of a person."""
        return service in self.instances or instance_of(service, name) in self.instances


def _writers(row: topics.Topic[Any], name: str) -> Iterable[str]:
    """Return the services that write `name` of a topic: `pui` lists the things of the map alone."""
    if row is not topics.OBJECTS:
        return row.writers
    return ("pui",) if name == TRACKER else (writer for writer in row.writers if writer != "pui")
