"""The arm of the examples, installed as a package of its own: by itself, and with a simulated person."""

import ast
import asyncio
import math
import tomllib
from collections.abc import AsyncGenerator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

import pointit
from examples.arm.pointed_arm.messages import ARM_STATE, PUT_BACK, ArmState, PutBack
from examples.arm.pointed_arm.person import WISH, Wish
from examples.arm.pointed_arm.service import Arm, ArmConfig
from examples.arm.pointed_arm.simulated_arm import SimulatedArm, Vec3, joint_angles, link_ends
from pointit.plugins import Context, Cursor, Speech, TrackedObjects, Word, topics
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import ButtonEvent, UserPose
from pointit.schemas.topics import USER_ALIVE
from pointit.testing import Bench, in_virtual_time, memory_bench, no_task_left
from tests.architecture.sources import ROOT
from tests.support import strangers

EXAMPLE = ROOT / "examples" / "arm"
BASE_M = ArmConfig().base_m
EYES_M = (0.0, 0.0, 1.64)
NEXT_M = (1.4, -0.1, 0.78)
"""Top of the second box, {W}, m."""
FREE_M = (1.5, 0.5, 0.78)
"""A free place, {W}, m."""


@pytest.fixture
def _installed(tmp_path: Path) -> Iterator[None]:
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    entries = project["entry-points"]["pointit.services"]
    lines = "\n".join(f"{name} = examples.arm.{value}" for name, value in entries.items())
    with strangers.installed(tmp_path, "pointed_arm", "", services=lines):
        yield


def test_it_imports_public_names_of_pointit_alone() -> None:
    modules = {
        (node.module or "") if isinstance(node, ast.ImportFrom) else alias.name
        for path in (EXAMPLE / "pointed_arm").glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    ours = {module for module in modules if module.partition(".")[0] == "pointit"}
    assert ours
    assert ours <= {"pointit", "pointit.plugins", "pointit.testing"}


def test_joints_lead_the_hand_to_every_place_within_reach() -> None:
    reached = 0
    for x in np.arange(0.3, 1.5, 0.1):
        for y in np.arange(-0.8, 0.9, 0.1):
            for z in (0.0, 0.1, 0.3):
                tip = (BASE_M[0] - float(x), float(y), BASE_M[2] + z)
                angles = joint_angles(BASE_M, tip)
                if angles is None:
                    continue
                reached += 1
                _, _, wrist, end = link_ends(BASE_M, angles)
                assert end == pytest.approx(tip, abs=1e-9)
                assert np.subtract(end, wrist)[:2] == pytest.approx((0.0, 0.0), abs=1e-9)  # downwards
                assert angles[0] + angles[4] == pytest.approx(0.0)
    assert reached > 200
    assert joint_angles(BASE_M, (0.5, 0.0, 0.8)) is None


class Stage:
    """An arm on a bench, and people before it."""

    arm: SimulatedArm

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.states = bench.collect(ARM_STATE)
        self.objects = bench.collect(topics.OBJECTS)
        stage = self

        class Shown(Arm):
            def __init__(self, config: ArmConfig, context: Context) -> None:
                super().__init__(config, context)
                stage.arm = self.arm

        bench.start(Shown)

    @property
    def state(self) -> ArmState:
        return self.states[-1]

    def at_m(self, name: str) -> Vec3:
        listed: TrackedObjects = self.objects[-1]
        return next(thing.position_m for thing in listed.objects if thing.id == name)

    async def point(self, at_m: Vec3, for_s: float = 1.2, user: str = "anna") -> None:
        way = np.subtract(at_m, EYES_M)
        x, y, z = (way / np.linalg.norm(way)).tolist()
        for _ in range(round(for_s / 0.02)):
            stamp_ns = self.bench.clock.now_ns()
            cursor = Cursor(stamp_ns=stamp_ns, origin_m=EYES_M, direction=(x, y, z))
            self.bench.put(topics.CURSOR, cursor, user)
            await asyncio.sleep(0.02)

    async def press(self, wait_s: float = 3.0, user: str = "anna") -> None:
        self.bench.put(topics.BUTTON, ButtonEvent(stamp_ns=self.bench.clock.now_ns()), user)
        await asyncio.sleep(wait_s)

    async def say(self, text: str) -> None:
        now_ns = self.bench.clock.now_ns()
        word = Word(text=text, start_ns=now_ns, end_ns=now_ns)
        self.bench.put(topics.SPEECH, Speech(stamp_ns=now_ns, words=(word,)), "anna")
        await asyncio.sleep(3.0)


@asynccontextmanager
async def staged() -> AsyncGenerator[Stage]:
    async with no_task_left(), memory_bench(VirtualClock()) as bench:
        stage = Stage(bench)
        await bench.settle()
        yield stage


@in_virtual_time
async def test_the_hand_hovers_follows_and_takes_only_when_one_presses() -> None:
    async with staged() as stage:
        await stage.point(NEXT_M)
        await stage.point((1.4, 0.1, 0.78), 0.8)
        assert math.dist(stage.at_m("hand")[:2], (1.4, 0.1)) < 0.02
        await stage.point(NEXT_M, 20.0)
        assert (stage.state.phase, stage.state.over, stage.state.holds) == ("hovering", "box2", "")
        await stage.press()
        assert stage.state.holds == "box2"
        assert stage.at_m("box2")[2] > 0.85
        await stage.point(FREE_M)
        assert math.dist(stage.at_m("hand")[:2], FREE_M[:2]) < 0.02
        await stage.press()
        assert stage.at_m("box2") == pytest.approx((1.5, 0.5, 0.75), abs=0.01)
        assert stage.state.holds == ""


@in_virtual_time
async def test_yes_takes_and_no_puts_back() -> None:
    async with staged() as stage:
        await stage.point(NEXT_M)
        await stage.say("yes")
        assert stage.state.holds == "box2"
        await stage.point(FREE_M, 0.5)
        await stage.say("no")
        assert stage.state.holds == ""
        assert stage.at_m("box2") == pytest.approx((1.4, -0.1, 0.75), abs=0.01)


@in_virtual_time
async def test_undo_before_the_cup_is_down_takes_nothing() -> None:
    async with staged() as stage:
        await stage.point(NEXT_M)
        await stage.press(0.1)
        told = await stage.bench.bus.call(PUT_BACK, PutBack())
        await asyncio.sleep(3.0)
        assert told.text == "nothing is taken"
        assert (stage.state.holds, stage.state.phase) == ("", "hovering")
        again = await stage.bench.bus.call(PUT_BACK, PutBack())
        assert "nothing is held" in again.text


@in_virtual_time
async def test_refusals_name_the_reason() -> None:
    async with staged() as stage:
        await stage.point(NEXT_M)
        await stage.point((1.6, 0.3, 0.78), 0.1)
        await stage.press(0.1)
        assert "is on its way to box" in stage.state.text

        await stage.point(NEXT_M)
        await stage.press()
        await stage.point((1.4, 0.1, 0.78))
        await stage.press()
        assert "occupied by box3" in stage.state.text

        await stage.point((0.6, 0.0, 0.78))
        assert "out of reach" in stage.state.text
        await stage.press(0.5, user="ben")
        ben = UserPose(stamp_ns=stage.bench.clock.now_ns(), position_m=(1.5, 0.6, 0.0), yaw_rad=0.0)
        stage.bench.put(topics.POSE, ben, "ben")
        await stage.point(FREE_M)
        assert "ben stands within 0.5 m" in stage.state.text
        assert stage.state.holds == "box2"


@in_virtual_time
async def test_person_who_has_left_is_not_in_the_way() -> None:
    async with staged() as stage:
        presence = stage.bench.bus.announce(USER_ALIVE, "ben")
        ben = UserPose(stamp_ns=stage.bench.clock.now_ns(), position_m=(1.4, -0.1, 0.0), yaw_rad=0.0)
        stage.bench.put(topics.POSE, ben, "ben")
        await stage.point(NEXT_M)
        assert "ben stands within 0.5 m" in stage.state.text

        presence.close()
        await stage.point(NEXT_M)
        await stage.press()
        assert stage.state.holds == "box2"


@in_virtual_time
async def test_a_lost_link_holds_what_it_holds() -> None:
    async with staged() as stage:
        await stage.point(NEXT_M)
        await stage.press()
        stage.arm.has_link = False
        before = stage.at_m("hand")
        await stage.point(FREE_M)
        await stage.press()
        assert "holds what it holds" in stage.state.text
        assert (stage.state.phase, stage.state.holds) == ("lost", "box2")
        assert stage.at_m("hand") == before


def picks(seed: int, number: int) -> list[tuple[str, str, float]]:
    """Return the box that a simulated person meant, the one that was taken, and the time, s, of each pick."""
    wishes = list[tuple[Wish, int]]()
    taken = list[tuple[str, str, float]]()

    async def main() -> None:
        settings = {"arm-user.seed": seed}
        async with pointit.run(EXAMPLE / "arm.yaml", virtual=True, seed=seed, settings=settings) as site:

            async def hear() -> None:
                async for wish in site.messages(WISH):
                    wishes.append((wish, site.now_ns()))

            hearing = asyncio.create_task(hear())
            held = ""
            async for state in site.messages(ARM_STATE).during(40.0 * number):
                if state.holds and state.holds != held:
                    wish, begin_ns = wishes[-1]
                    taken.append((wish.box, state.holds, (site.now_ns() - begin_ns) / 1e9))
                held = state.holds
                if len(taken) == number:
                    break
            hearing.cancel()

    pointit.run_virtually(main())
    return taken


@pytest.mark.usefixtures("_installed")
def test_simulated_person_takes_boxes_and_puts_them_as_meant() -> None:
    assert [wanted == box for wanted, box, _ in picks(3, 2)] == [True, True]


@pytest.mark.long
@pytest.mark.usefixtures("_installed")
def test_two_hundred_picks_of_twenty_people_are_right_and_fast() -> None:
    all_picks = [pick for seed in range(100, 120) for pick in picks(seed, 10)]
    right = [time_s for wanted, box, time_s in all_picks if wanted == box]
    assert len(right) >= 0.97 * 200, f"{len(right)} of {len(all_picks)}"
    assert max(time_s for _, _, time_s in all_picks) <= 12.0
