"""Services of a recording that run again, with their configuration, map, state and clock."""

import asyncio
import json
import logging
import math
import re
import tempfile
from collections.abc import AsyncGenerator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, assert_never, cast

from pydantic import ValidationError

from pointit.maps.file import shipped_maps
from pointit.maps.model import OBJECT
from pointit.recording.entries import AnyRow, Entry
from pointit.runtime.bus.contract import AnyTopic, Bus
from pointit.runtime.clock import Clock
from pointit.runtime.config.config import Config, Layers, validate
from pointit.runtime.config.yaml_edit import dump_yaml
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.runtime.machine import this_machine
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import (
    NS_PER_S,
    Belt,
    BeltLink,
    Box,
    ClockTick,
    Configuration,
    Cylinder,
    Environment,
    Feedback,
    Interaction,
    Message,
    Plane,
    PointingOffset,
    Selection,
    SelectionEvent,
    SetPose,
    Sphere,
    Strip,
    Thing,
    UserPose,
    UserProfile,
    topics,
)
from pointit.schemas.environment import Fence, Frame
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
        """Start now at `start_ns`, Unix ns, and run `speed` times as fast as the loop."""
        self.speed = speed
        self._start_ns = start_ns
        self._loop = asyncio.get_running_loop()
        self._began_s = self._loop.time()
        self._burst = 0
        """Number of calls of `wait_until` in a row that had nothing to wait for."""

    def now_ns(self) -> int:
        """Return the time in the recording, Unix ns."""
        passed_s = self._loop.time() - self._began_s
        return self._start_ns + round(passed_s * self.speed * NS_PER_S)

    def tick(self) -> ClockTick:
        """Return the tick by which other processes follow."""
        return ClockTick(stamp_ns=this_machine().now_ns(), sim_ns=self.now_ns(), speed=self.speed)

    async def wait_until(self, time_ns: int) -> None:
        """Wait until the recording's time is `time_ns`.

        Return at once if it has passed, but let others run after `MAX_BURST` such calls.
        """
        wait_s = (time_ns - self.now_ns()) / NS_PER_S / self.speed
        if wait_s > 0.0 or self._burst >= MAX_BURST:
            self._burst = 0
        else:
            self._burst += 1
        if self._burst == 0:
            await asyncio.sleep(max(wait_s, 0.0))


class ReplayError(PointItError):
    """A recording cannot be replayed; the message has the reason and the remedy."""


def is_about_site(row: AnyRow, name: str) -> bool:
    """Return True if `row` of `name` shows who runs or watches a site, not what happens there."""
    if row in (topics.SERVICE_ALIVE, *topics.ACCOUNTS):
        service, _ = split_instance(name)
        return service in OBSERVERS
    return row is topics.DEPLOYMENT


class Split:
    """Division of a recording: entries that are recomputed, and its edge, which comes from the file."""

    def __init__(self, level: Level, recorded: Iterable[str]) -> None:
        """Choose among the `recorded` instances, such as `selector` and `pointing.anna`.

        Raises:
            ReplayError: None of the services of `level` is among them.
        """
        names = SERVICES[level]
        self._names = names
        instances: list[str] = []
        for instance in recorded:
            service, _ = split_instance(instance)
            if service in names:
                instances.append(instance)
        self.instances = frozenset(instances)
        """Instances that run again."""
        if not self.instances:
            services = ", ".join(names)
            raise ReplayError(
                f"the recording has no configuration of any service that --from {level} replays "
                f"({services}): none ran, it was imported, or its beginning is damaged; "
                "`pointit export` and `pointit page` read it all the same"
            )

    def is_recomputed(self, entry: Entry) -> bool:
        """Return True if a service that runs again writes what `entry` says."""
        row = entry.row
        match row:
            case topics.Presence():
                if row is topics.SHARD_ALIVE:
                    return self.runs(*split_instance(entry.name))
                return row is topics.SERVICE_ALIVE and entry.name in self.instances
            case topics.Request():
                return self.runs(row.server, entry.name)
            case topics.Topic():
                return self._is_message_recomputed(entry, row)
            case _:
                assert_never(row)

    def _is_message_recomputed(self, entry: Entry, row: topics.Topic[Any]) -> bool:
        body = entry.body
        if row in (topics.CONFIGURATION, topics.HEALTH, topics.SERVED):
            return entry.name in self.instances

        # Topics that several write: the message tells which one has
        if row is topics.SELECTION_EVENTS:
            if isinstance(body, SelectionEvent) and body.event in OF_TRACKERS:
                return False
        elif row is topics.POSE:
            if isinstance(body, UserPose) and body.method == "external":
                return False
        elif row is topics.FEEDBACK:
            if isinstance(body, Feedback) and body.cue in OF_SELECTOR:
                return self.runs("selector", "")
            return self.runs("supervisor", entry.name)
        return any(self.runs(writer, entry.name) for writer in _writers(row, entry.name))

    def rank(self, instance: str) -> int:
        """Return the place of a service in the order of starts."""
        service, _ = split_instance(instance)
        if service not in self._names:
            return len(self._names)
        return self._names.index(service)

    def runs(self, service: str, name: str) -> bool:
        """Return True if `service` runs again, for the person `name` if it is one of a person."""
        return service in self.instances or instance_of(service, name) in self.instances


def _writers(row: topics.Topic[Any], name: str) -> Iterable[str]:
    """Return the services that write `name` of a topic: `pui` lists the things of the map alone."""
    if row is not topics.OBJECTS:
        return row.writers
    if name == TRACKER:
        return ("pui",)
    return (writer for writer in row.writers if writer != "pui")


def write_room(room: Environment, folder: Path) -> Path | None:
    """Write `room` as a map file of its name into `folder` and return the path.

    Characters of the name that could lead out of `folder` are replaced. Return None if `room` has point
    clouds, whose points are not in the message.
    """
    if room.clouds:
        return None
    safe_name = _UNSAFE.sub("_", room.name)[:MAX_NAME]
    path = folder / f"{safe_name or 'map'}.yaml"
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
    """Return the sections of a map's file, without empty ones; docs/reference/maps.md describes them."""
    sections: dict[str, Any] = {}
    sections["lamps"] = {lamp.id: {"position": list(lamp.position_m)} for lamp in room.lamps}
    sections["strips"] = {strip.id: _strip(strip) for strip in room.strips}

    # Conveyors
    sections["belts"] = {belt.id: _belt(belt) for belt in room.belts}
    sections["links"] = [_link(link) for link in room.links]
    sections["bays"] = {bay.id: bay.belt for bay in room.bays}

    # Frames, solids and fences
    sections["frames"] = {frame.id: _frame(frame) for frame in room.frames}
    sections["boxes"] = {box.id: _box(box) for box in room.boxes}
    sections["planes"] = {plane.id: _plane(plane) for plane in room.planes}
    sections["cylinders"] = {cylinder.id: _cylinder(cylinder) for cylinder in room.cylinders}
    sections["spheres"] = {sphere.id: _sphere(sphere) for sphere in room.spheres}
    sections["fences"] = {fence.id: _fence(fence) for fence in room.fences}

    sections["things"] = {thing.id: _thing(thing) for thing in room.things}
    return {name: entries for name, entries in sections.items() if entries}


def _strip(strip: Strip) -> dict[str, object]:
    return {"line": _line(strip.line_m), "pixels": strip.pixels, "direction": strip.direction}


def _belt(belt: Belt) -> dict[str, object]:
    return {"centerline": _line(belt.line_m), "width": belt.width_m}


def _link(link: BeltLink) -> dict[str, object]:
    entry: dict[str, object] = {"from": link.source, "to": link.target}
    if link.source_position_m is not None:
        entry["from_position"] = link.source_position_m
    entry["to_position"] = link.target_position_m
    return entry


def _frame(frame: Frame) -> dict[str, object]:
    return {"position": list(frame.position_m), "orientation": list(frame.orientation_xyzw)}


def _box(box: Box) -> dict[str, object]:
    yaw_deg = math.degrees(box.yaw_rad)
    return {"center": list(box.center_m), "size": list(box.size_m), "yaw_deg": yaw_deg}


def _plane(plane: Plane) -> dict[str, object]:
    entry: dict[str, object] = {"center": list(plane.center_m), "normal": list(plane.normal)}
    if plane.size_m is not None:
        entry["size"] = list(plane.size_m)
    return entry


def _cylinder(cylinder: Cylinder) -> dict[str, object]:
    center = list(cylinder.center_m)
    return {"center": center, "radius": cylinder.radius_m, "height": cylinder.height_m}


def _sphere(sphere: Sphere) -> dict[str, object]:
    return {"center": list(sphere.center_m), "radius": sphere.radius_m}


def _fence(fence: Fence) -> dict[str, object]:
    outline = [list(corner) for corner in fence.outline_m]
    entry: dict[str, object] = {"kind": fence.kind, "outline": outline}
    if fence.low_m is not None:
        entry["low"] = fence.low_m
    if fence.high_m is not None:
        entry["high"] = fence.high_m
    return entry


def _thing(thing: Thing) -> dict[str, object]:
    entry: dict[str, object] = {"mode": thing.mode, "press": thing.press}
    if thing.is_tracked:
        entry["at"] = OBJECT
    else:
        entry |= {"center": list(thing.center_m), "size": list(thing.size_m)}
        entry["yaw_deg"] = math.degrees(thing.yaw_rad)
    if thing.strip:
        begin_m, end_m = thing.part_m
        entry["light"] = {"strip": thing.strip, "from": begin_m, "to": end_m}
    elif thing.lamp:
        entry["light"] = thing.lamp
    if thing.dwell_s is not None:
        entry["dwell_s"] = thing.dwell_s
    if thing.label:
        entry["label"] = thing.label
    return entry


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
            if not isinstance(row, Topic) or not isinstance(body, Message):
                continue
            if row is not CONFIGURATION and split.is_recomputed(entry) == recomputed:
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
            interaction = entry.body.model_copy(update={"stamp_ns": now_ns})
            StateFile(Interaction, user, LAST_WORD_PURPOSE).write(interaction)

    def measured_poses(self) -> Iterator[tuple[str, SetPose]]:
        """Yield the people whose localizers had found a pose, and the request that sets it."""
        for entry in self.retained.values():
            pose = entry.body
            if not isinstance(pose, UserPose) or pose.method == "external":
                continue
            if any(pose.covariance):
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
        if entry.key in seen:
            continue
        if not isinstance(row, Topic) or row.delivery is not Delivery.STATE:
            continue

        # Only the first entry of a state may be of the beginning: if it was put before, and came at once
        seen.add(entry.key)
        if row is MAP and isinstance(body, Environment):
            beginning.room = body
        is_early = entry.time_ns < began_ns + GATHERING_NS
        if is_early and isinstance(body, Message):
            if body.stamp_ns < began_ns:
                beginning.retained[entry.key] = entry
    return beginning


def _restore_selection(selection: Selection, site: str, now_ns: int) -> None:
    journal = Journal(site_folder(site, "selector"))
    journal.begin(now_ns)
    for number, selected in enumerate(selection.objects, 1):
        record = Record(
            selected.since_ns,
            "selected",
            selected.id,
            selected.kind,
            user=selected.user,
            owner=selected.user,
            since_ns=selected.since_ns,
            confidence=selected.confidence,
            seq=number,
        )
        journal.add(record)
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
        if running is not None:
            running_configuration, _ = running
            if running_configuration == configuration:
                return
        await self.end(configuration.instance)
        launch = self._launch(configuration)
        work = run_service(launch, self._bus, self._clock)
        task = self._group.create_task(work, name=launch.instance)
        self._running[launch.instance] = configuration, task
        await asyncio.sleep(0)  # its constructor declares what it reads before the next entry is put

    async def end(self, instance: str) -> None:
        """End the service called `instance`, if it runs."""
        running = self._running.pop(instance, None)
        if running is not None:
            _, task = running
            task.cancel()
            await asyncio.wait([task])

    async def end_all(self) -> None:
        """End all, the first started last."""
        for instance in reversed(list(self._running)):
            await self.end(instance)

    def _launch(self, configuration: Configuration) -> Launch:
        name = configuration.service
        instance = configuration.instance
        changed = self._changed.get(name, {})
        try:
            row = registry.process(name)
            service = row.load()
            recorded = parameters_of(configuration)
            removed = remove_unknown(recorded, service.CONFIG)
            if removed:
                names = ", ".join(removed)
                log.warning("%s runs without %s: this version has no such parameters", instance, names)
            layers = Layers()
            layers.add({**recorded, **changed}, f"recorded configuration of {instance}")
            config = layers.build(service.CONFIG)
        except KeyError as error:
            raise ReplayError(f"{instance} cannot be replayed: {error.args[0]}") from error
        except (ConfigError, ValueError) as error:
            raise ReplayError(f"{instance} cannot be replayed with this version: {error}") from error

        # A map that the recording names is checked before it is opened
        if isinstance(config, PuiConfig) and "map" not in changed:
            if config.map_to_read:
                check_map(config.map_to_read)
        owner = "" if configuration.user else split_instance(instance)[1]
        return Launch(service=service, config=config, user=configuration.user, name=owner, plugin=row.label)


def remove_unknown(parameters: dict[str, Any], kind: type[Config]) -> list[str]:
    """Remove the parameters that this version has no longer, at any depth. Return their dotted names."""
    removed: list[str] = []
    while True:  # a service with plug-ins reports its own ones after those of its sections, one at a time
        try:
            validate(kind, parameters)
        except ValidationError as error:
            paths = [detail["loc"] for detail in error.errors() if detail["type"] == "extra_forbidden"]
        else:
            return removed
        if not paths:
            return removed
        for path in paths:
            values: Any = parameters
            for part in path[:-1]:  # a path also names the kind of a value where there are several
                if isinstance(values, list) or part in values:
                    values = values[part]
            del values[path[-1]]
            removed.append(".".join(map(str, path)))


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
