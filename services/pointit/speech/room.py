"""Objects of commands by their names: things with their lights, robots and tracked objects."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from pointit.geometry.vector import Vec3
from pointit.schemas import Environment, Referent, RobotState, Thing, TrackedObjects
from pointit.speech.grammar import Names, names_of, spoken

BAY = "bay"
"""Word before the name of a bay."""


@dataclass
class SpokenRoom:
    """The newest that is known of the room, for commands."""

    map: Environment | None = None
    robots: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    present_robots: set[str] = field(default_factory=set[str])
    """Robots whose service runs, also those that have not told their state."""
    objects: dict[str, TrackedObjects] = field(default_factory=dict[str, TrackedObjects])

    @property
    def names(self) -> Names:
        """Return the names of things, robots and objects by their spoken words; labels count, too."""
        found = dict(names_of([*(thing.id for thing in self.things), *sorted(self.robots)]))
        for thing in self.things:
            for words in names_of([thing.label]):
                found.setdefault(words, thing.id)
        for bay in self.bays:
            found.setdefault(("bay", *spoken(bay)), f"{BAY} {bay}")
        return found

    @property
    def bays(self) -> dict[str, Vec3]:
        """Return the bays by name with the ends of their belts, {W}, m."""
        if self.map is None:
            return {}
        ends_m = {belt.id: belt.line_m[-1] for belt in self.map.belts}
        return {bay.id: ends_m[bay.belt] for bay in self.map.bays if bay.belt in ends_m}

    @property
    def things(self) -> Sequence[Thing]:
        """Return the things of the map."""
        return () if self.map is None else self.map.things

    @property
    def switches(self) -> list[str]:
        """Return the things that are on or off."""
        return [thing.id for thing in self.things if thing.mode == "switch"]

    def thing(self, name: str) -> Thing | None:
        """Return the thing called `name`, or None if there is none."""
        return next((each for each in self.things if each.id == name), None)

    def named(self, name: str) -> Referent:
        """Return the thing, robot or object called `name`."""
        if name in self.robots:
            return Referent(kind="robot", name=name, probability=1.0, place_m=self.robots[name].position_m)
        if (thing := self.thing(name)) is not None:
            return Referent(kind="thing", name=name, probability=1.0, place_m=thing.center_m)
        bay_m = self.bays.get(name.removeprefix(f"{BAY} "))
        return Referent(
            kind="object" if bay_m is None else "place", name=name, probability=1.0, place_m=bay_m
        )

    def label(self, one: Referent) -> str:
        """Return its name for people: its label in the map, or its own name."""
        thing = self.thing(one.name)
        return one.name if thing is None else thing.label or one.name

    def lamp(self, one: Referent) -> str:
        """Return the single lamp that shows the thing, or empty."""
        thing = self.thing(one.name) if one.kind == "thing" else None
        return "" if thing is None else thing.lamp

    def robots_of(self, user: str) -> Sequence[str]:
        """Return the robots that `user` steers."""
        return [name for name, state in sorted(self.robots.items()) if state.user == user]
