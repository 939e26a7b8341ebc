"""Current goal of the person: nothing, lamps, along the strips, objects, places, robots."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.eyes import Kind
from pointit.services.user_sim.goal import REST, PerceivedState, PersonGoal, on_object
from pointit.services.user_sim.perceived_objects import PerceivedObjects
from pointit.services.user_sim.robot_user import GroundRobotUser, QuadrotorUser
from pointit.services.user_sim.selecting import DecisionTimes, Selecting
from pointit.services.user_sim.sight import Sight

APART_M = 0.3
"""Gap between strips above which the next one is another reach, not the same movement, m."""
PLACES_M = (1.2, 2.5)
"""Range of distances of places to which a robot is sent, m."""
RAISED_M = 3.0
"""Height above a place at which the person points in between, m. Nothing is there."""
FIND_S = 1.0
"""Usual time from choosing a lamp or thing to the end of the reach, s."""


class Behaviour(Protocol):
    """Behaviour of a person while they may point."""

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:
        """Return the goal to point at. Called at every step."""
        ...


class Resting:
    """Does nothing."""

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:  # noqa: ARG002 - the protocol's signature
        """Return rest."""
        return REST


class AlongStrips:
    """Moves the cursor along all strips there and back, or along belts if there are no strips."""

    def __init__(self, speed_mps: float) -> None:
        self._speed_mps = speed_mps
        self._start_ns: int | None = None

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:
        """Return the point that moves along the strips."""
        kind: Kind = "strip"
        lines = sight.lines_of(kind)
        if not lines:
            kind = "belt"
            lines = sight.lines_of(kind)
        if not lines:
            self._start_ns = None
            return REST
        if self._start_ns is None:
            self._start_ns = now_ns

        # Arc length along all lines, there and back
        total_m = math.fsum(line.length_m for line in lines)
        elapsed_s = (now_ns - self._start_ns) / NS_PER_S
        at_m = elapsed_s * self._speed_mps % (2.0 * total_m)
        sign = 1.0 if at_m <= total_m else -1.0
        at_m = min(at_m, 2.0 * total_m - at_m)

        # Its line, and the number of the stretch: another one begins where lines are apart
        stretch = 0
        last = lines[0]
        for number, line in enumerate(lines):
            gap_m = math.dist(_end(last, -1), _end(line, 0)) if number > 0 else 0.0
            if gap_m > APART_M:
                stretch += 1
            last = line
            if at_m <= line.length_m:
                break
            if number < len(lines) - 1:
                at_m -= line.length_m
        velocity_mps = vector.scale(last.tangent_at(at_m), sign * self._speed_mps)
        return PersonGoal(
            key=f"{kind}s {stretch}",
            point_m=last.point_at(at_m),
            velocity_mps=velocity_mps,
            stamp_ns=now_ns,
            closed_loop=True,
            kind=kind,
        )


class SequentialTargets:
    """Points at one goal after another, at each for a while."""

    def __init__(
        self, choose: Callable[[str, Sight], PersonGoal | None], hold_s: float, times: DecisionTimes
    ) -> None:
        """Create with `choose`, which returns the next goal after the one of the given key."""
        self._choose = choose
        self._hold_s = hold_s
        self._times = times
        self._goal = REST
        self._until_ns: int | None = None

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:
        """Return the current goal."""
        if self._until_ns is None or now_ns >= self._until_ns:
            self._goal = self._choose(self._goal.key, sight) or REST
            hold_s = FIND_S + self._hold_s * self._times.between(0.5, 1.5)
            self._until_ns = None
            if self._goal is not REST:
                self._until_ns = now_ns + round(hold_s * NS_PER_S)
        return self._goal


def next_lamp(before: str, sight: Sight) -> PersonGoal | None:
    """Return the lamp after the one of key `before`, in the map's order, cyclically."""
    lamps_m = sight.lamps_m
    goals = [PersonGoal(key=f"lamp {lamp}", point_m=position_m) for lamp, position_m in lamps_m.items()]
    if not goals:
        return None
    keys = [goal.key for goal in goals]
    if before not in keys:
        return goals[0]
    return goals[(keys.index(before) + 1) % len(goals)]


class Sending:
    """Points at a place on the floor, up, and there again, to send a robot. Then at another place."""

    def __init__(self, feet_m: Vec3, rng: np.random.Generator) -> None:
        self._feet_m = feet_m
        self._rng = rng
        self._step = -1
        self._place_m = feet_m

    def __call__(self, before: str, sight: Sight) -> PersonGoal | None:  # noqa: ARG002 - as `choose` has it
        """Return the next of the four steps: there, up, there again, up."""
        self._step += 1
        if self._step % 4 == 0:
            azimuth_rad = float(self._rng.uniform(-math.pi, math.pi))
            direction = vector.direction(azimuth_rad, 0.0)
            distance_m = float(self._rng.uniform(*PLACES_M))
            self._place_m = vector.add(self._feet_m, vector.scale(direction, distance_m))
        up_m = RAISED_M if self._step % 2 else 0.0
        point_m = vector.add(self._place_m, (0.0, 0.0, up_m))
        return PersonGoal(key=f"place {self._step}", point_m=point_m)


def make_behaviour(
    config: UserSimConfig, things: PerceivedObjects, times: DecisionTimes, rng: np.random.Generator
) -> Behaviour:
    """Return the behaviour of `config.behaviour`."""
    match config.behaviour:
        case "rest":
            return Resting()
        case "lamps":
            return SequentialTargets(next_lamp, config.lamp_hold_s, times)
        case "strips":
            return AlongStrips(config.strip_speed_mps)
        case "send":
            return SequentialTargets(Sending(config.position_m, rng), config.lamp_hold_s, times)
        case "fly":
            return QuadrotorUser(config.spots_m, times)
        case "drive":
            return GroundRobotUser(config.spots_m, times)
        case "select":
            return Selecting(config, things, times)


def asked_goal(now_ns: int, sight: Sight, perceived: PerceivedState) -> PersonGoal:
    """Return the requested goal: the named lamp or thing, else the lit lamp."""
    requested = perceived.target
    if perceived.is_queuing:
        return REST
    lamp = ""
    if requested in sight.lamps_m:
        lamp = requested
    elif not requested:
        lamp = sight.lit_lamp()
    if lamp:
        return PersonGoal(key=f"lamp {lamp}", point_m=sight.lamps_m[lamp])
    seen = sight.find(requested, now_ns) if requested else None
    return on_object(seen, sight, closed_loop=False) if seen is not None else REST


def _end(line: Polyline, index: int) -> Vec3:
    x, y, z = line.vertices_m[index].tolist()
    return (x, y, z)
