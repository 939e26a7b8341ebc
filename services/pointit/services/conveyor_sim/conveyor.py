"""A conveyor of parallel lanes: fed at one end, left at the other, stepped in time."""

import math
from collections.abc import Sequence

from pointit.schemas import NS_PER_S, TrackedObject
from pointit.services.conveyor_sim.feeder import Feeder
from pointit.services.conveyor_sim.lane import Item, Lane

ROUNDING_S = 0.5e-9
"""Times are whole nanoseconds; sums of their floats are off by less than half of one."""


class NoRoomError(Exception):
    """An object does not fit now; its text is one sentence for a person."""


class UnknownLaneError(Exception):
    """There is no such lane; its text lists those there are."""


class Conveyor:
    """All lanes move at one speed; what enters is counted as fed, what passes an end as left.

    Objects enter with their centre at the lane's start; while the speed is negative, at its end. They leave
    when their centre passes an end. Where an object is depends on the time alone, not on how often it is
    stepped.
    """

    def __init__(
        self,
        lanes: Sequence[Lane],
        feeder: Feeder,
        *,
        speed_mps: float,
        initial: int = 0,
        prefix: str = "object",
        start_ns: int = 0,
    ) -> None:
        """Take `lanes`, at least one, with `initial` objects on them; the ids count on from `prefix`-1."""
        self.lanes = tuple(lanes)
        self.fed = 0
        self.left = 0
        self.speed_mps = speed_mps
        self._is_reverse = speed_mps < 0.0
        self._feeder = feeder
        self._initial = initial
        self._prefix = prefix
        self._ids = 0
        self._now_ns = start_ns
        self._fill()

    @property
    def size(self) -> int:
        """Return how many objects are on the lanes."""
        return sum(len(lane.items) for lane in self.lanes)

    def step(self, now_ns: int) -> list[Item]:
        """Go on to `now_ns`; return what left since the last step. Time that went back stands still."""
        rest_s = max(0, now_ns - self._now_ns) / NS_PER_S
        self._now_ns = now_ns
        passed: list[Item] = []
        while not self._feeder.is_done:
            lane = self.lanes[self._feeder.taken % len(self.lanes)]
            until_s = max(self._feeder.due_s, self._room_in_s(lane, self._feeder.length_m))
            if until_s > rest_s + ROUNDING_S:
                break
            until_s = min(until_s, rest_s)
            passed += self._move(until_s)
            rest_s -= until_s
            self._enter(lane, self._feeder.take(), self._feeder.length_m)
        return passed + self._move(rest_s)

    def stand_still(self, now_ns: int) -> None:
        """Let the time until `now_ns` go by without moving."""
        self._now_ns = now_ns

    def set_speed(self, speed_mps: float) -> None:
        """Change the speed from the last step on; the sign says at which end objects enter."""
        self.speed_mps = speed_mps
        if speed_mps != 0.0:
            self._is_reverse = speed_mps < 0.0

    def add(self, kind: str, lane_id: str, length_m: float) -> Item:
        """Put one object where objects enter `lane_id` (empty: the first lane), and return it.

        Raises:
            UnknownLaneError: there is no such lane.
            NoRoomError: another object is in the way.
        """
        lane = self.lanes[0] if not lane_id else self._lane(lane_id)
        wait_m = lane.wait_m(length_m, at_end=self._is_reverse)
        if wait_m > 0.0:
            when = (
                f"ask again in {self._room_in_s(lane, length_m):.1f} s"
                if self.speed_mps
                else "the conveyor stands still: set a speed first"
            )
            raise NoRoomError(
                f"lane {lane.id!r} has no room for {length_m:g} m now, {wait_m:.2f} m are missing; {when}"
            )
        return self._enter(lane, kind, length_m)

    def reset(self) -> None:
        """Take everything off, set the counts to 0 and start the feeder again."""
        for lane in self.lanes:
            lane.clear()
        self.fed = self.left = 0
        self._feeder.restart()
        self._fill()

    def tracked(self) -> list[TrackedObject]:
        """Return every object, lane by lane."""
        return [tracked for lane in self.lanes for tracked in lane.tracked(self.speed_mps)]

    def _lane(self, lane_id: str) -> Lane:
        for lane in self.lanes:
            if lane.id == lane_id:
                return lane
        there = ", ".join(lane.id for lane in self.lanes)
        raise UnknownLaneError(f"there is no lane {lane_id!r}; the lanes are {there}")

    def _move(self, elapsed_s: float) -> list[Item]:
        if elapsed_s <= 0.0:
            return []
        self._feeder.pass_time(elapsed_s)
        passed = [item for lane in self.lanes for item in lane.move(self.speed_mps * elapsed_s)]
        self.left += len(passed)
        return passed

    def _room_in_s(self, lane: Lane, length_m: float) -> float:
        wait_m = lane.wait_m(length_m, at_end=self._is_reverse)
        if wait_m == 0.0:
            return 0.0
        return wait_m / abs(self.speed_mps) if self.speed_mps else math.inf

    def _enter(self, lane: Lane, kind: str, length_m: float) -> Item:
        item = self._item(kind, length_m)
        lane.enter(item, at_end=self._is_reverse)
        return item

    def _fill(self) -> None:
        """Put the initial objects on, as many as have room, the first of each lane furthest along."""
        length_m = self._feeder.length_m
        room = [int(lane.line.length_m / length_m) for lane in self.lanes]
        fills: list[list[Item]] = [[] for _ in self.lanes]
        for index in range(self._initial):
            turn = index % len(self.lanes)
            if self._feeder.is_done or len(fills[turn]) >= room[turn]:
                break
            fills[turn].append(self._item(self._feeder.take(), length_m))
        for lane, items in zip(self.lanes, fills, strict=True):
            lane.fill(items if self._is_reverse else items[::-1])

    def _item(self, kind: str, length_m: float) -> Item:
        self._ids += 1
        self.fed += 1
        return Item(f"{self._prefix}-{self._ids}", kind, length_m)
