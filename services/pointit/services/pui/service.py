"""Reads rays, poses and interactions of everyone, writes the map and everyone's cursor."""

import math
from typing import ClassVar

from pointit.runtime import ConfigError, Context, Publisher, Service
from pointit.runtime.service import Scope
from pointit.schemas import Cursor, Interaction, PointingRay, UserPose
from pointit.schemas.topics import CURSOR, INTERACTION, MAP, POSE, RAY, USER_ALIVE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.map_file import load_map
from pointit.services.pui.surfaces import Surfaces


class Pui(Service[PuiConfig]):
    """Turns everyone's pointing rays into cursors on the things of the room."""

    NAME: ClassVar[str] = "pui"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = PuiConfig

    def __init__(self, config: PuiConfig, context: Context) -> None:
        super().__init__(config, context)
        environment = load_map(config.map, self.clock.now_ns())
        try:
            self._surfaces = Surfaces(
                environment,
                config.surfaces,
                method=config.method,
                tolerance_rad=math.radians(config.tolerance_deg),
                tolerance_m=config.tolerance_m,
                step_m=config.kd_step_m,
                reach_m=config.kd_reach_m,
            )
        except ValueError as error:
            raise ConfigError(f"pui: surfaces: {error}; choose kinds that the map has") from error
        self._persons: dict[str, PersonCursor] = {}
        self._cursors: dict[str, Publisher[Cursor]] = {}
        self.bus.publisher(MAP).put(environment)
        self.bus.subscribe(POSE, self._on_pose)
        self.bus.subscribe(INTERACTION, self._on_interaction)
        self.bus.subscribe(RAY, self._on_ray)
        self.bus.watch(USER_ALIVE, self._on_presence)

    @classmethod
    def check(cls, config: PuiConfig) -> None:
        """Refuse a map that cannot be used."""
        load_map(config.map, 0)

    def _person(self, user: str) -> PersonCursor:
        person = self._persons.get(user)
        if person is None:
            person = self._persons[user] = PersonCursor(self._surfaces)
        return person

    def _on_pose(self, pose: UserPose, user: str) -> None:
        self._person(user).set_pose(pose, self.clock.now_ns())
        self._judge(user)

    def _on_interaction(self, interaction: Interaction, user: str) -> None:
        self._put(self._person(user).set_interaction(interaction), user)
        self._judge(user, warn=False)

    def _on_ray(self, ray: PointingRay, user: str) -> None:
        cursor = self._person(user).cursor(ray)
        if cursor is None:
            self._judge(user)
        else:
            self._put(cursor, user)

    def _on_presence(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        # what is known of them stays: their states come once, and some of their services may still run
        person = self._persons.get(user)
        if person is not None and not present:
            self._put(person.end(self.clock.now_ns()), user)
            self.bus.clear(f"pose of {user}")

    def _judge(self, user: str, *, warn: bool = True) -> None:
        """Say in health whether rays of `user` come to nothing for want of a pose."""
        if not self._person(user).lacks_pose:
            self.bus.clear(f"pose of {user}")
        elif warn:
            self.bus.warn(
                f"pose of {user}",
                f"{user} points but no pose is known: start their localizer, or press the button to localize",
            )

    def _put(self, cursor: Cursor | None, user: str) -> None:
        if cursor is None:
            return
        publisher = self._cursors.get(user)
        if publisher is None:
            publisher = self._cursors[user] = self.bus.publisher(CURSOR, user)
        publisher.put(cursor)


SERVICE = Pui
