"""Several people, one room with lamps: real localizers take turns, as a real led-driver decides."""

import math
from collections.abc import AsyncGenerator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from pointit.runtime.clock import sleep
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import LampColor, Localization, StartLocalization
from pointit.schemas import topics as at
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.service import LedDriver
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from tests.support.bench import Bench, background, in_virtual_time, memory_bench, until
from tests.unit.localizer.person import LAMPS, PLACES, ROOM, Person

CONFIG = LocalizerConfig(method="static_targets", reaction_s=0.5, hold_s=1.0)
PEOPLE = {"anna": Person(1.5, 1.2, -2.0), "ben": Person(-0.5, 0.3, 1.0), "carl": Person(0.5, 1.6, 0.2)}


class Room:
    """A bench with a map, led-driver, localizers, and people who point at what their own localizer names."""

    def __init__(self, bench: Bench, clock: VirtualClock) -> None:
        self.bench = bench
        self.clock = clock
        self.lit: dict[str, bool] = {}
        self.progress = {user: bench.collect(at.LOCALIZATION, user) for user in PEOPLE}
        self.poses = {user: bench.collect(at.POSE, user) for user in PEOPLE}
        bench.bus.subscribe(at.LAMP_COLOR, self._on_lamp)
        bench.put(at.MAP, ROOM)
        self.led_driver = bench.start(LedDriver, LedDriverConfig())

    def _on_lamp(self, lamp: LampColor, name: str) -> None:
        self.lit[name] = any(lamp.color)

    @property
    def shining(self) -> list[str]:
        return [name for name, is_lit in self.lit.items() if is_lit]

    def last(self, user: str) -> Localization:
        return self.progress[user][-1]

    async def start(self, user: str) -> str:
        """Ask for a localization; return what is answered."""
        return (await self.bench.bus.call(at.START_LOCALIZATION, StartLocalization(), user)).message

    async def points(self, user: str) -> None:
        await until(lambda: bool(self.last(user).target_id), what=f"{user}'s turn")

    async def take_turns(self) -> None:
        """Anna begins, and ben asks after her."""
        await self.start("anna")
        await self.points("anna")
        await self.start("ben")

    async def waits(self, user: str, *ahead: str) -> None:
        await until(lambda: self.last(user).ahead == ahead, what=f"{user}: {self.last(user)}")
        last = self.last(user)
        assert (last.phase, last.target_id, last.samples) == ("sampling", "", 0)

    async def solved(self, user: str) -> None:
        await until(lambda: self.last(user).phase == "solved", what=f"{user}: {self.last(user)}")
        assert math.dist(self.poses[user][-1].position_m[:2], (PEOPLE[user].x, PEOPLE[user].y)) < 0.1


def pointing(lamp: str, since_ns: int) -> Localization:
    """Return the outputs of a played localizer."""
    return Localization(
        stamp_ns=since_ns, phase="sampling", target_id=lamp, since_ns=since_ns, lamps=("led_1", "led_2")
    )


async def _point(room: Room, user: str, person: Person) -> None:
    while True:
        asked = room.last(user).target_id if room.progress[user] else ""
        ray = person.ray(PLACES.get(asked, (1.0, 0.0, 1.0)), room.clock.now_ns())
        room.bench.put(at.RAY, ray, user)
        await sleep(room.clock, 0.02)


@asynccontextmanager
async def room_of(*users: str) -> AsyncGenerator[Room]:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock)
        for user in users:
            bench.start(Localizer, CONFIG, user)
        await until(lambda: all(room.progress[user] for user in users), what="the localizers")
        async with AsyncExitStack() as pointing:
            for user in users:
                await pointing.enter_async_context(background(_point(room, user, PEOPLE[user])))
            yield room


@pytest.mark.parametrize("presence", ["person", "localizer"])
@in_virtual_time
async def test_absent_user_frees_the_lamps_immediately(presence: str) -> None:
    """Dora's localizer is played: it says once that she points, and is gone without a word."""
    async with room_of("anna") as room:
        bench = room.bench
        dora = [
            bench.bus.announce(at.USER_ALIVE, "dora"),
            bench.bus.announce(at.SERVICE_ALIVE, "localizer.dora"),
        ]
        await bench.settle()
        now_ns = room.clock.now_ns()
        bench.put(at.LOCALIZATION, pointing("led_1", now_ns), "dora")
        await bench.settle()

        assert await room.start("anna") == "anna waits in turn: dora first"
        dora[0 if presence == "person" else 1].close()
        await room.points("anna")
        assert room.clock.now_ns() - now_ns < 2_500_000_000  # before silence alone would tell


@in_virtual_time
async def test_silent_person_frees_the_lamps_and_long_waits_are_refused() -> None:
    async with room_of("anna") as room:
        bench = room.bench

        def says(user: str, lamp: str) -> None:
            bench.put(at.LOCALIZATION, pointing(lamp, 1), user)

        says("dora", "led_1")
        await bench.settle()
        await room.start("anna")
        asked_ns = room.clock.now_ns()
        await room.points("anna")
        assert 2_000_000_000 < room.clock.now_ns() - asked_ns < 6_000_000_000

        await room.solved("anna")
        bench.start(Localizer, CONFIG, "ben")
        await until(lambda: bool(room.progress["ben"]))

        says("dora", "led_1")
        await bench.settle()
        await room.start("ben")
        while room.last("ben").phase == "sampling":
            says("dora", "led_1")
            await sleep(room.clock, 0.5)

        assert room.last("ben").phase == "refused"
        assert room.last("ben").reason.startswith("ben has waited 300 s for the lamps; dora came first")
        assert not [news for news in room.progress["ben"] if news.target_id]


@in_virtual_time
async def test_waiting_person_is_refused_when_the_lamps_are_gone() -> None:
    async with room_of("anna", "ben") as room:
        await room.take_turns()
        room.bench.put(at.MAP, ROOM.model_copy(update={"lamps": LAMPS[:1]}))
        await until(lambda: room.last("ben").phase == "refused", what="ben's refusal")
        assert "needs two" in room.last("ben").reason
        assert room.shining == []


@in_virtual_time
async def test_restarted_led_driver_switches_lamps_off_and_keeps_the_queue() -> None:
    async with room_of("anna", "ben") as room:
        bench = room.bench
        await room.take_turns()
        await room.waits("ben", "anna")
        await bench.end(room.led_driver)
        await until(lambda: room.shining == [], what="darkness")

        target = room.last("anna").target_id
        for lamp in LAMPS:  # as if it had been killed
            bench.put(at.LAMP_COLOR, LampColor(stamp_ns=1, color=(255, 255, 255)), lamp.id)
        bench.start(LedDriver, LedDriverConfig())
        await until(lambda: room.shining in ([target], [room.last("anna").target_id]), what="anna's lamp")

        await room.solved("anna")
        await room.solved("ben")
        assert "refused" not in {news.phase for user in ("anna", "ben") for news in room.progress[user]}

        began_ns = next(news.stamp_ns for news in room.progress["ben"] if news.target_id)
        ended_ns = next(news.stamp_ns for news in room.progress["anna"] if news.phase == "solved")
        assert began_ns >= ended_ns


@in_virtual_time
async def test_people_without_led_driver_are_localized_by_named_lamps() -> None:
    async with room_of("anna") as room:
        await room.bench.end(room.led_driver)
        assert await room.start("anna") == "localizing by static targets"
        await room.solved("anna")
