"""What the person wants to point at now: nothing, the lit lamp, the strips' length, the next object."""

import math
from dataclasses import dataclass
from typing import Protocol

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.sight import SeenObject, Sight

PURSUIT_S = 1.5
"""How long a thing that was lost from view is followed along its way."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Something to point at that moves evenly; no point: let the arm rest."""

    key: str
    """Two goals with the same key are the same thing seen at different times."""
    point_m: Vec3 | None = None
    velocity_mps: Vec3 = (0.0, 0.0, 0.0)
    stamp_ns: int = 0
    closed_loop: bool = False
    """Whether the system shows a cursor that the person may correct by."""

    def point_at(self, now_ns: int) -> Vec3 | None:
        """Return where the person expects it at `now_ns`."""
        if self.point_m is None:
            return None
        passed_s = min((now_ns - self.stamp_ns) / NS_PER_S, PURSUIT_S)
        return vector.add(self.point_m, vector.scale(self.velocity_mps, passed_s))


REST = Goal("rest")


class Wish(Protocol):
    """What a person does while they may point."""

    def goal(self, now_ns: int, sight: Sight) -> Goal:
        """Return what to point at; called at every step."""
        ...


class Resting:
    """Does nothing."""

    def goal(self, now_ns: int, sight: Sight) -> Goal:  # noqa: ARG002 - the protocol's signature
        """Return rest."""
        return REST


class AlongStrips:
    """Leads the cursor along all strips from end to end, there and back."""

    def __init__(self, speed_mps: float) -> None:
        self._speed_mps = speed_mps
        self._start_ns: int | None = None

    def goal(self, now_ns: int, sight: Sight) -> Goal:
        """Return the point that runs along the strips."""
        lines = list(sight.strips.values())
        if not lines:
            self._start_ns = None
            return REST
        if self._start_ns is None:
            self._start_ns = now_ns
        total_m = math.fsum(line.length_m for line in lines)
        at_m = (now_ns - self._start_ns) / NS_PER_S * self._speed_mps % (2.0 * total_m)
        sign = 1.0 if at_m <= total_m else -1.0
        at_m = min(at_m, 2.0 * total_m - at_m)
        for line in lines[:-1]:
            if at_m <= line.length_m:
                break
            at_m -= line.length_m
        else:
            line = lines[-1]
        return Goal(
            key="strips",
            point_m=line.point_at(at_m),
            velocity_mps=vector.scale(line.tangent_at(at_m), sign * self._speed_mps),
            stamp_ns=now_ns,
            closed_loop=True,
        )


class Selecting:
    """Selects every object of some kinds and takes back what got selected by accident.

    Stays with one object until it is done, gone, or has taken too long; then takes the one that leaves
    first among those that leave enough time.
    """

    def __init__(self, user: str, config: UserSimConfig) -> None:
        self._user = user
        self._kinds = frozenset(config.target_kinds)
        self._give_up_ns = round(config.give_up_s * NS_PER_S)
        self._retry_ns = round(config.retry_s * NS_PER_S)
        arm = config.arm
        # a common reach, with what it takes to begin and to be noticed; less than that is not worth trying
        self._needed_s = config.aim.reaction_s + arm.reach_base_s + 3.0 * arm.reach_per_bit_s + 0.5
        self._current = ""
        self._since_ns = 0
        self._pause_until_ns: dict[str, int] = {}

    def goal(self, now_ns: int, sight: Sight) -> Goal:
        """Return the object to hold the cursor on, or rest."""
        tasks = {seen.thing.id: seen for seen in sight.objects(now_ns) if self._is_task(seen, sight)}
        if self._current in tasks and now_ns - self._since_ns > self._give_up_ns:
            self._pause_until_ns[self._current] = now_ns + self._retry_ns
            self._current = ""
        if self._current not in tasks:
            self._current = self._next(now_ns, tasks, sight)
            self._since_ns = now_ns
        if not self._current:
            return REST
        seen = tasks[self._current]
        return Goal(
            key=f"object {self._current}",
            point_m=seen.thing.position_m,
            velocity_mps=seen.thing.velocity_mps,
            stamp_ns=seen.stamp_ns,
            closed_loop=True,
        )

    def _is_task(self, seen: SeenObject, sight: Sight) -> bool:
        owner = sight.selection.get(seen.thing.id)
        return owner is None if seen.thing.kind in self._kinds else owner == self._user

    def _next(self, now_ns: int, tasks: dict[str, SeenObject], sight: Sight) -> str:
        left_s = {
            name: sight.time_left_s(seen, now_ns)
            for name, seen in tasks.items()
            if self._pause_until_ns.get(name, 0) <= now_ns and sight.has_come(seen, now_ns)
        }
        worth = {name: left for name, left in left_s.items() if left >= self._needed_s}
        return min(worth, key=worth.__getitem__, default="")


def wish_of(config: UserSimConfig, user: str) -> Wish:
    """Return the wish that `config.behaviour` names."""
    match config.behaviour:
        case "rest":
            return Resting()
        case "strips":
            return AlongStrips(config.strip_speed_mps)
        case "select":
            return Selecting(user, config)


def is_asked(sight: Sight) -> bool:
    """Return whether the localizer wants the person to point at something.

    While they point at things of their own, only a lamp, or setting their pose right, is reason to turn away:
    a robot may be followed all the time.
    """
    state = sight.interaction.state if sight.interaction is not None else "idle"
    if state == "localizing":
        return True
    news = sight.localization
    if news is None or news.phase != "sampling" or not news.target_id:
        return False
    return state == "idle" or news.purpose == "anchor" or news.target_id in sight.lamps_m


def asked_goal(now_ns: int, sight: Sight) -> Goal:
    """Return what the localizer asks to point at: the lamp or moving target it names, else the lit lamp."""
    asked = sight.localization.target_id if sight.localization is not None else ""
    lamp = asked if asked in sight.lamps_m else sight.lit_lamp() if not asked else ""
    if lamp:
        return Goal(key=f"lamp {lamp}", point_m=sight.lamps_m[lamp])
    for seen in sight.objects(now_ns):
        if seen.thing.id == asked:
            return Goal(
                key=f"object {asked}",
                point_m=seen.thing.position_m,
                velocity_mps=seen.thing.velocity_mps,
                stamp_ns=seen.stamp_ns,
            )
    return REST
