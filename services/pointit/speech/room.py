"""Objects of commands by their names: things with their lights, robots and tracked objects."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from pointit.schemas import Environment, Referent, RobotState, TrackedObjects
from pointit.speech.grammar import Names, names_of


@dataclass
class SpokenRoom:
    """The newest that is known of the room, for commands."""

    map: Environment | None = None
    robots: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    objects: dict[str, TrackedObjects] = field(default_factory=dict[str, TrackedObjects])

    @property
    def names(self) -> Names:
        """Return the names of things, robots and objects by their spoken words; labels count, too."""
        things = () if self.map is None else self.map.things
        found = dict(names_of([*(thing.id for thing in things), *sorted(self.robots)]))
        for thing in things:
            for words in names_of([thing.label]):
                found.setdefault(words, thing.id)
        return found

    def named(self, name: str) -> Referent:
        """Return the thing, robot or object called `name`."""
        if name in self.robots:
            return Referent(kind="robot", name=name, probability=1.0, place_m=self.robots[name].position_m)
        for thing in () if self.map is None else self.map.things:
            if thing.id == name:
                return Referent(kind="thing", name=name, probability=1.0, place_m=thing.center_m)
        return Referent(kind="object", name=name, probability=1.0)

    def label(self, one: Referent) -> str:
        """Return its name for people: its label in the map, or its own name."""
        things = () if self.map is None else self.map.things
        return next((thing.label for thing in things if thing.id == one.name), "") or one.name

    def lamp(self, one: Referent) -> str:
        """Return the single lamp that shows the thing, or empty."""
        things = () if self.map is None else self.map.things
        return next((thing.lamp for thing in things if one.kind == "thing" and thing.id == one.name), "")

    def robots_of(self, user: str) -> Sequence[str]:
        """Return the robots that `user` steers."""
        return [name for name, state in sorted(self.robots.items()) if state.user == user]
