"""A simulated person who takes boxes with the arm, one after the other, seeing where its hand is."""

import math
import zlib
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from pointit.plugins import (
    NS_PER_S,
    Context,
    Delivery,
    Message,
    PersonGoal,
    Scope,
    ServicePlugin,
    Topic,
    UserSim,
    UserSimConfig,
    topics,
)

from .simulated_arm import Vec3

HAND = "hand"
HELD_HIGHER_M = 0.05
"""Height above the table from which a box is in the air, m."""
APART_M = 0.15
"""Distance from other boxes at which a place is free, m."""
OVER_M = 0.03
"""Distance of the hand from a box, or a place, within which the person is content, m."""
CONTENT_S = 0.6
"""Time for which the hand stays there before they press, s."""
ENOUGH_S = 10.0
"""Time after which they press wherever it is, s."""
ANSWER_S = 4.0
"""Time without an effect of a press after which the person tries again, s."""


class ArmUserConfig(UserSimConfig):
    """The person, and where boxes may lie."""

    places_m: tuple[tuple[float, float], ...] = Field(
        default=tuple((1.4 + 0.2 * row, -0.5 + 0.2 * column) for row in range(2) for column in range(6)),
        description="x and y of places for boxes, {W}, m",
    )


class Wish(Message):
    """The wish of the simulated person, for trials: nobody else may know it."""

    box: str = ""
    place_m: Vec3 = (0.0, 0.0, 0.0)


WISH = Topic(
    key="arm-user/{user}/wish",
    message=Wish,
    delivery=Delivery.STATE,
    rate_hz=None,
    writers=("arm-user",),
    about="what the simulated person means",
)


class ArmUser(UserSim):
    """A simulated person with their wristband, before the arm."""

    NAME: ClassVar[str] = "arm-user"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = ArmUserConfig

    def __init__(self, config: ArmUserConfig, context: Context) -> None:
        self.rng = np.random.default_rng([config.seed or 0, zlib.crc32(b"arm")])
        self.places_m = config.places_m
        super().__init__(config, context)
        self.wishes = self.bus.publisher(WISH, self.user)

    def new_behaviour(self) -> "Taking":
        """Return their behaviour while they may point."""
        return Taking(self)


class Taking:
    """Points at a box until the hand is above it, presses, and does the same with a place for it."""

    def __init__(self, person: ArmUser) -> None:
        self._person = person
        self._rng = person.rng
        self._now_ns = 0
        self._turns = 0
        """Number of boxes that they have wanted to move."""
        self._presses = 0
        self._hand_m: Vec3 = (0.0, 0.0, 0.0)
        self._boxes_m: dict[str, Vec3] = {}
        self._table_m = 0.0
        self._aim: str | Vec3 = ""
        """Box, or place, that they point at."""
        self._goals = self._take_boxes()

    def goal(self, now_ns: int, sight: Any) -> PersonGoal:
        """Return the box or place to point at, with the presses so far. `sight` lists what they see."""
        seen = {seen_thing.thing.id: seen_thing.thing for seen_thing in sight.objects(now_ns)}
        boxes = {name: thing.position_m for name, thing in seen.items() if thing.press}
        if HAND not in seen or not boxes:
            return PersonGoal("rest", presses=self._presses)
        self._now_ns = now_ns
        self._hand_m = seen[HAND].position_m
        self._boxes_m = boxes
        self._table_m = min(z for _, _, z in boxes.values())
        next(self._goals)

        # They look at the table below what they want, which is where the hand will stand
        x, y, _ = self._aim_m()
        key = f"{self._turns} {self._aim}"
        point_m = (x, y, self._table_m)
        return PersonGoal(key, point_m, closed_loop=True, robot=HAND, presses=self._presses)

    def _take_boxes(self) -> Iterator[None]:
        while True:
            box, place_m = self._choose()

            # Take it. A wrong box is put back by the word "no"
            while self._lifted() != box:
                self._aim = box
                yield from self._press_when_above()
                yield from self._wait(lambda: self._lifted() != "")
                if self._lifted() not in ("", box):
                    self._person.say("no")
                    yield from self._wait(lambda: self._lifted() == "")

            # Put it down
            while self._lifted() == box:
                self._aim = place_m
                yield from self._press_when_above()
                yield from self._wait(lambda: self._lifted() == "")

    def _choose(self) -> tuple[str, Vec3]:
        """Return a box, and a free place for it."""
        names = sorted(self._boxes_m)
        box = names[int(self._rng.integers(len(names)))]
        free = [place for place in self._person.places_m if self._is_free(place)]
        x, y = free[int(self._rng.integers(len(free)))]
        self._turns += 1
        wish = Wish(stamp_ns=self._now_ns, seq=self._turns, box=box, place_m=(x, y, self._table_m))
        self._person.wishes.put(wish)
        return box, wish.place_m

    def _is_free(self, place_m: tuple[float, float]) -> bool:
        distances_m = [math.dist(place_m, position_m[:2]) for position_m in self._boxes_m.values()]
        return min(distances_m) > APART_M

    def _lifted(self) -> str:
        """Return the box that is in the air, or an empty name."""
        least_m = self._table_m + HELD_HIGHER_M
        return next((box for box, (_, _, z) in self._boxes_m.items() if z > least_m), "")

    def _aim_m(self) -> Vec3:
        return self._boxes_m[self._aim] if isinstance(self._aim, str) else self._aim

    def _press_when_above(self) -> Iterator[None]:
        """Press once the hand has stood where they point for a while, or they had enough of correcting."""
        is_careless = self._rng.random() < self._person.config.mind.lapse_share
        content_s = 0.0 if is_careless else CONTENT_S
        start_ns = content_ns = self._now_ns
        while self._now_ns - content_ns <= content_s * NS_PER_S:
            if self._now_ns - start_ns > ENOUGH_S * NS_PER_S:
                break
            yield
            if math.dist(self._hand_m[:2], self._aim_m()[:2]) > OVER_M:
                content_ns = self._now_ns
        self._presses += 1

    def _wait(self, is_done: Callable[[], bool]) -> Iterator[None]:
        """Wait until something is done, or it takes too long."""
        end_ns = self._now_ns + round(ANSWER_S * NS_PER_S)
        yield
        while not is_done() and self._now_ns < end_ns:
            yield


ARM_USER = ServicePlugin(
    summary="a simulated person who takes boxes with the arm",
    config=ArmUserConfig,
    make=ArmUser,
    reads=UserSim.READS,
    writes=(*UserSim.WRITES, topics.SPEECH, WISH),
)
