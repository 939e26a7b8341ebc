"""Two people, one room with lamps: real localizers take turns."""

import asyncio
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.runtime import RefusedError, SimulatedClock, sleep
from pointit.schemas import Environment, Lamp, LampColor, Localization, StartLocalization
from pointit.schemas.topics import LAMP_COLOR, LOCALIZATION, MAP, POSE, RAY, START_LOCALIZATION
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from pointit.services.localizer.turns import MAX_HEARD, Turns
from tests.support.bench import Bench, memory_bench, until
from tests.unit.localizer.person import Person

LAMPS = (
    Lamp(id="led_0", position_m=(3.572, -2.946, 2.08)),
    Lamp(id="led_1", position_m=(1.699, -2.609, 0.85)),
    Lamp(id="led_2", position_m=(0.762, -1.031, 0.15)),
)
PLACES = {lamp.id: lamp.position_m for lamp in LAMPS}
ROOM = Environment(stamp_ns=0, name="lab", lamps=LAMPS)
CONFIG = LocalizerConfig(method="static_targets", reaction_s=0.5, hold_s=1.0)
PEOPLE = {"anna": Person(1.5, 1.2, -2.0), "ben": Person(-0.5, 0.3, 1.0)}
S = 1_000_000_000


class Room:
    """A bench with a map, localizers, and people who point at what their own localizer names."""

    def __init__(self, bench: Bench, clock: SimulatedClock) -> None:
        self.bench = bench
        self.clock = clock
        self.lit: dict[str, bool] = {}
        self.progress = {user: bench.collect(LOCALIZATION, user) for user in PEOPLE}
        self.poses = {user: bench.collect(POSE, user) for user in PEOPLE}
        bench.bus.subscribe(LAMP_COLOR, self._on_lamp)
        bench.put(MAP, ROOM)

    def _on_lamp(self, lamp: LampColor, name: str) -> None:
        self.lit[name] = any(lamp.color)

    @property
    def shining(self) -> list[str]:
        return [name for name, is_lit in self.lit.items() if is_lit]

    def last(self, user: str) -> Localization:
        return self.progress[user][-1]

    async def start(self, user: str) -> str:
        """Ask for a localization; return why not, or nothing."""
        try:
            await self.bench.bus.call(START_LOCALIZATION, StartLocalization(), user)
        except RefusedError as error:
            return str(error)
        return ""

    async def solved(self, user: str) -> None:
        await until(lambda: self.last(user).phase == "solved", what=f"{user}: {self.last(user)}")
        assert math.dist(self.poses[user][-1].position_m[:2], (PEOPLE[user].x, PEOPLE[user].y)) < 0.1


async def _point(room: Room, user: str, person: Person) -> None:
    while True:
        asked = room.last(user).target_id if room.progress[user] else ""
        ray = person.ray(PLACES.get(asked, (1.0, 0.0, 1.0)), room.clock.now_ns())
        room.bench.put(RAY, ray, user)
        await sleep(room.clock, 0.02)


@asynccontextmanager
async def room_of_two() -> AsyncGenerator[Room]:
    clock = SimulatedClock(10.0)
    async with memory_bench(clock) as bench:
        room = Room(bench, clock)
        for user in PEOPLE:
            bench.start(Localizer, CONFIG, user)
        await until(lambda: all(room.progress.values()), what="both localizers")
        pointing = [asyncio.create_task(_point(room, *each)) for each in PEOPLE.items()]
        try:
            yield room
        finally:
            for task in pointing:
                task.cancel()
            await asyncio.wait(pointing)


async def test_who_comes_later_is_refused_in_a_sentence_and_served_afterwards() -> None:
    async with room_of_two() as room:
        assert await room.start("anna") == ""
        await until(lambda: room.last("anna").phase == "sampling", what="anna's turn")
        reason = await room.start("ben")
        assert reason == "anna is being localized with these lamps; try again when they are done"
        await room.solved("anna")
        assert room.shining == []
        assert await room.start("ben") == ""
        await room.solved("ben")
        assert room.shining == []


async def test_of_two_who_start_at_once_one_gives_way_and_the_other_keeps_the_lamp() -> None:
    async with room_of_two() as room:
        answers = await asyncio.gather(room.start("ben"), room.start("anna"))
        assert not any(answers)  # neither had heard of the other
        await until(lambda: "refused" in {room.last(user).phase for user in PEOPLE}, what="one to give way")
        loser = next(user for user in PEOPLE if room.last(user).phase == "refused")
        (winner,) = set(PEOPLE) - {loser}
        assert room.last(loser).reason.startswith(f"{winner} is being localized")
        await until(lambda: room.shining == [room.last(winner).target_id], what="the winner's lamp to shine")
        await room.solved(winner)
        assert await room.start(loser) == ""
        await room.solved(loser)
        assert room.shining == []


@pytest.mark.parametrize("is_busy", [False, True])
async def test_a_restarted_localizer_darkens_what_was_left_lit_unless_somebody_points(
    *, is_busy: bool
) -> None:
    clock = SimulatedClock(1.0)
    async with memory_bench(clock) as bench:
        bench.put(LAMP_COLOR, LampColor(stamp_ns=1, color=(255, 255, 255)), "led_1")  # left by a killed one
        room = Room(bench, clock)
        if is_busy:
            now_ns = clock.now_ns()
            carl = Localization(stamp_ns=now_ns, phase="sampling", target_id="led_1", since_ns=now_ns)
            bench.put(LOCALIZATION, carl, "carl")
        await bench.settle()
        assert room.shining == ["led_1"]
        bench.start(Localizer, CONFIG, "anna")
        await until(lambda: bool(room.progress["anna"]))
        await bench.settle()
        assert room.shining == (["led_1"] if is_busy else [])


def news(phase: str, since_ns: int, target_id: str = "led_0") -> Localization:
    return Localization.model_validate(
        {"stamp_ns": 1, "phase": phase, "target_id": target_id, "since_ns": since_ns}
    )


def test_turns_count_the_fresh_who_point_at_these_lamps() -> None:
    turns = Turns()
    assert not turns.hear("ben", news("sampling", 7), 100 * S)
    turns.hear("anna", news("sampling", 7), 101 * S)
    turns.hear("carl", news("sampling", 3, "robot"), 101 * S)
    assert turns.others(PLACES, 102 * S) == [(7, "anna"), (7, "ben")]
    assert turns.others(PLACES, 103 * S) == [(7, "anna")]  # nothing was heard of ben for too long
    assert turns.others(PLACES, 90 * S) == []  # the clock was set back
    assert turns.hear("anna", news("solved", 7), 103 * S)
    assert turns.others(PLACES, 103 * S) == []


def test_people_without_number_are_not_all_remembered() -> None:
    turns = Turns()
    for number in range(2 * MAX_HEARD):
        turns.hear(f"u{number}", news("sampling", number), S)
    assert len(turns.others(PLACES, S)) == MAX_HEARD
