"""The scene, in parts that a viewer can show and hide. Each is drawn again when it has changed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from foxglove.messages import (
    FrameTransforms,
    PointCloud,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
)

from pointit.bridges.foxglove import people, robots, shapes
from pointit.bridges.foxglove.objects import ObjectOwnership, ObjectRenderer
from pointit.bridges.foxglove.people import DrawnPerson
from pointit.bridges.foxglove.pixels import Pixels
from pointit.bridges.foxglove.room import Lines, bays, lamps, room
from pointit.bridges.foxglove.shapes import NamedEntity
from pointit.schemas import (
    ConveyorState,
    Cursor,
    Environment,
    Goal,
    Hover,
    LampColor,
    Message,
    RobotPlan,
    RobotState,
    Selection,
    Steering,
    StripsFrame,
    TrackedObjects,
    UserPose,
    UserProfile,
)
from pointit.schemas.base import Rgb

Part = Literal["room", "pixels", "lamps", "bays", "objects", "robots", "people", "frames"]
Picture = SceneUpdate | PointCloud | FrameTransforms

PARTS: tuple[Part, ...] = ("room", "pixels", "lamps", "bays", "objects", "robots", "people", "frames")

T = TypeVar("T")


@dataclass(slots=True)
class _LastMessage(Generic[T]):
    at_s: float
    message: T


class FoxgloveScene:
    """Keeps the newest of everything; `changed` are the parts to be drawn again."""

    def __init__(self, kind_colors: Mapping[str, Rgb], forget_s: float) -> None:
        """Begin with an empty room; rays and objects expire after `forget_s`."""
        self._kind_colors = kind_colors
        self._forget_s = forget_s
        self.changed: set[Part] = set()
        self._people: dict[str, DrawnPerson] = {}
        self._pointed_s: dict[str, float] = {}
        self._hovers: dict[str, _LastMessage[Hover]] = {}
        self._objects: dict[str, _LastMessage[TrackedObjects]] = {}
        self._robots: dict[str, _LastMessage[RobotState]] = {}
        self._plans: dict[str, RobotPlan] = {}
        self._steering: dict[str, Steering] = {}
        self._colors: dict[str, LampColor] = {}
        self._selection: dict[str, Selection] = {}
        self._conveyor: dict[str, ConveyorState] = {}
        self._frame: StripsFrame | None = None
        self._is_lit = False
        self._names: dict[Part, set[str]] = {}
        self._set_room(Environment(stamp_ns=0, name=""))
        self._takers: dict[type[Message], Callable[[Any, str, float], None]] = {
            Environment: lambda message, _name, _now_s: self._set_room(message),
            StripsFrame: self._on_frame,
            LampColor: self._keep(self._colors, "lamps"),
            ConveyorState: self._keep(self._conveyor, "bays"),
            TrackedObjects: self._on_objects,
            RobotState: self._on_robot,
            RobotPlan: self._keep(self._plans, "robots"),
            Steering: self._keep(self._steering, "robots"),
            Selection: self._keep(self._selection, "objects"),
            UserProfile: self._on_profile,
            UserPose: self._on_pose,
            Cursor: self._on_cursor,
            Hover: self._on_hover,
            Goal: self._on_goal,
        }

    @property
    def problems(self) -> list[str]:
        """Return a message for each part of the map that cannot be drawn."""
        return self._lines.problems

    def take(self, message: Message, name: str, now_s: float) -> None:
        """Keep `message`, whose key has `name`, if it is drawn; `now_s` is monotonic."""
        taker = self._takers.get(type(message))
        if taker is not None:
            taker(message, name, now_s)

    def forget(self, now_s: float) -> None:
        """Remove rays, hovers and objects that are too old."""
        oldest_s = now_s - self._forget_s
        for user in [user for user, at_s in self._pointed_s.items() if at_s < oldest_s]:
            del self._pointed_s[user]
            self._people[user].cursor = None
            self.changed.add("people")
        for heard in (self._hovers, self._objects):
            for name in [name for name, each in heard.items() if each.at_s < oldest_s]:
                del heard[name]
                self.changed.add("objects")
        for name in [name for name, each in self._robots.items() if each.at_s < oldest_s]:
            del self._robots[name]
            self.changed |= {"robots", "objects"}

    @property
    def is_moving(self) -> bool:
        """Return True if something that expires is shown."""
        return bool(self._pointed_s or self._hovers or self._objects or self._robots)

    def leave(self, user: str) -> None:
        """Forget a person who has left."""
        self._people.pop(user, None)
        self._pointed_s.pop(user, None)
        self._hovers.pop(user, None)
        self._steering.pop(user, None)
        self.changed |= {"people", "frames", "objects", "robots"}

    def draw(self, part: Part, now_ns: int) -> Picture:
        """Return `part` as a whole, so that new viewers see all of it."""
        self.changed.discard(part)
        if part == "pixels":
            if self._frame is not None and not self._is_lit:
                self._pixels.light(self._frame)
                self._is_lit = True
            return self._pixels.cloud(now_ns)
        if part == "frames":
            poses = [(user, each.pose) for user, each in self._people.items()]
            return FrameTransforms(
                transforms=[people.transform(user, pose, now_ns) for user, pose in poses if pose is not None]
            )
        return self._update(part, self._drawn(part, now_ns), now_ns)

    def _drawn(self, part: Part, now_ns: int) -> list[NamedEntity]:
        if part == "room":
            return room(self._map, self._lines, now_ns)
        if part == "lamps":
            return lamps(self._map.lamps, self._colors, now_ns)
        if part == "bays":
            return bays(self._map, self._lines, self._conveyor.get(""), now_ns)
        if part == "people":
            return [each for item in self._people.items() for each in people.entities(*item, now_ns)]
        colors = {user: person.color for user, person in self._people.items()}
        if part == "robots":
            return self._drawn_robots(colors, now_ns)
        hovers = {user: heard.message for user, heard in self._hovers.items()}
        claims = ObjectOwnership.of(self._selection.get(""), hovers)
        return [
            each
            for tracker, heard in self._objects.items()
            for each in self._renderer.entities(
                tracker,
                [item for item in heard.message.objects if item.id not in self._robots],
                claims,
                colors,
                now_ns,
            )
        ]

    def _drawn_robots(self, colors: dict[str, Rgb], now_ns: int) -> list[NamedEntity]:
        entities = [
            robots.robot(name, heard.message, self._plans.get(name), colors, now_ns)
            for name, heard in self._robots.items()
        ]
        routes = [(user, each) for user, each in self._steering.items() if each.waypoints_m]
        return entities + [
            robots.waypoints(user, each, colors.get(user, shapes.WHITE), now_ns) for user, each in routes
        ]

    def _update(self, part: Part, entities: list[NamedEntity], now_ns: int) -> SceneUpdate:
        """Return `entities` and deletions of what was drawn before and is missing from it."""
        names = {each.name for each in entities}
        gone = sorted(self._names.get(part, set()) - names)
        self._names[part] = names
        kind = SceneEntityDeletionType.MatchingId
        if part == "room":  # without a lifetime: a viewer that missed a deletion must not keep it
            gone, kind = [""], SceneEntityDeletionType.All
        at = shapes.timestamp(now_ns)
        return SceneUpdate(
            deletions=[SceneEntityDeletion(timestamp=at, type=kind, id=name) for name in gone],
            entities=[each.entity for each in entities],
        )

    def _set_room(self, environment: Environment) -> None:
        self._map = environment
        self._lines = Lines(environment)
        self._renderer = ObjectRenderer(self._lines, self._kind_colors)
        self._pixels = Pixels(self._lines.strips)
        self._is_lit = False
        self.changed |= {"room", "pixels", "lamps", "bays", "objects"}

    def _keep(self, newest: dict[str, T], part: Part) -> Callable[[T, str, float], None]:
        """Return a handler that keeps a message by its name, and has `part` drawn again."""

        def keep(message: T, name: str, _now_s: float) -> None:
            newest[name] = message
            self.changed.add(part)

        return keep

    def _on_frame(self, frame: StripsFrame, _name: str, _now_s: float) -> None:
        self._frame = frame
        self._is_lit = False
        self.changed.add("pixels")

    def _on_objects(self, objects: TrackedObjects, tracker: str, now_s: float) -> None:
        self._objects[tracker] = _LastMessage(now_s, objects)
        self.changed.add("objects")

    def _on_robot(self, state: RobotState, name: str, now_s: float) -> None:
        if name not in self._robots:
            self.changed.add("objects")
        self._robots[name] = _LastMessage(now_s, state)
        self.changed.add("robots")

    def _on_hover(self, hover: Hover, user: str, now_s: float) -> None:
        before = self._hovers.get(user)
        self._hovers[user] = _LastMessage(now_s, hover)
        if hover.object_id or (before is not None and before.message.object_id):
            self.changed.add("objects")

    def _on_profile(self, profile: UserProfile, user: str, _now_s: float) -> None:
        self._person(user).profile = profile
        self.changed |= {"people", "objects", "robots"}

    def _on_pose(self, pose: UserPose, user: str, _now_s: float) -> None:
        self._person(user).stand(pose)
        self.changed |= {"people", "frames"}

    def _on_cursor(self, cursor: Cursor, user: str, now_s: float) -> None:
        self._person(user).cursor = cursor
        self._pointed_s[user] = now_s
        self.changed.add("people")

    def _on_goal(self, goal: Goal, user: str, _now_s: float) -> None:
        self._person(user).goal = goal
        self.changed.add("people")

    def _person(self, user: str) -> DrawnPerson:
        return self._people.setdefault(user, DrawnPerson())
