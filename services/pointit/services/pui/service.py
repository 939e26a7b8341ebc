"""Subscribes to objects and all people's rays, poses and interactions; publishes the map and all cursors."""

import math
from typing import ClassVar

from pointit.maps.file import load_map_and_clouds
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    Cursor,
    Done,
    Feedback,
    Interaction,
    PointingRay,
    SetTolerance,
    SetToleranceReply,
    SetWorkspace,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.topics import (
    CURSOR,
    FEEDBACK,
    INTERACTION,
    MAP,
    OBJECTS,
    POSE,
    RAY,
    SET_TOLERANCE,
    SET_WORKSPACE,
    USER_ALIVE,
)
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.nearby_lamps import NearbyLamps
from pointit.services.pui.shapes import group_by_priority
from pointit.services.pui.surfaces import Surfaces
from pointit.services.pui.tracked import Tracked
from pointit.services.pui.twin_objects import TwinFinder
from pointit.services.pui.workspace import WorkspaceError
from pointit.services.pui.workspace_start import WorkspaceStart

WIDEST_RAD = 1.569
"""Limit of the tolerance in a reply. The configured one can be up to 90 degrees."""


class Pui(Service[PuiConfig]):
    """Turns all people's pointing rays into cursors on the things of the room."""

    NAME: ClassVar[str] = "pui"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = PuiConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: PuiConfig, context: Context) -> None:
        super().__init__(config, context)
        environment, clouds = load_map_and_clouds(config.map, self.clock.now_ns())
        try:
            self._surfaces = Surfaces(
                environment,
                config.surfaces,
                method=config.method,
                tolerance_rad=math.radians(config.tolerance_deg),
                tolerance_m=config.tolerance_m,
                step_m=config.kd_step_m,
                reach_m=config.kd_reach_m,
                clouds=clouds,
                priority=config.priority,
                opaque=config.opaque,
                grazing_rad=math.radians(config.grazing_deg),
                may_be_empty=config.workspace != "none",
            )
        except ValueError as error:
            raise ConfigError(f"pui: {error}") from error
        self._lamps = NearbyLamps(environment.lamps, math.radians(config.lamp_angles_deg))
        self._start = WorkspaceStart(
            kind=None if config.workspace == "none" else config.workspace,
            height_m=config.workspace_height_m,
            distance_m=config.workspace_distance_m,
            grazing_rad=math.radians(config.grazing_deg),
        )
        self._tracked = Tracked(environment)
        self._twins = TwinFinder()
        self._persons: dict[str, PersonCursor] = {}
        self._cursors: dict[str, Publisher[Cursor]] = {}
        self._cues: dict[str, Publisher[Feedback]] = {}
        self.bus.publisher(MAP).put(environment)
        self.bus.serve(SET_WORKSPACE, self._on_workspace)
        self.bus.serve(SET_TOLERANCE, self._on_tolerance)
        self.bus.subscribe(OBJECTS, self._on_objects)
        self.bus.subscribe(POSE, self._on_pose)
        self.bus.subscribe(INTERACTION, self._on_interaction)
        self.bus.subscribe(RAY, self._on_ray, drops_late=lambda _ray: True)
        self.bus.watch(USER_ALIVE, self._on_presence)

    @classmethod
    def validate_config(cls, config: PuiConfig) -> None:
        """Check that the map is valid and has something to point at."""
        environment, clouds = load_map_and_clouds(config.map, 0)
        try:
            group_by_priority(
                environment,
                config.surfaces,
                clouds,
                config.priority,
                math.radians(config.grazing_deg),
                may_be_empty=config.workspace != "none",
            )
        except ValueError as error:
            raise ConfigError(str(error)) from error

    def _person(self, user: str) -> PersonCursor:
        person = self._persons.get(user)
        if person is None:
            lamps = self._lamps if self.config.lamp_angles_deg else None
            person = self._persons[user] = PersonCursor(self._surfaces, lamps=lamps, start=self._start)
        return person

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        self._tracked.on_objects(tracker, objects)
        self._twins.on_objects(tracker, objects)
        twins = self._twins.twins
        more = f" ({len(twins) - 1} more: `pointit track`)" if len(twins) > 1 else ""
        self.bus.warn("objects of two trackers", f"{twins[0].sentence}{more}" if twins else "")

    async def _on_workspace(self, query: SetWorkspace, user: str) -> Done:
        person = self._persons.get(user)
        if person is None:
            raise RefusedError(f"{user}: neither a pose nor a ray has come: start their services first")
        try:
            person.set_workspace(query, self._tracked)
        except WorkspaceError as error:
            raise RefusedError(f"{user}: {error}") from error
        if query.kind == "none":
            return Done(message=f"{user} points at the things of the map")
        return Done(message=f"{user}'s cursor moves on a {query.kind} workspace")

    async def _on_tolerance(self, query: SetTolerance, _name: str) -> SetToleranceReply:
        surfaces = self._surfaces
        if query.tolerance_rad is not None:
            try:
                surfaces.set_tolerance(query.tolerance_rad)
            except ValueError as error:
                raise RefusedError(f"{error} here: {self._by_metres()}") from error
        tolerance_rad = surfaces.tolerance_rad
        if tolerance_rad is None:
            return SetToleranceReply(message=f"the tolerance is in metres: {self._by_metres()}")
        return SetToleranceReply(
            message=f"a ray may pass what it points at by {math.degrees(tolerance_rad):.1f}°",
            tolerance_rad=min(tolerance_rad, WIDEST_RAD),
        )

    def _by_metres(self) -> str:
        """Return the reason for which no angle can be set."""
        if self.config.method == "kd_tree":
            return "the method is kd_tree; start pui with method=exact to have an angle"
        return f"tolerance_m is {self.config.tolerance_m}; start pui without it to have an angle"

    def _on_pose(self, pose: UserPose, user: str) -> None:
        self._person(user).set_pose(pose, self.clock.now_ns())
        self._judge(user)

    def _on_interaction(self, interaction: Interaction, user: str) -> None:
        self._put(self._person(user).set_interaction(interaction), user)
        self._judge(user, warn=False)

    def _on_ray(self, ray: PointingRay, user: str) -> None:
        person = self._person(user)
        cursor = person.cursor(ray)
        if cursor is None:
            self._judge(user)
        else:
            self._put(cursor, user)
            cue = person.cue()
            if cue is not None:
                self._cue(cue, user)

    def _on_presence(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        # their state stays: it is published once, and some of their services may still run
        person = self._persons.get(user)
        if person is not None and not present:
            self._put(person.clear(self.clock.now_ns()), user)
            self.bus.clear(f"pose of {user}")

    def _judge(self, user: str, *, warn: bool = True) -> None:
        """Warn in health if rays of `user` give no cursor for lack of a pose."""
        if not self._person(user).lacks_pose:
            self.bus.clear(f"pose of {user}")
        elif warn:
            self.bus.warn(
                f"pose of {user}",
                f"{user} points but no pose is known: start their localizer, or press the button to localize",
            )

    def _cue(self, cue: Feedback, user: str) -> None:
        publisher = self._cues.get(user)
        if publisher is None:
            publisher = self._cues[user] = self.bus.publisher(FEEDBACK, user)
        publisher.put(cue)

    def _put(self, cursor: Cursor | None, user: str) -> None:
        if cursor is None:
            return
        publisher = self._cursors.get(user)
        if publisher is None:
            publisher = self._cursors[user] = self.bus.publisher(CURSOR, user)
        publisher.put(cursor)


SERVICE = Pui
