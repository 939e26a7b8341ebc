"""The scene, in parts that a viewer can show and hide, and log lines of what happens in it."""

import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from foxglove.messages import (
    CylinderPrimitive,
    FrameTransforms,
    LinePrimitive,
    Log,
    LogLevel,
    PackedElementField,
    PackedElementFieldNumericType,
    PointCloud,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
)

from pointit.bridges.foxglove import entities as people
from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.entities import (
    DrawnPerson,
    Lines,
    ObjectOwnership,
    ObjectRenderer,
    bays,
    lamps,
    room,
)
from pointit.bridges.foxglove.shapes import NamedEntity, Places
from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    ConveyorState,
    Cursor,
    Environment,
    Feedback,
    Goal,
    Health,
    Hover,
    Interaction,
    LampColor,
    Localization,
    Message,
    RobotPlan,
    RobotState,
    Selection,
    SelectionEvent,
    Steering,
    Strip,
    StripsFrame,
    TrackedObjects,
    UserPose,
    UserProfile,
)
from pointit.schemas.base import Rgb

LIFETIME_S = 2.0
"""Lifetime of an entity, s, for viewers that missed its deletion."""

FREE: Rgb = (150, 160, 172)
"""Colour of a robot that nobody steers, as in the page (`scene/robots.ts`)."""
BODY: Rgb = (215, 220, 228)
FLYING_M = 0.05
"""Height from which a quadrotor has a line down to the floor."""
ABOVE_M = 0.3
"""Height of a label above its robot."""
WAYPOINT_M = 0.1
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)


def robot(
    name: str, state: RobotState, plan: RobotPlan | None, colors: Mapping[str, Rgb], now_ns: int
) -> NamedEntity:
    """Return the entity of a robot, in the colour of the person in `colors` who steers it."""
    rgb = colors.get(state.user, shapes.WHITE) if state.user else FREE
    at, radius_m = state.position_m, state.radius_m
    floor: Vec3 = (at[0], at[1], 0.01)
    is_flying = state.kind == "quadrotor" and at[2] >= FLYING_M
    lines = [shapes.line(_circle(at if is_flying else floor, 1.35 * radius_m), rgb, kind="loop", pixels=3.0)]
    if is_flying:
        lines += [shapes.line((at, floor), rgb, pixels=1.0), _ring(floor, radius_m, rgb)]
    if plan is not None and plan.line_m:
        lines.append(shapes.line((at, *plan.line_m), rgb, pixels=3.0))
    if state.target_m is not None:
        lines.append(_ring(state.target_m, radius_m, rgb))
    front = vector.scale(vector.direction(state.yaw_rad, 0.0), 1.5 * radius_m)
    words = [name, " ".join(filter(None, (state.user, state.phase.replace("_", " "))))]
    facts = {"robot": name, "steered by": state.user or "nobody", "phase": state.phase}
    facts["reason"] = state.reason
    if state.battery is not None:
        facts["battery"] = f"{state.battery:.0%}"
    return shapes.entity(
        f"robot {name}",
        now_ns,
        lifetime_s=LIFETIME_S,
        facts=facts,
        cylinders=_body(state),
        arrows=[shapes.arrow(at, front, rgb, width_m=0.1 * radius_m)],
        lines=lines,
        texts=[shapes.label("\n".join(words), vector.add(at, (0.0, 0.0, ABOVE_M)), rgb)],
    )


def waypoints(user: str, steering: Steering, rgb: Rgb, now_ns: int) -> NamedEntity:
    """Return the way-points that `user` has set and not yet sent, numbered."""
    points = steering.waypoints_m
    return shapes.entity(
        f"way-points {user}",
        now_ns,
        facts={"user": user},
        spheres=[shapes.sphere(point, WAYPOINT_M, rgb) for point in points],
        lines=[shapes.line(points, rgb)] if len(points) > 1 else [],
        texts=[
            shapes.label(str(number), vector.add(point, (0.0, 0.0, 2.0 * WAYPOINT_M)), rgb)
            for number, point in enumerate(points, 1)
        ],
    )


def _body(state: RobotState) -> list[CylinderPrimitive]:
    at, radius_m = state.position_m, state.radius_m
    if state.kind == "ground":
        return [shapes.cylinder(at, radius_m, 2.0 * radius_m, BODY)]
    rotors = [
        vector.add(at, vector.scale(vector.direction(state.yaw_rad + corner, 0.0), 0.7 * radius_m))
        for corner in np.radians([45.0, 135.0, 225.0, 315.0]).tolist()
    ]
    arms = [shapes.cylinder_between(rotors[i], rotors[i + 2], 0.12 * radius_m, BODY) for i in (0, 1)]
    disc_m = (0.1 * radius_m, 0.7 * radius_m)
    return arms + [shapes.cylinder(rotor, *disc_m, BODY, alpha=0.8) for rotor in rotors]


def _circle(center_m: Vec3, radius_m: float) -> list[list[float]]:
    around = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE), np.zeros(len(_CIRCLE))])
    places: list[list[float]] = (around * radius_m + np.array(center_m)).tolist()
    return places


def _ring(center_m: Vec3, radius_m: float, rgb: Rgb) -> LinePrimitive:
    return shapes.line(_circle(center_m, radius_m), rgb, kind="loop", alpha=0.6)


FLOOR = 32
"""Minimum grey of pixels that are off, so that they are visible."""

_LAYOUT = np.dtype([("place_m", "<f4", 3), ("rgba", "u1", 4)])
_FIELDS = [
    PackedElementField(name=name, offset=4 * index, type=PackedElementFieldNumericType.Float32)
    for index, name in enumerate("xyz")
] + [
    PackedElementField(name=name, offset=12 + index, type=PackedElementFieldNumericType.Uint8)
    for index, name in enumerate(("red", "green", "blue", "alpha"))
]


class Pixels:
    """Positions of all pixels: pixel i of n is in the middle of the i-th of n equal parts of its strip."""

    def __init__(self, strips: Mapping[str, tuple[Polyline, Strip]]) -> None:
        self.count = sum(strip.pixels for _, strip in strips.values())
        self._slices: dict[str, slice] = {}
        self._points = np.zeros(self.count, dtype=_LAYOUT)
        self._points["rgba"] = (FLOOR, FLOOR, FLOOR, 255)
        first = 0
        for name, (line, strip) in strips.items():
            numbers: Places = np.arange(strip.pixels, dtype=np.float64)
            at_m: Places = (numbers + 0.5) / (strip.pixels / line.length_m)
            part = slice(first, first + strip.pixels)
            self._points["place_m"][part] = line.points_at(at_m)[:: strip.direction]
            self._slices[name] = part
            first = part.stop

    def light(self, frame: StripsFrame) -> None:
        """Set the colours of `frame`. Ignores strips that are not on the map or are longer there."""
        for strip in frame.strips:
            part = self._slices.get(strip.id)
            if part is not None and len(strip.rgb) == 3 * (part.stop - part.start):
                colors = np.frombuffer(strip.rgb, dtype=np.uint8).reshape(-1, 3)
                np.maximum(colors, FLOOR, out=self._points["rgba"][part, :3])

    def cloud(self, now_ns: int) -> PointCloud:
        """Return the points with fields x, y, z (m, {W}) and red, green, blue, alpha (0 to 255)."""
        return PointCloud(
            timestamp=shapes.timestamp(now_ns),
            frame_id=shapes.WORLD,
            pose=shapes.pose((0.0, 0.0, 0.0)),
            point_stride=_LAYOUT.itemsize,
            fields=_FIELDS,
            data=self._points.tobytes(),
        )


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
        self._newest: dict[type[Message], dict[str, Any]] = {
            Hover: self._hovers,
            TrackedObjects: self._objects,
            RobotState: self._robots,
            RobotPlan: self._plans,
            Steering: self._steering,
            LampColor: self._colors,
            Selection: self._selection,
            ConveyorState: self._conveyor,
        }
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

    def end(self, kind: type[Message], name: str) -> None:
        """Forget the message of this kind and name, which is no longer valid."""
        if kind is Cursor and self._pointed_s.pop(name, None) is not None:
            self._people[name].cursor = None
        elif kind is Goal and name in self._people:
            self._people[name].goal = None
        elif kind is StripsFrame:
            self._frame = None
        elif kind in self._newest:
            self._newest[kind].pop(name, None)
        self.changed |= {"people", "pixels", "lamps", "bays", "objects", "robots"}

    def leave(self, user: str) -> None:
        """Forget a person who has left."""
        self._people.pop(user, None)
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
            robot(name, heard.message, self._plans.get(name), colors, now_ns)
            for name, heard in self._robots.items()
        ]
        routes = [(user, each) for user, each in self._steering.items() if each.waypoints_m]
        return entities + [
            waypoints(user, each, colors.get(user, shapes.WHITE), now_ns) for user, each in routes
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


HISTORY = 200
"""Lines kept for viewers that join late."""

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True, slots=True)
class LogLine:
    """One log line with its time and source."""

    at_ns: int
    level: LogLevel
    source: str
    text: str

    def log(self) -> Log:
        """Return it as a Foxglove message."""
        at = shapes.timestamp(self.at_ns)
        return Log(timestamp=at, level=self.level, message=self.text, name=self.source)


@dataclass(slots=True)
class _Account:
    warnings: dict[tuple[str, ...], str]
    """Sentences by the identity of the problem."""
    errors: int
    lost: int
    invalid: int


class EventLog:
    """Turns messages into log lines. Each change is reported once."""

    def __init__(self) -> None:
        self.history: deque[LogLine] = deque(maxlen=HISTORY)
        self._health_counts: dict[str, _Account] = {}
        self._phases: dict[str, tuple[str, str]] = {}
        self._states: dict[str, str] = {}
        self._robots: dict[str, tuple[str, str]] = {}
        """Owner of each robot, and its reason without numbers."""
        self._writers: dict[type[Message], Callable[[Any, str], Iterator[tuple[LogLevel, str]]]] = {
            Health: self._health,
            SelectionEvent: self._selection,
            Feedback: self._feedback,
            Localization: self._localization,
            Interaction: self._interaction,
            RobotState: self._robot,
        }

    def take(self, message: Message, name: str, now_ns: int) -> list[LogLine]:
        """Return the new lines from `message`, whose key has `name`."""
        writer = self._writers.get(type(message))
        return [] if writer is None else self._lines_of(writer(message, name), name or "selection", now_ns)

    def presence(self, instance: str, now_ns: int, *, present: bool) -> list[LogLine]:
        """Return the line that says that a service has started or ended."""
        if not present:
            self._health_counts.pop(instance, None)
        sentences = (LogLevel.Info, "runs") if present else (LogLevel.Warning, "has ended")
        return self._lines_of(iter([sentences]), instance, now_ns)

    def leave(self, user: str) -> None:
        """Forget the states of a person who has left."""
        self._phases.pop(user, None)
        self._states.pop(user, None)

    def active_warnings(self, now_ns: int) -> list[LogLine]:
        """Return the warnings that are active now."""
        return [
            LogLine(now_ns, LogLevel.Warning, instance, sentence)
            for instance, account in self._health_counts.items()
            for sentence in account.warnings.values()
        ]

    def _lines_of(self, sentences: Iterator[tuple[LogLevel, str]], source: str, now_ns: int) -> list[LogLine]:
        lines = [LogLine(now_ns, level, source, text) for level, text in sentences]
        self.history += lines
        return lines

    def _health(self, health: Health, instance: str) -> Iterator[tuple[LogLevel, str]]:
        now = _Account(
            {each.identity: each.sentence for each in health.all_problems if each.severity == "warning"},
            health.errors,
            sum(key.lost for key in health.keys),
            sum(key.invalid for key in health.keys),
        )
        before = self._health_counts.get(instance, _Account({}, 0, 0, 0))
        self._health_counts[instance] = now
        for identity, sentence in now.warnings.items():
            if identity not in before.warnings:
                yield LogLevel.Warning, sentence
        for identity, sentence in before.warnings.items():
            if identity not in now.warnings:
                yield LogLevel.Info, f"no longer: {sentence}"
        if now.errors > before.errors:
            yield LogLevel.Error, f"{now.errors - before.errors} handlers failed; see its log"
        if now.lost > before.lost:
            yield LogLevel.Warning, f"{now.lost - before.lost} events were lost on their way to it"
        if now.invalid > before.invalid:
            yield LogLevel.Warning, f"{now.invalid - before.invalid} messages to it could not be read"

    def _selection(self, event: SelectionEvent, _name: str) -> Iterator[tuple[LogLevel, str]]:
        words = [event.user, event.event, event.kind, event.object_id]
        words += [f"to bay {event.bay}"] if event.bay else []
        text = " ".join(word for word in words if word)
        level = LogLevel.Warning if event.event == "refused" else LogLevel.Info
        yield level, f"{text}: {event.reason}" if event.reason else text

    def _feedback(self, cue: Feedback, _user: str) -> Iterator[tuple[LogLevel, str]]:
        yield LogLevel.Info, f"cue {cue.cue}: {cue.text}" if cue.text else f"cue {cue.cue}"

    def _localization(self, message: Localization, user: str) -> Iterator[tuple[LogLevel, str]]:
        phase = (message.phase, message.target_id)
        before = self._phases.get(user)
        self._phases[user] = phase
        if phase == before or (before is None and message.phase == "idle"):
            return
        level = LogLevel.Warning if message.phase == "refused" else LogLevel.Info
        target = f" {message.target_id}" if message.target_id else ""
        yield (
            level,
            f"localization {message.phase}{target}" + (f": {message.reason}" if message.reason else ""),
        )

    def _interaction(self, message: Interaction, user: str) -> Iterator[tuple[LogLevel, str]]:
        if self._states.get(user) == message.state:
            return
        self._states[user] = message.state
        yield LogLevel.Info, f"is {message.state}" + (f": {message.reason}" if message.reason else "")

    def _robot(self, message: RobotState, name: str) -> Iterator[tuple[LogLevel, str]]:
        now = (message.user, _NUMBER.sub("#", message.reason))
        user, reason = self._robots.get(name, ("", ""))
        self._robots[name] = now
        if message.user != user:
            yield LogLevel.Info, f"{message.user or 'nobody'} steers it"
        if now[1] and now[1] != reason:
            yield LogLevel.Warning, f"{message.phase.replace('_', ' ')}: {message.reason}"
