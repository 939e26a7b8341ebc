"""What the person has seen so far: everything reaches the mind a visual delay after the light."""

import contextlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Belt,
    Cursor,
    Environment,
    Interaction,
    LampColor,
    Localization,
    Message,
    Selection,
    Strip,
    TrackedObject,
    TrackedObjects,
)

FRESH_S = 1.0
"""Objects of a tracker that says nothing for so long, or is so far ahead, are out of sight."""


@dataclass(frozen=True, slots=True)
class SeenObject:
    """An object, and when it was there."""

    thing: TrackedObject
    stamp_ns: int


class Sight:
    """The person's eyes; they see what the topics of the process table show, and nothing else."""

    def __init__(self, delay_s: float) -> None:
        self._delay_ns = round(delay_s * NS_PER_S)
        self._coming: deque[tuple[int, Message, str]] = deque()
        self._trackers: dict[str, TrackedObjects] = {}
        self.lamps_m: dict[str, Vec3] = {}
        self.strips: dict[str, Polyline] = {}
        self._lines: dict[tuple[str, str], Polyline] = {}
        self._links: dict[str, str] = {}
        self._colors: dict[str, LampColor] = {}
        self.cursors: list[Cursor] = []
        """Cursors that came into view with the last `look`, oldest first."""
        self.selection: dict[str, str] = {}
        """Who has selected what: object id to user."""
        self.interaction: Interaction | None = None
        self.interaction_since_ns = 0
        self.localization: Localization | None = None

    def show(self, now_ns: int, message: Message, name: str = "") -> None:
        """Put `message` before the eyes; it is noticed later."""
        self._coming.append((now_ns + self._delay_ns, message, name))

    def look(self, now_ns: int) -> None:
        """Notice what has become due."""
        self.cursors.clear()
        while self._coming and self._coming[0][0] <= now_ns:
            due_ns, message, name = self._coming.popleft()
            self._notice(due_ns, message, name)

    def objects(self, now_ns: int) -> list[SeenObject]:
        """Return every object in view."""
        fresh_ns = round(FRESH_S * NS_PER_S)
        oldest_ns, newest_ns = now_ns - self._delay_ns - fresh_ns, now_ns + fresh_ns
        for name in [n for n, t in self._trackers.items() if not oldest_ns <= t.stamp_ns <= newest_ns]:
            del self._trackers[name]
        return [
            SeenObject(thing, seen.stamp_ns) for seen in self._trackers.values() for thing in seen.objects
        ]

    def lit_lamp(self) -> str:
        """Return the lamp that is lit; empty when none is."""
        for lamp, shown in self._colors.items():
            if any(shown.color) and lamp in self.lamps_m:
                return lamp
        return ""

    def time_left_s(self, seen: SeenObject, now_ns: int) -> float:
        """Return how long until the object's centre leaves its surface and those linked to it, s."""
        thing = seen.thing
        line = self._lines.get((thing.surface, thing.surface_id))
        speed = thing.surface_speed_mps
        if line is None or speed == 0.0:
            return float("inf")
        distance_m = line.length_m - thing.surface_position_m if speed > 0.0 else thing.surface_position_m
        if speed > 0.0:
            distance_m += self._linked_m(thing.surface, thing.surface_id)
        return distance_m / abs(speed) - (now_ns - seen.stamp_ns) / NS_PER_S

    def has_come(self, seen: SeenObject, now_ns: int) -> bool:
        """Return whether all of an object, and half as much again, has come in where its surface begins."""
        thing = seen.thing
        line = self._lines.get((thing.surface, thing.surface_id))
        speed = thing.surface_speed_mps
        if line is None or speed == 0.0:
            return True
        come_m = thing.surface_position_m if speed > 0.0 else line.length_m - thing.surface_position_m
        return come_m + abs(speed) * (now_ns - seen.stamp_ns) / NS_PER_S >= thing.length_m

    def _linked_m(self, surface: str, line_id: str) -> float:
        total_m, passed = 0.0, {line_id}
        while (line_id := self._links.get(line_id, "")) and line_id not in passed:
            passed.add(line_id)
            line = self._lines.get((surface, line_id))
            total_m += line.length_m if line is not None else 0.0
        return total_m

    def _notice(self, now_ns: int, message: Message, name: str) -> None:
        match message:
            case TrackedObjects():
                self._trackers[name] = message
            case Cursor():
                self.cursors.append(message)
            case Selection():
                self.selection = {chosen.id: chosen.user for chosen in message.objects}
            case Interaction():
                if self.interaction is None or self.interaction.state != message.state:
                    self.interaction_since_ns = now_ns
                self.interaction = message
            case Localization():
                self.localization = message
            case LampColor():
                self._colors[name] = message
            case Environment():
                self._learn(message)
            case _:
                raise TypeError(f"a person cannot see {type(message).__name__}")

    def _learn(self, room: Environment) -> None:
        self.lamps_m = {lamp.id: lamp.position_m for lamp in room.lamps}
        self.strips = _drawable(room.strips)
        self._lines = {("strip", name): line for name, line in self.strips.items()}
        self._lines |= {("belt", name): line for name, line in _drawable(room.belts).items()}
        self._links = {link.source: link.target for link in room.links}


def _drawable(things: Sequence[Strip] | Sequence[Belt]) -> dict[str, Polyline]:
    """Return the lines of `things`; those that are none, such as a single point, cannot be seen."""
    lines: dict[str, Polyline] = {}
    for thing in things:
        with contextlib.suppress(ValueError):
            lines[thing.id] = Polyline(thing.line_m)
    return lines
