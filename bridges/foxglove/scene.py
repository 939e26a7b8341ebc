"""The scene, in parts that a viewer can show and hide."""

from collections.abc import Mapping
from typing import Any, Literal

from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    PointCloud,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
)

from pointit.bridges.foxglove import people, shapes
from pointit.bridges.foxglove.objects import ObjectOwnership, ObjectRenderer
from pointit.bridges.foxglove.people import NO_PROFILE, DrawnPerson
from pointit.bridges.foxglove.pixels import Pixels
from pointit.bridges.foxglove.robots import robot, waypoints
from pointit.bridges.foxglove.room import Lines, bays, lamps, room
from pointit.bridges.foxglove.shapes import NamedEntity
from pointit.plugins import Change, SiteState
from pointit.schemas import Environment, Goal, Hover, Message, topics
from pointit.schemas.base import Rgb
from pointit.schemas.topics import Topic
from pointit.site.site_state import M

Part = Literal["room", "pixels", "lamps", "bays", "objects", "robots", "people", "frames"]
Picture = SceneUpdate | PointCloud | FrameTransforms

PARTS: tuple[Part, ...] = ("room", "pixels", "lamps", "bays", "objects", "robots", "people", "frames")

DRAWN: Mapping[Topic[Any], tuple[Part, ...]] = {
    topics.MAP: ("room", "pixels", "lamps", "bays", "objects"),
    topics.STRIPS_FRAME: ("pixels",),
    topics.LAMP_COLOR: ("lamps",),
    topics.CONVEYOR_STATE: ("bays",),
    topics.OBJECTS: ("objects",),
    topics.SELECTION: ("objects",),
    topics.HOVER: ("objects",),
    topics.ROBOT_STATE: ("robots",),
    topics.ROBOT_PLAN: ("robots",),
    topics.STEERING: ("robots",),
    topics.PROFILE: ("people", "objects", "robots"),
    topics.POSE: ("people", "frames"),
    topics.CURSOR: ("people",),
    topics.GOAL: ("people",),
}
"""Parts to be drawn again for a new message of each topic."""
FORGET_S = 1.0
"""Rays, hovers, objects and robots without a message for this long are removed, s."""
EXPIRING = (topics.CURSOR, topics.HOVER, topics.OBJECTS, topics.ROBOT_STATE)
"""Topics whose messages are drawn for a limited time."""


class FoxgloveScene:
    """Draws a site; `changed` are the parts to be drawn again."""

    def __init__(self, site: SiteState) -> None:
        """Begin with an empty room."""
        self._site = site
        self.changed: set[Part] = set()
        self._fresh: dict[Topic[Any], set[str]] = {topic: set() for topic in EXPIRING}
        """Names of messages that have not expired."""
        self._goals: dict[str, Goal] = {}
        """Last goals to which people sent a robot."""
        self._is_lit = False
        self._names: dict[Part, set[str]] = {}
        self._set_room(Environment(stamp_ns=0, name=""))

    @property
    def problems(self) -> list[str]:
        """Return a message for each part of the map that cannot be drawn."""
        return self._lines.problems

    def show(self, change: Change) -> None:
        """Update the parts that depend on a change of the site."""
        topic = change.topic
        name = change.name
        message = change.message
        if topic in EXPIRING and message is not None:
            self._fresh[topic].add(name)
        elif topic in EXPIRING:
            self._fresh[topic].discard(name)
        if isinstance(message, Environment):
            self._set_room(message)
        elif isinstance(message, Goal):
            self._goals[name] = message
        elif topic is topics.STRIPS_FRAME:
            self._is_lit = False
        elif topic is topics.ROBOT_STATE and None in (message, change.previous):
            self.changed.add("objects")  # of which it is one no longer, or again
        is_on_object = _is_on_object(message) or _is_on_object(change.previous)
        if topic is not topics.HOVER or is_on_object:
            self.changed.update(DRAWN.get(topic, ()))

    def forget(self, now_s: float) -> None:
        """Remove rays, hovers, objects and robots that are too old at `now_s`, the site state's time."""
        for topic, names in self._fresh.items():
            expired: set[str] = set()
            for name in names:
                received_s = self._site.received_s(topic, name) or 0.0
                if now_s - received_s > FORGET_S:
                    expired.add(name)
            if not expired:
                continue
            names.difference_update(expired)
            self.changed.update(DRAWN[topic])
            if topic is topics.ROBOT_STATE:
                self.changed.add("objects")  # of which it is one again

    @property
    def is_moving(self) -> bool:
        """Return True if something that expires is shown."""
        return any(self._fresh.values())

    def leave(self, user: str) -> None:
        """Forget the goal of a person who has left."""
        self._goals.pop(user, None)
        self.changed.add("people")

    def draw(self, part: Part, now_ns: int) -> Picture:
        """Return `part` as a whole, so that new viewers see all of it."""
        self.changed.discard(part)
        if part == "pixels":
            frame = self._site.get(topics.STRIPS_FRAME)
            if frame is not None and not self._is_lit:
                self._pixels.light(frame)
                self._is_lit = True
            return self._pixels.cloud(now_ns)
        if part == "frames":
            poses = self._site.all(topics.POSE)
            transforms: list[FrameTransform] = []
            for user, pose in poses.items():
                transforms.append(people.transform(user, pose, now_ns))
            return FrameTransforms(transforms=transforms)
        return self._update(part, self._entities(part, now_ns), now_ns)

    def _entities(self, part: Part, now_ns: int) -> list[NamedEntity]:
        """Return the entities of a part that consists of them."""
        site = self._site
        if part == "room":
            return room(self._map, self._lines, now_ns)
        if part == "lamps":
            lamp_colors = site.all(topics.LAMP_COLOR)
            return lamps(self._map.lamps, lamp_colors, now_ns)
        if part == "bays":
            state = site.get(topics.CONVEYOR_STATE)
            return bays(self._map, self._lines, state, now_ns)

        # People, in whose colours all else is drawn that they steer, select or hover
        drawn_people = self._drawn_people()
        if part == "people":
            entities: list[NamedEntity] = []
            for user, person in sorted(drawn_people.items()):
                entities += people.entities(user, person, now_ns)
            return entities
        colors = {user: person.color for user, person in drawn_people.items()}
        if part == "robots":
            return self._robots(colors, now_ns)
        return self._objects(colors, now_ns)

    def _drawn_people(self) -> dict[str, DrawnPerson]:
        """Return all people with a message that is drawn."""
        poses = self._site.all(topics.POSE)
        cursors = self._unexpired(topics.CURSOR)
        profiles = self._site.all(topics.PROFILE)
        drawn: dict[str, DrawnPerson] = {}
        for user in {*profiles, *poses, *cursors, *self._goals}:
            drawn[user] = DrawnPerson(
                profile=profiles.get(user, NO_PROFILE),
                pose=poses.get(user),
                cursor=cursors.get(user),
                goal=self._goals.get(user),
            )
        return drawn

    def _robots(self, colors: Mapping[str, Rgb], now_ns: int) -> list[NamedEntity]:
        plans = self._site.all(topics.ROBOT_PLAN)
        entities: list[NamedEntity] = []
        for name, state in self._unexpired(topics.ROBOT_STATE).items():
            plan = plans.get(name)
            entities.append(robot(name, state, plan, colors, now_ns))
        for user, steering in self._site.all(topics.STEERING).items():
            if steering.waypoints_m:
                rgb = colors.get(user, shapes.WHITE)
                entities.append(waypoints(user, steering, rgb, now_ns))
        return entities

    def _objects(self, colors: Mapping[str, Rgb], now_ns: int) -> list[NamedEntity]:
        robots = self._unexpired(topics.ROBOT_STATE)  # drawn on their own
        selection = self._site.get(topics.SELECTION)
        ownership = ObjectOwnership.of(selection, self._unexpired(topics.HOVER))
        entities: list[NamedEntity] = []
        for tracker, tracked in self._unexpired(topics.OBJECTS).items():
            objects = [item for item in tracked.objects if item.id not in robots]
            entities += self._renderer.entities(tracker, objects, ownership, colors, now_ns)
        return entities

    def _unexpired(self, topic: Topic[M]) -> dict[str, M]:
        """Return the messages of `topic` that have not expired, by name."""
        names = self._fresh[topic]
        return {name: message for name, message in self._site.all(topic).items() if name in names}

    def _update(self, part: Part, entities: list[NamedEntity], now_ns: int) -> SceneUpdate:
        """Return `entities` and deletions of what was drawn before and is missing from it."""
        names = {entity.name for entity in entities}
        previous = self._names.get(part, set())
        deleted = sorted(previous - names)
        self._names[part] = names
        kind = SceneEntityDeletionType.MatchingId
        if part == "room":  # without a lifetime: a viewer that missed a deletion must not keep it
            deleted = [""]
            kind = SceneEntityDeletionType.All
        at = shapes.timestamp(now_ns)
        deletions = [SceneEntityDeletion(timestamp=at, type=kind, id=name) for name in deleted]
        return SceneUpdate(deletions=deletions, entities=[entity.entity for entity in entities])

    def _set_room(self, environment: Environment) -> None:
        self._map = environment
        self._lines = Lines(environment)
        self._renderer = ObjectRenderer(self._lines)
        self._pixels = Pixels(self._lines.strips)
        self._is_lit = False


def _is_on_object(hover: Message | None) -> bool:
    return isinstance(hover, Hover) and bool(hover.object_id)
