"""The localizer on the bus: fixed pose, lamps with a person who looks at them, a robot, requests."""

import asyncio
import itertools
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.geometry.vector import Vec3
from pointit.runtime.clock import Clock, sleep
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    CancelLocalization,
    Environment,
    Lamp,
    Localization,
    SetPose,
    StartLocalization,
    TrackedObject,
    TrackedObjects,
)
from pointit.schemas.topics import (
    CANCEL_LOCALIZATION,
    HEALTH,
    LOCALIZATION,
    MAP,
    OBJECTS,
    POSE,
    RAY,
    SET_POSE,
    START_LOCALIZATION,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from tests.support.bench import Bench, ManualClock, in_virtual_time, memory_bench, until
from tests.unit.localizer import lab
from tests.unit.localizer.person import Person, yaw_difference

LAMPS = (*lab.LAMPS, Lamp(id="led_3", position_m=(3.239, -0.606, 0.15)))
ROOM = lab.ROOM.model_copy(update={"lamps": LAMPS})
STATIC = LocalizerConfig(method="static_targets", order="given", reaction_s=0.5, hold_s=1.0)
USER = "anna"


class Room:
    """A bench with a map, one localizer and a person who points at the lamp that is lit."""

    def __init__(self, bench: Bench, clock: Clock, person: Person) -> None:
        self.bench = bench
        self.clock = clock
        self.person = person
        self.poses = bench.collect(POSE, USER)
        self.progress = bench.collect(LOCALIZATION, USER)

    @property
    def lit(self) -> str:
        """The lamp that is to be lit, or `""`."""
        return self.progress[-1].target_id if self.progress else ""

    @property
    def order(self) -> list[str]:
        return [lamp for lamp, _ in itertools.groupby(news.target_id for news in self.progress) if lamp]

    @property
    def phase(self) -> str:
        return self.progress[-1].phase if self.progress else ""

    @asynccontextmanager
    async def pointing(self) -> AsyncGenerator[None]:
        """Point at whatever is lit, 50 rays a second of the clock."""

        async def point() -> None:
            while True:
                lit = [lamp for lamp in LAMPS if lamp.id == self.lit]
                target: Vec3 = lit[0].position_m if lit else (1.0, 0.0, 1.0)
                self.bench.put(RAY, self.person.ray(target, self.clock.now_ns()), USER)
                await sleep(self.clock, 0.02)

        task = asyncio.create_task(point(), name="a person pointing")
        try:
            yield
        finally:
            task.cancel()
            await asyncio.wait({task})

    async def until_phase(self, phase: str, target_index: int | None = None) -> None:
        def reached() -> bool:
            last = self.progress[-1]
            return last.phase == phase and target_index in (None, last.target_index)

        await until(reached, what=f"{phase}, there was {self.progress[-1]}")


async def test_fixed_pose_is_there_for_late_joiners_and_start_confirms_it() -> None:
    async with memory_bench() as bench:
        bench.start(Localizer, LocalizerConfig(position_m=(1.0, 2.0, 0.0), yaw_deg=90.0), USER)
        await bench.settle()
        poses, progress = bench.collect(POSE, USER), bench.collect(LOCALIZATION, USER)
        await bench.settle()
        assert [pose.position_m for pose in poses] == [(1.0, 2.0, 0.0)]
        assert poses[0].yaw_rad == pytest.approx(math.pi / 2)
        assert poses[0].method == "fixed"
        assert [message.phase for message in progress] == ["idle"]
        done = await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await bench.settle()
        assert "fixed" in done.message
        assert progress[-1].phase == "solved"


@in_virtual_time
async def test_the_whole_procedure_with_lamps() -> None:
    clock = VirtualClock()
    person = Person(1.5, 1.2, -2.0, math.radians(4.0))
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, person)
        bench.put(MAP, ROOM)
        bench.start(Localizer, STATIC, USER)
        await bench.settle()
        assert room.poses == []
        assert not room.lit
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await bench.settle()
        assert room.order == ["led_0"]
        assert room.phase == "sampling"
        assert room.progress[-1].target_id == "led_0"
        async with room.pointing():
            await room.until_phase("solved")
        assert room.order == [lamp.id for lamp in LAMPS]
        assert not room.lit
        pose = room.poses[0]  # then it is followed
        assert math.hypot(pose.position_m[0] - person.x, pose.position_m[1] - person.y) < 0.1
        assert abs(yaw_difference(pose.yaw_rad, person.yaw_rad)) < math.radians(2.0)
        sequence = [message.seq for message in room.progress]
        assert sequence == sorted(set(sequence))


@in_virtual_time
async def test_cancel_leaves_lamps_dark_and_the_last_pose() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, Person())
        bench.put(MAP, ROOM)
        bench.start(Localizer, STATIC, USER)
        await bench.settle()
        await bench.bus.call(SET_POSE, SetPose(position_m=(3.0, 4.0, 0.0), yaw_rad=0.5), USER)
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        async with room.pointing():
            await room.until_phase("sampling", target_index=1)
        done = await bench.bus.call(CANCEL_LOCALIZATION, CancelLocalization(), USER)
        await bench.settle()
        assert done.message == "cancelled; the last pose stays"
        assert not room.lit
        assert room.phase == "cancelled"
        assert [pose.position_m for pose in room.poses] == [(3.0, 4.0, 0.0)]
        again = await bench.bus.call(CANCEL_LOCALIZATION, CancelLocalization(), USER)
        assert again.message == "nothing was going on"


@in_virtual_time
async def test_start_again_begins_at_the_first_lamp() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, Person(1.5, 1.2, 0.4))
        bench.put(MAP, ROOM)
        bench.start(Localizer, STATIC, USER)
        await bench.settle()
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        async with room.pointing():
            await room.until_phase("sampling", target_index=2)
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await bench.settle()
        assert room.lit == "led_0"
        assert room.progress[-1].target_index == 0
        assert room.progress[-1].samples == 0
        async with room.pointing():
            await room.until_phase("solved")
        assert room.poses[0].samples < 250


async def test_set_pose_stops_the_running_procedure() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, Person())
        bench.put(MAP, ROOM)
        bench.start(Localizer, STATIC, USER)
        await bench.settle()
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await bench.bus.call(SET_POSE, SetPose(position_m=(1.0, 0.0, 0.0), yaw_rad=0.25), USER)
        await bench.settle()
        assert not room.lit
        assert room.phase == "cancelled"
        assert (room.poses[-1].position_m, room.poses[-1].yaw_rad) == ((1.0, 0.0, 0.0), 0.25)
        assert room.poses[-1].method == "fixed"


async def test_lamps_are_dark_when_the_service_ends() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, Person())
        bench.put(MAP, ROOM)
        bench.start(Localizer, STATIC, USER)
        await bench.settle()
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await bench.settle()
        assert room.lit
        await bench.stop()
        await until(lambda: not room.lit, what="darkness")


async def test_silence_is_refused_and_shown_in_health_until_it_works() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, Person(1.5, 1.2))
        health = bench.collect(HEALTH)
        bench.put(MAP, ROOM)
        bench.start(Localizer, STATIC, USER)
        await bench.settle()
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        clock.advance(20.0)
        await until(lambda: room.phase == "refused", what="refused")
        assert "only 0 rays came while led_0 was lit" in room.progress[-1].reason
        assert not room.lit
        assert room.poses == []
        await until(lambda: any("only 0 rays" in text for text in health[-1].warnings), what="the warning")
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await until(lambda: not health[-1].warnings, what="the warning to go")


@pytest.mark.parametrize(
    ("room", "config", "sentence"),
    [
        (None, STATIC, "no map yet; start pui"),
        (ROOM, STATIC.model_copy(update={"lamps": ("led_0", "led_9")}), "lamps led_9 are not on map 'lab'"),
        (ROOM, STATIC.model_copy(update={"lamps": ("led_0",)}), "needs two at different places"),
        (ROOM.model_copy(update={"lamps": ()}), STATIC, "needs two at different places"),
    ],
)
async def test_impossible_start_is_refused_immediately(
    room: Environment | None, config: LocalizerConfig, sentence: str
) -> None:
    async with memory_bench() as bench:
        if room is not None:
            bench.put(MAP, room)
        bench.start(Localizer, config, USER)
        await bench.settle()
        with pytest.raises(RefusedError, match=sentence):
            await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)


async def test_refused_start_does_not_stop_the_running_procedure() -> None:
    async with memory_bench() as bench:
        progress: list[Localization] = bench.collect(LOCALIZATION, USER)
        bench.start(Localizer, LocalizerConfig(method="moving_target"), USER)
        await bench.settle()
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        with pytest.raises(RefusedError):
            await bench.bus.call(START_LOCALIZATION, StartLocalization(method="static_targets"), USER)
        await bench.settle()
        assert progress[-1].phase == "sampling"


@pytest.mark.parametrize("stray_s", [0.0, 3600.0], ids=["clean", "with strays an hour ahead"])
async def test_a_robot_is_followed_from_the_start(stray_s: float) -> None:
    clock = ManualClock()
    person = Person(0.5, -0.3, 1.1)
    async with memory_bench(clock) as bench:
        poses = bench.collect(POSE, USER)
        progress = bench.collect(LOCALIZATION, USER)
        bench.start(Localizer, LocalizerConfig(method="moving_target", autostart=True), USER)
        await bench.settle()
        assert progress[-1].phase == "sampling"
        for tick in range(300):  # 12 s at 25 Hz: the reaction and a whole window
            now_ns = clock.advance(0.04)
            angle = math.tau * tick / 200.0
            robot: Vec3 = (2.5 + math.cos(angle), 1.0 + math.sin(angle), 0.7 + 0.4 * math.sin(2.0 * angle))
            item = TrackedObject(id="drone", kind="robot", position_m=robot)
            package = TrackedObject(id="package", kind="package", position_m=(0.0, 0.0, 1.0))
            bench.put(OBJECTS, TrackedObjects(stamp_ns=now_ns, objects=(package, item)), "room")
            bench.put(RAY, person.ray(robot, now_ns), USER)
            await bench.settle(4)
            if stray_s and tick % 20 == 0:
                stray_ns = now_ns + round(stray_s * 1e9)
                bench.put(OBJECTS, TrackedObjects(stamp_ns=stray_ns, objects=(item,)), "room")
                bench.put(RAY, person.ray((9.0, 9.0, 1.0), stray_ns), USER)
                await bench.settle(4)
        await until(lambda: bool(poses), what="a pose")
        assert math.hypot(poses[-1].position_m[0] - person.x, poses[-1].position_m[1] - person.y) < 0.05
        assert poses[-1].method == "moving_target"
        await until(lambda: progress[-1].phase == "solved", what="solved")
        assert progress[-1].target_id == "drone"


def test_configuration_speaks_degrees_and_the_solver_radians() -> None:
    layers = Layers()
    layers.add({"trust": {"ray_sigma_deg": 3.0}, "lamps": ["a", "b"], "hold_s": 4}, "file")
    config = layers.build(LocalizerConfig)
    assert config.lamps == ("a", "b")
    assert config.believed().ray_sigma_rad == pytest.approx(math.radians(3.0))
    assert config.hold_s == 4.0
    layers.add({"metod": "fixed"}, "file")
    with pytest.raises(ConfigError, match="metod"):
        layers.build(LocalizerConfig)
