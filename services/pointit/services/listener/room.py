"""Targets of words in the room at one time: things, tracked objects, robots and people."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Message, RobotState, TrackedObjects, UserPose
from pointit.schemas.person import ReferentKind

M = TypeVar("M", bound=Message)

GONE_S = 3.0
"""Time after the last list of a tracker, or report of a robot, after which what it told is gone, s."""
CHEST_M = 1.2
"""Height of a person's middle, m."""
PERSON_M = (0.5, 0.5, 1.2)
"""Extent of a person who is pointed at, m."""
MAX_TARGETS = 2000
"""Limit of targets that are considered."""
ROBOT_TRACKER = "robot."
"""Beginning of the names of trackers that list one robot, which reports its state, too."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """Something in the room that a word may refer to, at one time."""

    kind: ReferentKind
    name: str
    center_m: Vec3
    size_m: Vec3
    """Extent: the larger one of the floor twice, then upwards."""


@dataclass
class Room:
    """The newest that is known of the room."""

    things: frozenset[str] = frozenset()
    objects: dict[str, TrackedObjects] = field(default_factory=dict[str, TrackedObjects])
    robots: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    poses: dict[str, UserPose] = field(default_factory=dict[str, UserPose])

    def on_map(self, environment: Environment) -> None:
        """Update the names of things."""
        self.things = frozenset(thing.id for thing in environment.things)

    def on_absence(self, user: str) -> None:
        """Forget a person who has left."""
        self.poses.pop(user, None)

    def targets(self, user: str, at_ns: int, now_ns: int) -> list[Target]:
        """Return the targets for words of `user`, at their positions at `at_ns`, extrapolated by velocity."""
        targets = [*self._objects(at_ns, now_ns), *self._robots(at_ns, now_ns)]
        targets += [
            Target(kind="person", name=name, center_m=_raised(pose.position_m, CHEST_M), size_m=PERSON_M)
            for name, pose in self.poses.items()
            if name != user
        ]
        return targets[:MAX_TARGETS]

    def _objects(self, at_ns: int, now_ns: int) -> list[Target]:
        targets: list[Target] = []
        for tracker, listed in _recent(self.objects, now_ns).items():
            if tracker.startswith(ROBOT_TRACKER) and tracker.removeprefix(ROBOT_TRACKER) in self.robots:
                continue
            for one in listed.objects:
                wide_m = max(one.size_m[:2]) if one.size_m else one.length_m
                high_m = one.size_m[2] if one.size_m else 0.0
                passed_s = (at_ns - listed.stamp_ns) / NS_PER_S
                targets.append(
                    Target(
                        kind="thing" if one.id in self.things else "object",
                        name=one.id,
                        center_m=vector.add(one.position_m, vector.scale(one.velocity_mps, passed_s)),
                        size_m=(wide_m, wide_m, high_m),
                    )
                )
        return targets

    def _robots(self, at_ns: int, now_ns: int) -> list[Target]:
        targets: list[Target] = []
        for name, state in _recent(self.robots, now_ns).items():
            passed_s = (at_ns - state.stamp_ns) / NS_PER_S
            center_m = vector.add(state.position_m, vector.scale(state.velocity_mps, passed_s))
            wide_m = 2.0 * state.radius_m
            targets.append(
                Target(kind="robot", name=name, center_m=center_m, size_m=(wide_m, wide_m, wide_m))
            )
        return targets


def _recent(messages: Mapping[str, M], now_ns: int) -> dict[str, M]:
    return {name: each for name, each in messages.items() if abs(now_ns - each.stamp_ns) <= GONE_S * NS_PER_S}


def _raised(place_m: Vec3, by_m: float) -> Vec3:
    return place_m[0], place_m[1], place_m[2] + by_m
