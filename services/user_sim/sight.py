"""All signals that the simulated person has seen and heard, delayed by perception."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Announced,
    BeltLink,
    Environment,
    Feedback,
    LampColor,
    Message,
    RobotState,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.user_sim.eyes import Eyes, Key, Kind, ObservedAppearance, drawable

MAX_LIST_AGE_S = 1.0
"""Maximum age, or lead, of a tracker's list of which the objects are visible, s."""
UNDERSTOOD_S = 0.7
"""Time from the beginning of a name until it is understood, s."""
MAX_NAME_AGE_S = 2.0
"""Age of a name up to which it says where the ray is, or can be confirmed, s."""
MAX_DELAYED = 4096
"""Limit of delayed messages, which bounds memory."""
END_M = 0.001
"""Distance to its end at which a belt hands over objects, m."""
MAX_LINKS = 64
"""Limit of belts that are followed one after the other."""


@dataclass(frozen=True, slots=True)
class SeenObject:
    """An object, and the time of its position."""

    thing: TrackedObject
    stamp_ns: int

    @property
    def key(self) -> Key | None:
        """Return the strip or belt on which it lies, or None."""
        match self.thing.surface:
            case "strip" | "belt" as kind:
                return (kind, self.thing.surface_id)
            case _:
                return None

    def along_m(self, now_ns: int) -> float:
        """Return the arc length of its middle at `now_ns`, m."""
        return self.thing.surface_position_m + self.thing.surface_speed_mps * self.age_s(now_ns)

    def age_s(self, now_ns: int) -> float:
        """Return the age of its position, s."""
        return (now_ns - self.stamp_ns) / NS_PER_S


class Sight:
    """The person's senses, limited to the topics of the process table."""

    def __init__(self, delay_s: float, deadlines_m: Mapping[str, float] | None = None) -> None:
        """Create with a delay. `deadlines_m`: by belt, arc length from which it is too late for a package."""
        self.delay_ns = round(delay_s * NS_PER_S)
        self._deadlines_m = dict(deadlines_m or {})

        # What is visible now, and what is on its way
        self._delayed: deque[tuple[int, Message, str]] = deque()
        self._robots: dict[str, RobotState] = {}
        self._trackers: dict[str, tuple[int, dict[str, TrackedObject]]] = {}
        self.eyes = Eyes()
        self.frame_ns: int | None = None
        """Time of the current frame, ns."""
        self.cues: list[Feedback] = []
        """Cues of the last `look`."""

        # The map
        self.lamps_m: dict[str, Vec3] = {}
        self.lines: dict[Key, Polyline] = {}
        self._links: dict[str, list[BeltLink]] = {}
        self._bays: set[str] = set()
        """Belts that end at a bay."""
        self._fed: set[str] = set()
        """Belts to which others lead."""
        self._colors: dict[str, LampColor] = {}
        self._lamps: dict[str, str] = {}
        """Lamp of each thing that has one."""
        self.profile_ns: int | None = None
        """Time of the first profile, ns. The system is present from then on."""

        self.announced: Announced | None = None
        """Newest name that was spoken, empty once they point elsewhere. None: names are not spoken."""

    def show(self, now_ns: int, message: Message, name: str = "") -> None:
        """Show `message`, which is perceived after the delay."""
        if len(self._delayed) < MAX_DELAYED:
            self._delayed.append((now_ns + self.delay_ns, message, name))

    def look(self, now_ns: int) -> None:
        """Process messages whose delay is over."""
        self.cues.clear()
        while self._delayed and self._delayed[0][0] <= now_ns:
            due_ns, message, name = self._delayed.popleft()
            self._notice(due_ns, message, name)

    def objects(self, now_ns: int) -> list[SeenObject]:
        """Return all visible objects."""
        fresh_ns = round(MAX_LIST_AGE_S * NS_PER_S)
        oldest_ns = now_ns - self.delay_ns - fresh_ns
        newest_ns = now_ns + fresh_ns
        for name, (stamp_ns, _) in [*self._trackers.items()]:
            if not oldest_ns <= stamp_ns <= newest_ns:
                del self._trackers[name]
        objects: list[SeenObject] = []
        for stamp_ns, things in self._trackers.values():
            objects += [SeenObject(thing, stamp_ns) for thing in things.values()]
        return objects

    def find(self, object_id: str, now_ns: int) -> SeenObject | None:
        """Return the visible object `object_id`, or None."""
        fresh_ns = round(MAX_LIST_AGE_S * NS_PER_S)
        for stamp_ns, things in self._trackers.values():
            thing = things.get(object_id)
            if thing is not None and -fresh_ns <= now_ns - stamp_ns <= self.delay_ns + fresh_ns:
                return SeenObject(thing, stamp_ns)
        return None

    def named(self, now_ns: int) -> SeenObject | None:
        """Return the visible object whose name has just been spoken and understood, or None."""
        announced = self.announced
        if announced is None:
            return None
        is_new = UNDERSTOOD_S <= (now_ns - announced.began_ns) / NS_PER_S <= MAX_NAME_AGE_S
        return self.find(announced.object_id, now_ns) if is_new else None

    def robots(self, now_ns: int) -> dict[str, RobotState]:
        """Return the robots in the room by name. Only what is visible of one counts: kind, place, speed."""
        fresh_ns = round(MAX_LIST_AGE_S * NS_PER_S)
        oldest_ns = now_ns - self.delay_ns - fresh_ns
        newest_ns = now_ns + fresh_ns
        return {
            name: state for name, state in self._robots.items() if oldest_ns <= state.stamp_ns <= newest_ns
        }

    def lit_lamp(self) -> str:
        """Return the lit lamp, or `""`."""
        for lamp, shown in self._colors.items():
            if any(shown.color) and lamp in self.lamps_m:
                return lamp
        return ""

    def shows_own_color(self, seen: SeenObject) -> bool:
        """Return True if the light of `seen`, on a strip or a lamp, has the person's colour."""
        if seen.key is not None:
            looks = self.looks(seen)
            if looks is None:
                return False
            return looks.own and not looks.hidden
        lamp = self._lamps.get(seen.thing.id, "")
        shown = self._colors.get(lamp)
        return shown is not None and self.eyes.is_own(shown.color)

    def looks(self, seen: SeenObject) -> ObservedAppearance | None:
        """Return the appearance of `seen` in the current frame, or None if it is not visible enough."""
        if seen.key is None or self.frame_ns is None:
            return None
        along_m = seen.along_m(self.frame_ns)
        return self.eyes.looks(seen.thing.kind, seen.key, along_m, seen.thing.length_m)

    def lines_of(self, kind: Kind) -> list[Polyline]:
        """Return the lines of all strips, or of all belts."""
        return [line for key, line in self.lines.items() if key[0] == kind]

    def time_left_s(self, seen: SeenObject, now_ns: int) -> float:
        """Return the time until it is too late to select the object, s: its deadline, or where it leaves.

        Earlier if its bay is decided earlier, according to the object.
        """
        until_ns = seen.thing.bay_until_ns
        decided_s = math.inf if until_ns is None else (until_ns - now_ns) / NS_PER_S
        return min(decided_s, self._leaves_s(seen, now_ns))

    def _leaves_s(self, seen: SeenObject, now_ns: int) -> float:
        thing = seen.thing
        key = seen.key
        speed = thing.surface_speed_mps
        if key is None or speed == 0.0:
            return math.inf
        line = self.lines.get(key)
        if line is None:
            return math.inf
        if speed < 0.0:
            return thing.surface_position_m / -speed - seen.age_s(now_ns)
        remaining_m = self._remaining_m(key, thing.surface_position_m)
        return remaining_m / speed - seen.age_s(now_ns)

    def has_come(self, seen: SeenObject, now_ns: int) -> bool:
        """Return True if an object has entered its surface with one and a half of its length."""
        thing = seen.thing
        key = seen.key
        speed = seen.thing.surface_speed_mps
        line = self.lines.get(key) if key is not None else None
        if line is None or speed == 0.0:
            return True
        if self._is_fed(thing):
            return True
        entered_m = thing.surface_position_m if speed > 0.0 else line.length_m - thing.surface_position_m
        return entered_m + abs(speed) * seen.age_s(now_ns) >= thing.length_m

    def _is_fed(self, thing: TrackedObject) -> bool:
        """Return True if its belt continues others, so that it was visible before."""
        return thing.surface == "belt" and thing.surface_id in self._fed

    def _remaining_m(self, key: Key, at_m: float) -> float:
        """Return the distance from `at_m` to the first deadline, or else to the end of the last belt."""
        total_m = 0.0
        for _ in range(MAX_LINKS):
            line = self.lines.get(key)
            if line is None:
                break
            deadline_m = self._deadline_m(key[1]) if key[0] == "belt" else None
            if deadline_m is not None:
                return total_m + deadline_m - at_m  # negative if it has passed
            total_m += line.length_m - at_m
            onward = None if key[0] != "belt" else self._onward(key[1])
            if onward is None:
                break
            key = ("belt", onward.target)
            at_m = onward.target_position_m
        return total_m

    def _deadline_m(self, belt: str) -> float | None:
        """Return the arc length from which it is too late on a belt: configured, or else of its first bay."""
        if self._deadlines_m:
            return self._deadlines_m.get(belt)
        onward = self._onward(belt)
        leaves_m: list[float] = []
        for link in self._links.get(belt, ()):
            if link.source_position_m is None or link.target not in self._bays:
                continue
            if link is not onward:
                leaves_m.append(link.source_position_m)
        return min(leaves_m, default=None)

    def _onward(self, belt: str) -> BeltLink | None:
        line = self.lines.get(("belt", belt))
        for link in self._links.get(belt, ()):
            at_m = link.source_position_m
            if at_m is None:
                return link
            if line is not None and at_m >= line.length_m - END_M:
                return link
        return None

    def _notice(self, due_ns: int, message: Message, name: str) -> None:
        match message:
            case StripsFrame():
                self.frame_ns = due_ns - self.delay_ns
                self.eyes.open(message)
            case TrackedObjects():
                things = {thing.id: thing for thing in message.objects}
                self._trackers[name] = (message.stamp_ns, things)
            case RobotState():
                self._robots[name] = message
            case Feedback():
                self.cues.append(message)
            case LampColor():
                self._colors[name] = message
            case Announced():
                self.announced = message
            case UserProfile():
                if self.profile_ns is None:
                    self.profile_ns = due_ns
                self.eyes.set_profile(message)
            case Environment():
                self._learn(message)
            case _:
                raise TypeError(f"a person cannot see {type(message).__name__}")

    def _learn(self, room: Environment) -> None:
        self.lamps_m = {lamp.id: lamp.position_m for lamp in room.lamps}
        self.lines = {("strip", strip.id): line for strip, line in drawable(room.strips)}
        self.lines |= {("belt", belt.id): line for belt, line in drawable(room.belts)}
        self._lamps = {thing.id: thing.lamp for thing in room.things}
        self._bays = {bay.belt for bay in room.bays}
        self._fed = {link.target for link in room.links}
        self._links = {}
        for link in room.links:
            self._links.setdefault(link.source, []).append(link)
        self.eyes.learn(room)
