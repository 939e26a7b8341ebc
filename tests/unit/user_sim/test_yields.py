"""A person whose wrist somebody else moves for a while: they send nothing, watch, and go on with what is."""

import math
from typing import Literal

import pytest

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.clock import VirtualClock
from pointit.schemas import NS_PER_S, WRIST_PATIENCE_S, SelectedObject, Selection, UserProfile, WristSample
from pointit.schemas.topics import BUTTON, HEALTH, IMU, WRIST
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.goal import ButtonModel, PerceivedState
from pointit.services.user_sim.service import UserSim
from tests.support.bench import memory_bench, until
from tests.unit.user_sim.life import PRECISE, ROOM, Life, State, thing

RED, SECOND = thing("r", "red", 1.0), thing("s", "red", 4.0)
STATES: tuple[State, ...] = ("idle", "localizing", "pointing")


def along_the_strip(life: Life, now_ns: int) -> Vec3:
    along_m = 2.5 + 2.4 * math.sin(now_ns / NS_PER_S)
    return vector.normalized(vector.subtract((4.85, -1.425 + along_m, 0.9), life.eyes_m))


def is_on(life: Life, object_m: Vec3) -> bool:
    return life.error_rad(life.run(0.02), object_m) < math.radians(1.0)


def begun(state: State, *, lit: bool = True) -> Life:
    life = Life(PRECISE)
    if lit:
        life.light(profile=UserProfile(stamp_ns=0, cursor_color=(0, 158, 115)))
    life.before_step = lambda: life.objects(RED, SECOND)
    if state == "idle":
        life.run(0.1)
    else:
        life.state(state)
        life.run(4.0)
    return life


@pytest.mark.parametrize("before", STATES)
@pytest.mark.parametrize("left", STATES)
def test_they_point_at_something_soon_whatever_the_other_has_left(before: State, left: State) -> None:
    life = begun(before)
    life.yield_for(3.0, lambda now_ns: along_the_strip(life, now_ns))
    if left != before:
        life.state(left)
    life.yield_for(5.0, lambda now_ns: along_the_strip(life, now_ns))
    presses = len(life.presses)
    began_ns = life.now_ns
    if left == "idle":
        life.run(3.0)
        assert len(life.presses) == presses + 1
        assert life.presses[-1] - began_ns >= 0.9 * NS_PER_S  # they take their time, as always
        life.state("pointing")
    elif left == "localizing":
        life.cue("target", target="led_2")
        life.run(3.0)
        assert is_on(life, ROOM.lamps[1].position_m)
        life.cue("localized")
        life.state("pointing")
    life.run(3.0)
    assert is_on(life, RED.position_m) or is_on(life, SECOND.position_m)
    assert (life.now_ns - began_ns) / NS_PER_S < 7.0
    assert len(life.presses) == presses + (left == "idle")
    assert life.doubles == []


def test_the_arm_hangs_meanwhile_and_goes_on_from_there_without_a_jump() -> None:
    life = begun("pointing")
    before = life.ray(life.run(0.02))
    life.yield_for(0.02)
    assert vector.angle_between(before, life.ray(life.run(0.02))) < math.radians(5.0)
    life.yield_for(5.0)
    hangs = life.ray(life.run(0.02))
    assert vector.elevation(hangs) < math.radians(-60.0)
    for _ in range(150):
        raised = life.ray(life.run(0.02))
        assert vector.angle_between(hangs, raised) < math.radians(10.0)
        hangs = raised


@pytest.mark.parametrize("selects", ["r", "s"])
def test_what_the_other_has_selected_in_their_name_is_theirs_and_not_taken_back(selects: str) -> None:
    life = begun("pointing")
    life.yield_for(2.0, lambda now_ns: along_the_strip(life, now_ns))
    assert life.lights is not None
    mine = SelectedObject(id=selects, user="anna", since_ns=0)
    life.lights.content.set_selection(Selection(stamp_ns=0, objects=(mine,)))
    life.cue("selected")
    life.yield_for(3.0, lambda now_ns: along_the_strip(life, now_ns))
    for _ in range(20):
        life.run(0.1)
        assert life.person.goal.object_id != selects
    assert life.person.goal.object_id == {"r": "s", "s": "r"}[selects]


@pytest.mark.parametrize("gesture", ["double", "press"])
def test_time_that_was_somebody_elses_makes_nobody_press(gesture: Literal["double", "press"]) -> None:
    """Neither for a cursor that is off (2 s) nor for one that is not to be seen (4 s)."""
    press, perceived = ButtonModel(UserSimConfig(anchor_when_off_deg=5.0, lost_press_s=4.0)), PerceivedState()
    perceived.state = "pointing"
    now_s = 0.0

    def pressed(duration_s: float) -> list[str]:
        nonlocal now_s
        end_s, gestures = now_s + duration_s, list[str]()
        while now_s < end_s - 1e-9:
            now_s += 0.1
            off_rad, sees = (0.2, True) if gesture == "double" else (0.0, False)
            event = press.step(round(now_s * 1e9), perceived, known_ns=0, off_rad=off_rad, sees=sees)
            gestures += [] if event is None else [event.gesture]
        return gestures

    limit_s = 2.0 if gesture == "double" else 4.0
    press.step(0, perceived, known_ns=0, sees=True)
    assert pressed(limit_s - 0.5) == []
    for _ in range(50):
        now_s += 0.1
        press.wait(round(now_s * 1e9))
    assert pressed(limit_s - 0.5) == []
    assert pressed(1.0) == [gesture]


async def test_the_service_is_silent_while_a_page_has_the_wrist_and_goes_on_then() -> None:
    async with memory_bench(VirtualClock()) as bench:
        samples, presses, reports = bench.collect(IMU), bench.collect(BUTTON), bench.collect(HEALTH)
        config = UserSimConfig(rate_hz=100.0, think_s=0.0)
        bench.start(UserSim, config, user="anna")
        await until(lambda: bool(samples))

        def page(user: str) -> None:
            sample = WristSample(stamp_ns=bench.clock.now_ns(), orientation_xyzw=(0.0, 0.0, 0.0, 1.0))
            bench.put(WRIST, sample, user)

        def is_said() -> bool:
            return bool(reports) and "a page or ROS moves the wrist" in {
                one.name for one in reports[-1].figures
            }

        page("ben")
        seen = len(samples)
        await until(lambda: len(samples) > seen + 10)
        page("anna")
        await bench.settle()
        seen, stopped_ns = len(samples), bench.clock.now_ns()
        await until(is_said)
        await until(lambda: len(samples) > seen, what="the person again")
        assert 0.95 < (samples[seen].stamp_ns - stopped_ns) / (WRIST_PATIENCE_S * NS_PER_S) < 1.6
        await until(lambda: not is_said())
        assert presses == []  # three seconds after their birth, without a profile
