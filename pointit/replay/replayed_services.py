"""Services of a recording that run again, with their configuration, map, state and clock."""

import asyncio
import json
import logging
import math
import re
import tempfile
import time
from collections.abc import AsyncGenerator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, assert_never, cast

from pydantic import ValidationError

from pointit.maps.edit import dump_yaml
from pointit.maps.file import shipped_maps
from pointit.maps.model import OBJECT
from pointit.recording.entries import AnyRow, Entry
from pointit.runtime.bus.contract import AnyTopic, Bus
from pointit.runtime.clock import Clock
from pointit.runtime.config.config import Config, Layers, validate
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import (
    NS_PER_S,
    ClockTick,
    Configuration,
    Environment,
    Feedback,
    Interaction,
    Message,
    PointingOffset,
    Selection,
    SelectionEvent,
    SetPose,
    Thing,
    UserPose,
    UserProfile,
    topics,
)
from pointit.schemas.system import instance_of, split_instance
from pointit.schemas.topics import CONFIGURATION, INTERACTION, MAP, Delivery, Topic
from pointit.services import registry
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.tracked_objects import TRACKER
from pointit.services.selector.journal import Journal
from pointit.services.selector.selection_publisher import Record
from pointit.services.supervisor.life_cycle import LAST_WORD_PURPOSE
from pointit.services.supervisor.transitions import OFFSET_PURPOSE

log = logging.getLogger(__name__)

Level = Literal["edge", "rays", "cursors"]
"""Inputs taken from the recording: those of devices and other systems, or also rays, or also cursors."""

MAX_BURST = 256
"""Entries that are put at once, at most, before the services get their turn, as queues are bounded."""
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

MAX_NAME = 64
"""Characters of a name that are used, at most."""
_UNSAFE = re.compile(r"[^\w. ()+,=@-]")

GATHERING_NS = 5 * NS_PER_S
"""Time after the beginning within which retained states reach a recorder, ns."""


class RecordingClock:
    """Begins at a time of a recording and follows the running loop's time, which may be virtual."""

    def __init__(self, start_ns: int, speed: float = 1.0) -> None:
        """Begin now at `start_ns`, Unix ns, and run `speed` times as fast as the loop."""
        self.speed = speed
        self._start_ns = start_ns
        self._loop = asyncio.get_running_loop()
        self._began_s = self._loop.time()
        self._burst = 0
        """Number of calls of `wait_until` in a row that had nothing to wait for."""

    def now_ns(self) -> int:
        """Return the time in the recording, Unix ns."""
        return self._start_ns + round((self._loop.time() - self._began_s) * self.speed * NS_PER_S)

    def tick(self) -> ClockTick:
        """Return the tick by which other processes follow."""
        return ClockTick(stamp_ns=time.time_ns(), sim_ns=self.now_ns(), speed=self.speed)

    async def wait_until(self, time_ns: int) -> None:
        """Wait until the recording's time is `time_ns`.

        Return at once if it has passed, but let others run after `MAX_BURST` such calls.
        """
        left_s = (time_ns - self.now_ns()) / NS_PER_S / self.speed
        self._burst = 0 if left_s > 0.0 or self._burst >= MAX_BURST else self._burst + 1
        if self._burst == 0:
            await asyncio.sleep(max(left_s, 0.0))


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
        row = entry.row
        body = entry.body
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


def write_room(room: Environment, folder: Path) -> Path | None:
    """Write `room` as a map file of its name into `folder` and return the path.

    Characters of the name that could lead out of `folder` are replaced. Return None if `room` has point
    clouds, whose points are not in the message.
    """
    if room.clouds:
        return None
    path = folder / f"{_UNSAFE.sub('_', room.name)[:MAX_NAME] or 'map'}.yaml"
    path.write_text(dump_yaml(_sections(room)), encoding="utf-8")
    return path


def check_map(name: str) -> None:
    """Check the map in the recorded parameters of pui, which is used if `write_room` can write none.

    Raises:
        ReplayError: It is neither shipped nor a file in the current folder or below: a recording may come
            from anybody, and must not have other files opened.
    """
    if name not in shipped_maps() and not _is_file_here(name):
        raise ReplayError(
            f"the recording refers to the map {name[:MAX_NAME]!r}, which is neither shipped nor a file in "
            "the current folder: replay it in the folder of the map"
        )


def _is_file_here(name: str) -> bool:
    try:
        path = Path(name).resolve()
        return path.is_relative_to(Path.cwd()) and path.is_file()
    except (OSError, ValueError):  # too long, or a zero in it
        return False


def _sections(room: Environment) -> dict[str, Any]:
    sections: dict[str, Any] = {
        "lamps": {lamp.id: {"position": list(lamp.position_m)} for lamp in room.lamps},
        "strips": {
            each.id: {"line": _line(each.line_m), "pixels": each.pixels, "direction": each.direction}
            for each in room.strips
        },
        "belts": {each.id: {"centerline": _line(each.line_m), "width": each.width_m} for each in room.belts},
        "links": [
            {
                "from": link.source,
                "to": link.target,
                "from_position": link.source_position_m,
                "to_position": link.target_position_m,
            }
            for link in room.links
        ],
        "bays": {bay.id: bay.belt for bay in room.bays},
        "frames": {
            each.id: {"position": list(each.position_m), "orientation": list(each.orientation_xyzw)}
            for each in room.frames
        },
        "boxes": {
            each.id: {
                "center": list(each.center_m),
                "size": list(each.size_m),
                "yaw_deg": math.degrees(each.yaw_rad),
            }
            for each in room.boxes
        },
        "planes": {
            each.id: {"center": list(each.center_m), "normal": list(each.normal)}
            | ({} if each.size_m is None else {"size": list(each.size_m)})
            for each in room.planes
        },
        "cylinders": {
            each.id: {"center": list(each.center_m), "radius": each.radius_m, "height": each.height_m}
            for each in room.cylinders
        },
        "spheres": {
            each.id: {"center": list(each.center_m), "radius": each.radius_m} for each in room.spheres
        },
        "fences": {
            each.id: {"kind": each.kind, "outline": [list(corner) for corner in each.outline_m]}
            | ({} if each.low_m is None else {"low": each.low_m})
            | ({} if each.high_m is None else {"high": each.high_m})
            for each in room.fences
        },
        "things": {each.id: _thing(each) for each in room.things},
    }
    for link in sections["links"]:
        if link["from_position"] is None:
            del link["from_position"]
    return {name: entries for name, entries in sections.items() if entries}


def _thing(thing: Thing) -> dict[str, object]:
    entry: dict[str, object] = {"mode": thing.mode, "press": thing.press}
    if thing.is_tracked:
        entry["at"] = OBJECT
    else:
        entry |= {"center": list(thing.center_m), "size": list(thing.size_m)}
        entry["yaw_deg"] = math.degrees(thing.yaw_rad)
    if thing.strip:
        entry["light"] = {"strip": thing.strip, "from": thing.part_m[0], "to": thing.part_m[1]}
    elif thing.lamp:
        entry["light"] = thing.lamp
    if thing.dwell_s is not None:
        entry["dwell_s"] = thing.dwell_s
    return entry | ({"label": thing.label} if thing.label else {})


def _line(line: tuple[tuple[float, float, float], ...]) -> list[list[float]]:
    return [list(vertex) for vertex in line]


@dataclass
class Beginning:
    """States and services that were there when the recording began."""

    retained: dict[str, Entry] = field(default_factory=dict[str, Entry])
    """By key: the first entry of each state that was older than the recording."""
    room: Environment | None = None
    instances: set[str] = field(default_factory=set[str])
    """Services with a configuration, now or later in the recording."""

    def states(self, split: Split, *, recomputed: bool) -> Iterator[tuple[AnyTopic, str, Message]]:
        """Yield topic, name and value of the states, either `recomputed` ones or those of the edge."""
        for entry in self.retained.values():
            row = entry.row
            body = entry.body
            if not isinstance(row, Topic) or not isinstance(body, Message) or row is CONFIGURATION:
                continue
            if split.is_recomputed(entry) == recomputed:
                yield row, entry.name, body

    def restore(self, site: str, folder: Path) -> Path | None:
        """Write what the services of `site` read from disk into the state directory in use.

        Return the path of the map, written into `folder`, or None to use the configured one.
        """
        for entry in self.retained.values():
            if isinstance(entry.body, UserProfile) and entry.body.offset is not None:
                StateFile(PointingOffset, entry.name, OFFSET_PURPOSE).write(entry.body.offset)
            elif isinstance(entry.body, Selection):
                _restore_selection(entry.body, site, entry.time_ns)
        return None if self.room is None else write_room(self.room, folder)

    def restore_interaction(self, user: str, now_ns: int) -> None:
        """Write the interaction of `user`, so that a supervisor that starts at `now_ns` resumes it.

        A supervisor resumes pointing if its localizer is older than the interaction, and so must this one be.
        """
        entry = self.retained.get(INTERACTION.at(user))
        if entry is not None and isinstance(entry.body, Interaction):
            before = entry.body.model_copy(update={"stamp_ns": now_ns})
            StateFile(Interaction, user, LAST_WORD_PURPOSE).write(before)

    def measured_poses(self) -> Iterator[tuple[str, SetPose]]:
        """Yield the people whose localizers had found a pose, and the request that sets it."""
        for entry in self.retained.values():
            pose = entry.body
            if isinstance(pose, UserPose) and pose.method != "external" and any(pose.covariance):
                yield entry.name, SetPose.model_validate(pose, from_attributes=True)


def read_beginning(entries: Iterable[Entry], began_ns: int) -> Beginning:
    """Return the state at `began_ns`. `entries` are all those of states, in order."""
    beginning = Beginning()
    seen: set[str] = set()
    for entry in entries:
        row = entry.row
        body = entry.body
        if row is CONFIGURATION:
            beginning.instances.add(entry.name)
        if entry.key in seen or not isinstance(row, Topic) or row.delivery is not Delivery.STATE:
            continue
        seen.add(entry.key)
        if row is MAP and isinstance(body, Environment):
            beginning.room = body
        is_early = entry.time_ns < began_ns + GATHERING_NS
        if is_early and isinstance(body, Message) and body.stamp_ns < began_ns:
            beginning.retained[entry.key] = entry
    return beginning


def _restore_selection(selection: Selection, site: str, now_ns: int) -> None:
    journal = Journal(site_folder(site, "selector"))
    journal.begin(now_ns)
    for number, each in enumerate(selection.objects, 1):
        journal.add(
            Record(
                each.since_ns,
                "selected",
                each.id,
                each.kind,
                user=each.user,
                owner=each.user,
                since_ns=each.since_ns,
                confidence=each.confidence,
                seq=number,
            )
        )
        journal.mark_published(number)
    journal.maintain(now_ns, is_selected=bool(selection.objects))
    journal.close()


class ReplayedServices:
    """Runs services as tasks, and ends and starts them as they did when they were recorded."""

    def __init__(
        self, bus: Bus, clock: Clock, group: asyncio.TaskGroup, changed: dict[str, dict[str, Any]]
    ) -> None:
        """Run none yet; a service that fails ends `group`. By service, `changed` replaces parameters."""
        self._bus = bus
        self._clock = clock
        self._group = group
        self._changed = changed
        self._running: dict[str, tuple[Configuration, asyncio.Task[None]]] = {}

    async def start(self, configuration: Configuration) -> None:
        """Start the service of `configuration`, in place of the one that runs under its name.

        The same configuration again is the same service, which goes on.

        Raises:
            ReplayError: The service is not installed, or cannot use the configuration.
        """
        running = self._running.get(configuration.instance)
        if running is not None and running[0] == configuration:
            return
        await self.end(configuration.instance)
        launch = self._launch(configuration)
        task = self._group.create_task(run_service(launch, self._bus, self._clock), name=launch.instance)
        self._running[launch.instance] = configuration, task
        await asyncio.sleep(0)  # its constructor declares what it reads before the next entry is put

    async def end(self, instance: str) -> None:
        """End the service called `instance`, if it runs."""
        running = self._running.pop(instance, None)
        if running is not None:
            running[1].cancel()
            await asyncio.wait([running[1]])

    async def end_all(self) -> None:
        """End all, the first started last."""
        for instance in reversed(list(self._running)):
            await self.end(instance)

    def _launch(self, configuration: Configuration) -> Launch:
        name = configuration.service
        instance = configuration.instance
        try:
            row = registry.process(name)
            service = row.load()
            recorded = parameters_of(configuration)
            if gone := remove_unknown(recorded, service.CONFIG):
                log.warning(
                    "%s runs without %s: this version has no such parameters", instance, ", ".join(gone)
                )
            layers = Layers()
            layers.add({**recorded, **self._changed.get(name, {})}, f"recorded configuration of {instance}")
            config = layers.build(service.CONFIG)
        except KeyError as error:
            raise ReplayError(f"{instance} cannot be replayed: {error.args[0]}") from error
        except (ConfigError, ValueError) as error:
            raise ReplayError(f"{instance} cannot be replayed with this version: {error}") from error
        if isinstance(config, PuiConfig) and config.map_to_read and "map" not in self._changed.get(name, {}):
            check_map(config.map_to_read)
        which = "" if configuration.user else split_instance(instance)[1]
        return Launch(service=service, config=config, user=configuration.user, name=which, plugin=row.label)


def remove_unknown(parameters: dict[str, Any], kind: type[Config]) -> list[str]:
    """Remove the parameters that this version has no longer, at any depth. Return their dotted names."""
    gone: list[str] = []
    while True:  # a service with plug-ins tells its own ones after those of its sections, one at a time
        try:
            validate(kind, parameters)
        except ValidationError as error:
            paths = [each["loc"] for each in error.errors() if each["type"] == "extra_forbidden"]
        else:
            return gone
        if not paths:
            return gone
        for path in paths:
            values: Any = parameters
            for part in path[:-1]:  # a path also names the kind of a value where there are several
                values = values[part] if isinstance(values, list) or part in values else values
            del values[path[-1]]
        gone += [".".join(str(part) for part in path) for path in paths]


def parameters_of(configuration: Configuration) -> dict[str, Any]:
    """Return the recorded parameters.

    Raises:
        ValueError: They are no JSON mapping.
    """
    parameters: object = json.loads(configuration.parameters)
    if not isinstance(parameters, dict):
        raise ValueError("its parameters are no mapping")  # noqa: TRY004 - of a file, like what JSON raises
    return cast("dict[str, Any]", parameters)


@asynccontextmanager
async def scratch_folder() -> AsyncGenerator[Path]:
    """Yield an empty folder, which is removed once no thread of a service writes there any more."""
    loop = asyncio.get_running_loop()
    threads = ThreadPoolExecutor()
    with tempfile.TemporaryDirectory(prefix="pointit-replay-") as folder:
        loop.set_default_executor(threads)
        try:
            yield Path(folder)
        finally:
            loop.set_default_executor(ThreadPoolExecutor())
            threads.shutdown()
