"""Subscribes to objects and to rays, poses and interactions of people; publishes the map and cursors.

The default instance publishes the map, and cursors of all people whom no shard serves. A shard publishes
those of its people.
"""

import asyncio
import functools
import math
from pathlib import Path
from typing import ClassVar, NamedTuple

from pointit.maps.file import load_map_and_clouds, shipped_maps
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import sleep
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.service.people_share import PeopleShare
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    Cursor,
    Done,
    Environment,
    Interaction,
    PointingRay,
    SetTolerance,
    SetToleranceReply,
    SetWorkspace,
    TrackedObjects,
    UseMap,
    UseMapReply,
    UserPose,
    topics,
)
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.cursor import NearbyLamps, PersonCursor
from pointit.services.pui.surfaces import Clouds, Surfaces, group_by_priority
from pointit.services.pui.tracked_objects import PERIOD_S, TRACKER, DuplicateFinder, Tracked, listing
from pointit.services.pui.workspace import WorkspaceError, WorkspaceStart

WIDEST_RAD = 1.569
"""Limit of the tolerance in a reply. The configured one can be up to 90 degrees."""


class _Room(NamedTuple):
    """A map as people point at it."""

    surfaces: Surfaces
    lamps: NearbyLamps | None
    tracked: Tracked


class Pui(Service[PuiConfig]):
    """Turns people's pointing rays into cursors on the things of the room."""

    NAME: ClassVar[str] = "pui"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = PuiConfig
    SEVERAL: ClassVar[bool] = True
    SHARDS: ClassVar[bool] = True
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: PuiConfig, context: Context) -> None:
        super().__init__(config, context)
        self._share = PeopleShare(self.bus, self.NAME, config.people, name=self.name, lost=self._on_lost)
        self._start = WorkspaceStart(
            kind=None if config.workspace == "none" else config.workspace, height_m=config.workspace_height_m
        )
        self._duplicate_finder = DuplicateFinder()
        self._persons: dict[str, PersonCursor] = {}
        self._cursors = functools.cache(functools.partial(self.bus.publisher, topics.CURSOR))
        self._cues = functools.cache(functools.partial(self.bus.publisher, topics.FEEDBACK))
        self._maps = functools.cache(functools.partial(self.bus.publisher, topics.MAP))
        empty_environment = Environment(stamp_ns=0, name="")
        self._room = _Room(Surfaces(empty_environment, may_be_empty=True), None, Tracked(empty_environment))

        # the map: read from a file by the default instance, taken from the site by a shard
        self._has_map = bool(config.map_to_read)
        """False in a shard while the site has no map at which its people can point."""
        self._map_came = asyncio.Event()
        self._environment = empty_environment
        self._map = _full_name(config.map_to_read)
        if config.map_to_read:
            environment, clouds = load_map_and_clouds(config.map_to_read, self.clock.now_ns())
            try:
                self._room = self._make_room(environment, clouds)
            except ValueError as error:
                raise ConfigError(f"pui: {error}") from error
            if not config.people:
                self._maps().put(environment)
                self._environment = environment
        else:
            self.bus.subscribe(topics.MAP, self._on_map)

        # requests before messages: a client that sees a cursor may ask at once
        self._share.serve(topics.SET_WORKSPACE, self._on_workspace)
        if not config.people:
            self.bus.serve(topics.SET_TOLERANCE, self._on_tolerance)
            self.bus.serve(topics.USE_MAP, self._on_use_map)
        self.bus.set_metric("default tolerance", config.tolerance_deg, "°")
        self.bus.subscribe(topics.OBJECTS, self._on_objects)
        self._share.subscribe(topics.POSE, self._on_pose)
        self._share.subscribe(topics.INTERACTION, self._on_interaction)
        self._share.subscribe(topics.RAY, self._on_ray, drops_late=bool)  # all: a message is true
        self.bus.watch(topics.USER_ALIVE, self._on_presence)

    @classmethod
    def validate_config(cls, config: PuiConfig) -> None:
        """Check that the map is valid and has something to point at."""
        if not config.map_to_read:
            return
        environment, clouds = load_map_and_clouds(config.map_to_read, 0)
        try:
            group_by_priority(
                environment, config.surfaces, clouds, config.priority, may_be_empty=config.workspace != "none"
            )
        except ValueError as error:
            raise ConfigError(str(error)) from error

    async def run(self) -> None:
        """Serve the people of a shard as long as there is a map; list the things of the site's map."""
        object_publisher: Publisher[TrackedObjects] | None = None
        room = self._environment
        things = listing(self._environment, 0)
        while True:
            # once things were listed it goes on with empty lists: silence would look like a dead tracker
            while object_publisher is not None or self._environment.fixed_things:
                if object_publisher is None:
                    object_publisher = self.bus.publisher(topics.OBJECTS, TRACKER)
                if room is not self._environment:
                    room = self._environment
                    things = listing(self._environment, 0)
                object_publisher.put(things.model_copy(update={"stamp_ns": self.clock.now_ns()}))
                await sleep(self.clock, PERIOD_S)
            self._map_came.clear()
            if self._has_map:
                await self._share.announce()
            else:
                self._share.withdraw()
            await self._map_came.wait()

    def _make_room(self, environment: Environment, clouds: Clouds) -> _Room:
        """Return the room of a map.

        Raises:
            ValueError: If there is nothing to point at, or clouds are missing.
        """
        config = self.config
        surfaces = Surfaces(
            environment,
            config.surfaces,
            tolerance_rad=math.radians(config.tolerance_deg),
            clouds=clouds,
            priority=config.priority,
            opaque=config.opaque,
            may_be_empty=config.workspace != "none",
        )
        within_rad = math.radians(config.lamp_angles_deg)
        lamps = NearbyLamps(environment.lamps, within_rad) if within_rad else None
        return _Room(surfaces, lamps, Tracked(environment))

    def _enter(self, room: _Room) -> None:
        """Replace the map by `room`. All users point at its things from now on."""
        self._room = room
        for person in self._persons.values():
            person.change_map(room.surfaces, room.lamps)

    def _on_map(self, environment: Environment, _name: str) -> None:
        """Use the site's map in a shard. If it is unusable, the default pui serves the shard's users."""
        self._map_came.set()
        self._has_map = True
        problem = ""
        try:
            if "points" in self.config.surfaces and environment.clouds:
                raise ValueError(  # noqa: TRY301 - told like the others
                    f"map {environment.name!r} has point clouds, which no message carries; give this "
                    "instance the file of the map, too (parameter map)"
                )
            self._enter(self._make_room(environment, {}))
        except ValueError as error:
            self._has_map = False
            problem = f"{error}; until then the site's pui serves {', '.join(self.config.people)}"
        self.bus.warn("map", problem)

    def _person(self, user: str) -> PersonCursor:
        person = self._persons.get(user)
        if person is None:
            room = self._room
            person = PersonCursor(room.surfaces, lamps=room.lamps, start=self._start)
            self._persons[user] = person
        return person

    def _on_lost(self, user: str) -> None:
        self._persons.pop(user, None)
        self.bus.clear("no-pose", user)
        self.bus.clear("misses", user)

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        self._room.tracked.on_objects(tracker, objects)
        if self.config.people:
            return
        self._duplicate_finder.on_objects(tracker, objects)
        sentence = ""
        duplicates = self._duplicate_finder.duplicates
        if duplicates:
            sentence = duplicates[0].sentence
        if len(duplicates) > 1:
            track = advised_commands().command("pointit track")
            sentence += f" ({len(duplicates) - 1} more: {track})"
        self.bus.warn("duplicate-objects", sentence)

    async def _on_workspace(self, query: SetWorkspace, user: str) -> Done:
        person = self._persons.get(user)
        if person is None:
            raise RefusedError(f"{user}: neither a pose nor a ray has come: start their services first")
        try:
            person.set_workspace(query, self._room.tracked)
        except WorkspaceError as error:
            raise RefusedError(f"{user}: {error}") from error
        if query.kind == "none":
            return Done(message=f"{user} points at the things of the map")
        return Done(message=f"{user}'s cursor moves on a {query.kind} workspace")

    async def _on_use_map(self, query: UseMap, _name: str) -> UseMapReply:
        if query.path:
            # beside the loop: people go on pointing while a large map is read
            environment, room = await asyncio.to_thread(self._read_room, self._map_file(query.path))
            room.surfaces.tolerance_rad = self._room.surfaces.tolerance_rad
            self._enter(room)
            self._map = _full_name(query.path)
            self._environment = environment
            self._maps().put(environment)
            self._map_came.set()
        return UseMapReply(message=f"people point at the map {self._map}", path=self._map)

    def _map_file(self, name_or_path: str) -> str:
        """Return `name_or_path` if it is a shipped map, or a YAML file in the folder of this run's first map.

        Raises:
            RefusedError: If it is neither. Operators must not read other files of this machine.
        """
        if name_or_path in shipped_maps():
            return name_or_path
        path = Path(name_or_path).resolve()
        first_map = self.config.map_to_read
        folder = Path.cwd()
        if first_map not in ("", *shipped_maps()):
            folder = Path(first_map).resolve().parent
        is_yaml = path.suffix in (".yaml", ".yml")
        if is_yaml and path.is_relative_to(folder) and path.is_file():
            return name_or_path
        raise RefusedError(f"{name_or_path}: is not a YAML file in {folder}, the folder of this run's maps")

    def _read_room(self, name_or_path: str) -> tuple[Environment, _Room]:
        """Return the map of that name or path, and its room.

        Raises:
            ConfigError: If it is invalid.
            RefusedError: If there is nothing to point at.
        """
        environment, clouds = load_map_and_clouds(name_or_path, self.clock.now_ns())
        try:
            return environment, self._make_room(environment, clouds)
        except ValueError as error:
            raise RefusedError(str(error)) from error

    async def _on_tolerance(self, query: SetTolerance, _name: str) -> SetToleranceReply:
        surfaces = self._room.surfaces
        if query.tolerance_rad is not None:
            surfaces.tolerance_rad = query.tolerance_rad
        tolerance_rad = surfaces.tolerance_rad
        message = f"a ray may pass what it points at by {math.degrees(tolerance_rad):.1f}°"
        return SetToleranceReply(message=message, tolerance_rad=min(tolerance_rad, WIDEST_RAD))

    def _on_pose(self, pose: UserPose, user: str) -> None:
        self._person(user).set_pose(pose, self.clock.now_ns())
        self._judge(user)

    def _on_interaction(self, interaction: Interaction, user: str) -> None:
        self._publish_cursor(self._person(user).set_interaction(interaction), user)
        self._judge(user, warn=False)

    def _on_ray(self, ray: PointingRay, user: str) -> None:
        person = self._person(user)
        cursor = person.cursor(ray)
        if cursor is None:
            self._judge(user)
        else:
            self._publish_cursor(cursor, user)
            cue = person.cue()
            if cue is not None:
                self._cues(user).put(cue)
        hint = ""
        if person.passing.hint:
            calibrate = advised_commands().command(f"pointit person calibrate mounting {user}", user)
            hint = (
                f"{user} has pointed past everything for a minute ({person.passing.hint}): localize again "
                f"(hold the button); if that does not help, {calibrate}"
            )
        self.bus.warn("misses", hint, user)

    def _on_presence(self, user: str, *, present: bool) -> None:
        # their state stays: it is published once, and some of their services may still run
        person = self._persons.get(user)
        if present or person is None or not self._share.serves(user):
            return
        self._publish_cursor(person.clear(self.clock.now_ns()), user)
        self.bus.clear("no-pose", user)
        self.bus.clear("misses", user)

    def _judge(self, user: str, *, warn: bool = True) -> None:
        """Warn in health if rays of `user` give no cursor for lack of a pose."""
        if not self._person(user).lacks_pose:
            self.bus.clear("no-pose", user)
        elif warn:
            self.bus.warn(
                "no-pose",
                f"{user} points but no pose is known: start their localizer, or press the button to localize",
                user,
            )

    def _publish_cursor(self, cursor: Cursor | None, user: str) -> None:
        if cursor is not None:
            self._cursors(user).put(cursor)


def _full_name(name_or_path: str) -> str:
    """Return the name of a shipped map, or the absolute path."""
    return name_or_path if name_or_path in shipped_maps() else str(Path(name_or_path).resolve())


SERVICE = Pui
