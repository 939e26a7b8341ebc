"""The scene, in parts that a viewer can show and hide, and log lines of what happens in it."""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

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
    LIFETIME_S,
    NO_PROFILE,
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
from pointit.plugins import Change, SiteState
from pointit.schemas import (
    Environment,
    Feedback,
    Goal,
    Health,
    Hover,
    Interaction,
    Localization,
    Message,
    RobotPlan,
    RobotState,
    SelectionEvent,
    Steering,
    Strip,
    StripsFrame,
    topics,
)
from pointit.schemas.base import Rgb
from pointit.schemas.topics import Topic
from pointit.site.site_state import M

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
        """Update what follows from a change of the site."""
        topic, name, message = change.topic, change.name, change.message
        if topic in EXPIRING:
            (self._fresh[topic].add if message is not None else self._fresh[topic].discard)(name)
        if isinstance(message, Environment):
            self._set_room(message)
        elif isinstance(message, Goal):
            self._goals[name] = message
        elif topic is topics.STRIPS_FRAME:
            self._is_lit = False
        elif topic is topics.ROBOT_STATE and None in (message, change.previous):
            self.changed.add("objects")  # of which it is one no longer, or again
        if topic is not topics.HOVER or _is_on_object(message) or _is_on_object(change.previous):
            self.changed.update(DRAWN.get(topic, ()))

    def forget(self, now_s: float) -> None:
        """Remove rays, hovers, objects and robots that are too old at `now_s`, the site state's time."""
        for topic, names in self._fresh.items():
            times_s = {name: self._site.received_s(topic, name) or 0.0 for name in names}
            if expired := {name for name, at_s in times_s.items() if now_s - at_s > FORGET_S}:
                names.difference_update(expired)
                self.changed.update(DRAWN[topic], ("objects",) if topic is topics.ROBOT_STATE else ())

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
            poses = self._site.all(topics.POSE).items()
            return FrameTransforms(transforms=[people.transform(*each, now_ns) for each in poses])
        return self._update(part, self._drawn(part, now_ns), now_ns)

    def _drawn(self, part: Part, now_ns: int) -> list[NamedEntity]:
        site = self._site
        if part == "room":
            return room(self._map, self._lines, now_ns)
        if part == "lamps":
            return lamps(self._map.lamps, site.all(topics.LAMP_COLOR), now_ns)
        if part == "bays":
            return bays(self._map, self._lines, site.get(topics.CONVEYOR_STATE), now_ns)
        poses, cursors, profiles = site.all(topics.POSE), self._new(topics.CURSOR), site.all(topics.PROFILE)
        drawn = {
            user: DrawnPerson(
                profiles.get(user, NO_PROFILE), poses.get(user), cursors.get(user), self._goals.get(user)
            )
            for user in {*profiles, *poses, *cursors, *self._goals}
        }
        if part == "people":
            return [each for item in sorted(drawn.items()) for each in people.entities(*item, now_ns)]
        colors = {user: person.color for user, person in drawn.items()}
        robots = self._new(topics.ROBOT_STATE)
        if part == "robots":
            plans, routes = site.all(topics.ROBOT_PLAN), site.all(topics.STEERING)
            return [
                *(robot(name, each, plans.get(name), colors, now_ns) for name, each in robots.items()),
                *(
                    waypoints(user, each, colors.get(user, shapes.WHITE), now_ns)
                    for user, each in routes.items()
                    if each.waypoints_m
                ),
            ]
        claims = ObjectOwnership.of(site.get(topics.SELECTION), self._new(topics.HOVER))
        return [
            each
            for tracker, tracked in self._new(topics.OBJECTS).items()
            for each in self._renderer.entities(
                tracker, [item for item in tracked.objects if item.id not in robots], claims, colors, now_ns
            )
        ]

    def _new(self, topic: Topic[M]) -> dict[str, M]:
        """Return the messages of `topic` that have not expired, by name."""
        return {name: each for name, each in self._site.all(topic).items() if name in self._fresh[topic]}

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
        self._renderer = ObjectRenderer(self._lines)
        self._pixels = Pixels(self._lines.strips)
        self._is_lit = False


def _is_on_object(hover: Message | None) -> bool:
    return isinstance(hover, Hover) and bool(hover.object_id)


HISTORY = 200
"""Lines kept for viewers that join late."""
MAX_STATES = 1000
"""Maximum number of states that are remembered; the oldest go first."""


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


class EventLog:
    """Turns changes of a site into log lines."""

    def __init__(self, site: SiteState) -> None:
        self.history: deque[LogLine] = deque(maxlen=HISTORY)
        self._site = site
        self._states: OrderedDict[tuple[type[Message], str], Message] = OrderedDict()
        """Last states by type and name. They outlive their services, with which they return unchanged."""
        self._writers: dict[type[Message], Callable[[Any, Any], Iterator[tuple[LogLevel, str]]]] = {
            Health: self._health,
            SelectionEvent: self._selection,
            Feedback: self._feedback,
            Localization: self._localization,
            Interaction: self._interaction,
            RobotState: self._robot,
        }

    def take(self, change: Change, now_ns: int) -> list[LogLine]:
        """Return the new lines from a change."""
        message = change.message
        writer = None if message is None else self._writers.get(type(message))
        if writer is None:
            return []
        previous = change.previous
        if isinstance(message, Localization | Interaction | RobotState):
            key = type(message), change.name
            previous = self._states.pop(key, None)
            self._states[key] = message
            if len(self._states) > MAX_STATES:
                self._states.popitem(last=False)
        return self._lines_of(writer(message, previous), change.name or "selection", now_ns)

    def presence(self, instance: str, now_ns: int, *, present: bool) -> list[LogLine]:
        """Return the line that says that a service has started or ended."""
        sentences = (LogLevel.Info, "runs") if present else (LogLevel.Warning, "has ended")
        return self._lines_of(iter([sentences]), instance, now_ns)

    def active_warnings(self, now_ns: int) -> list[LogLine]:
        """Return the warnings that are active now."""
        return [
            LogLine(now_ns, LogLevel.Warning, instance, sentence)
            for instance, health in self._site.all(topics.HEALTH).items()
            for sentence in _warnings(health).values()
        ]

    def _lines_of(self, sentences: Iterator[tuple[LogLevel, str]], source: str, now_ns: int) -> list[LogLine]:
        lines = [LogLine(now_ns, level, source, text) for level, text in sentences]
        self.history += lines
        return lines

    def _health(self, health: Health, previous: Health | None) -> Iterator[tuple[LogLevel, str]]:
        now, before = _warnings(health), _warnings(previous)
        for identity, sentence in now.items():
            if identity not in before:
                yield LogLevel.Warning, sentence
        for identity, sentence in before.items():
            if identity not in now:
                yield LogLevel.Info, f"no longer: {sentence}"
        for level, text, name in (
            (LogLevel.Error, "handlers failed; see its log", "errors"),
            (LogLevel.Warning, "events were lost on their way to it", "lost"),
            (LogLevel.Warning, "messages to it could not be read", "invalid"),
        ):
            if (new := _count(health, name) - _count(previous, name)) > 0:
                yield level, f"{new} {text}"

    def _selection(self, event: SelectionEvent, _previous: None) -> Iterator[tuple[LogLevel, str]]:
        words = [event.user, event.event, event.kind, event.object_id]
        words += [f"to bay {event.bay}"] if event.bay else []
        text = " ".join(word for word in words if word)
        level = LogLevel.Warning if event.event == "refused" else LogLevel.Info
        yield level, f"{text}: {event.reason}" if event.reason else text

    def _feedback(self, cue: Feedback, _previous: None) -> Iterator[tuple[LogLevel, str]]:
        yield LogLevel.Info, f"cue {cue.cue}: {cue.text}" if cue.text else f"cue {cue.cue}"

    def _localization(
        self, message: Localization, previous: Localization | None
    ) -> Iterator[tuple[LogLevel, str]]:
        phase = (message.phase, message.target_id)
        if previous is None:
            is_same = message.phase == "idle"
        else:
            is_same = phase == (previous.phase, previous.target_id)
        if is_same:
            return
        level = LogLevel.Warning if message.phase == "refused" else LogLevel.Info
        target = f" {message.target_id}" if message.target_id else ""
        yield (
            level,
            f"localization {message.phase}{target}" + (f": {message.reason}" if message.reason else ""),
        )

    def _interaction(
        self, message: Interaction, previous: Interaction | None
    ) -> Iterator[tuple[LogLevel, str]]:
        if previous is None or previous.state != message.state:
            yield LogLevel.Info, f"is {message.state}" + (f": {message.reason}" if message.reason else "")

    def _robot(self, message: RobotState, previous: RobotState | None) -> Iterator[tuple[LogLevel, str]]:
        if message.user != (previous.user if previous else ""):
            yield LogLevel.Info, f"{message.user or 'nobody'} steers it"
        if message.has_new_reason(previous):
            yield LogLevel.Warning, f"{message.phase.replace('_', ' ')}: {message.reason}"


def _warnings(health: Health | None) -> dict[tuple[str, ...], str]:
    """Return the sentences of the warnings in a report by the identity of the problem."""
    problems = () if health is None else health.all_problems
    return {each.identity: each.sentence for each in problems if each.severity == "warning"}


def _count(health: Health | None, name: str) -> int:
    """Return the errors of a report, or what its keys have counted."""
    if health is None:
        return 0
    return health.errors if name == "errors" else sum(getattr(key, name) for key in health.keys)
