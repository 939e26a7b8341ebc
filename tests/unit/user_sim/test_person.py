"""Simulated people, and how they give way."""

import functools
import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    NS_PER_S,
    WRIST_PATIENCE_S,
    BodyMeasures,
    Feedback,
    SelectedObject,
    Selection,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
    WristSample,
)
from pointit.schemas.topics import BUTTON, HEALTH, IMU, WRIST
from pointit.services.user_sim.config import AimConfig, ArmConfig, UserSimConfig
from pointit.services.user_sim.eyes import Eyes, Kind, SeenCursor, Span
from pointit.services.user_sim.goal import REST, ButtonModel, PerceivedState, PersonGoal, on_object
from pointit.services.user_sim.person import SimulatedPerson
from pointit.services.user_sim.service import UserSim
from pointit.services.user_sim.sight import Sight
from pointit.sim.aim import Stance
from tests.support.bench import memory_bench, until
from tests.unit.user_sim.life import PRECISE, ROOM, Life, State, living, thing


def test_button_is_pressed_after_thinking_and_again_after_a_pause() -> None:
    life = Life(PRECISE)
    life.run(0.5)
    life.person.see(life.now_ns, UserProfile(stamp_ns=0))  # somebody knows them
    life.run(5.9)
    assert [round((t - NS_PER_S / 2) / NS_PER_S, 1) for t in life.presses] == [1.2]

    life.state("pointing")
    life.run(20.0)
    assert len(life.presses) == 1

    life.state("idle")
    life.run(1.0)
    assert len(life.presses) == 1

    life.run(0.3)
    assert len(life.presses) == 2
    life.run(5.1)
    assert len(life.presses) == 3


def test_arm_points_at_the_lit_lamp_after_the_reaction_time() -> None:
    life = living("localizing")
    resting = life.ray(life.run(1.0))
    life.shine("led_1")
    assert vector.angle_between(life.ray(life.run(0.34)), resting) < 1e-9
    assert vector.angle_between(life.ray(life.run(0.1)), resting) > 1e-3
    settled = life.run(2.0)
    assert life.error_rad(settled, ROOM.lamps[0].position_m) < 1e-6
    life.shine("led_1", blue=0)
    life.shine("led_2", blue=9)
    assert life.error_rad(life.run(2.0), ROOM.lamps[1].position_m) < 1e-6


def test_pointing_errors_without_a_cursor_are_as_measured() -> None:
    config = PRECISE.model_copy(update={"aim": AimConfig()})
    errors: list[float] = []
    for seed in range(60):
        life = Life(config, seed)
        life.state("localizing")
        life.shine("led_1")
        errors.append(math.degrees(life.error_rad(life.run(3.0), ROOM.lamps[0].position_m)))
    assert 4.0 < np.median(errors) < 8.0  # 6.7 degrees in the recordings


def test_moving_object_is_followed_at_its_present_position() -> None:
    life = living("pointing")

    def move() -> None:
        life.objects(thing("a", "red", 0.5 + 0.5 * life.now_ns / NS_PER_S, 0.5))

    life.before_step = move
    sample = life.run(2.1)  # settled, and not yet searching for a cursor
    where = (4.85, -1.425 + 0.5 + 0.5 * sample.stamp_ns / NS_PER_S, 0.9)
    assert life.error_rad(sample, where) < math.radians(0.05)


@pytest.mark.slow
def test_cursor_leads_the_person_to_the_target_despite_all_errors() -> None:
    """They see it in frames only; the system believes that they turned by 10 deg."""
    config = PRECISE.model_copy(update={"aim": AimConfig(), "arm": ArmConfig()})
    finals: list[float] = []
    for seed in range(40):
        life = Life(config, seed)
        life.state("pointing")
        target = thing("a", "green", 2.0)
        life.light(off_rad=math.radians(10.0))
        life.before_step = lambda life=life, target=target: life.objects(target)
        life.person._behaviour = Staring()
        life.run(4.0)
        shown = [c.position_m for c in life.cursors[-25:] if c.surface == "strip"]
        finals.append(math.degrees(float(np.median(np.abs(np.array(shown) - 2.0))) / 3.0))

    assert np.median(finals) < 0.9  # the closed-loop median of people: 0.7
    assert np.quantile(finals, 0.9) < 2.0


class Staring:
    """Wants to point at the only thing there is."""

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:
        seen = sight.find("a", now_ns)
        return REST if seen is None else on_object(seen, sight, closed_loop=True)


def test_person_is_the_same_for_the_same_seed() -> None:
    def trace(seed: int) -> list[tuple[float, float, float, float]]:
        life = Life(UserSimConfig(yaw_deg=None), seed)
        life.state("pointing")
        life.before_step = lambda: life.objects(thing("a", "red", 2.0))
        return [life.run(0.02).orientation_xyzw for _ in range(100)]

    assert trace(1) == trace(1)
    assert trace(1) != trace(2)


PERIOD_NS = 20_000_000
PERIOD_S = 0.02
BEGIN_NS = 1_000_000_000
TARGETS: tuple[Vec3, ...] = ((2.0, -1.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0))
"""2 to 2.24 m away."""
PEOPLE = 90
WITHIN_M = 0.1


class Laser(Eyes):
    """See a point of light on the floor: each frame's number says which."""

    def __init__(self) -> None:
        super().__init__()
        self.points: list[Vec3 | None] = []
        self._shown: Vec3 | None = None

    def open(self, frame: StripsFrame) -> None:
        self._shown = self.points[frame.seq]

    def cursor(
        self,
        kind: Kind,
        expected_m: Vec3 | None = None,  # noqa: ARG002 - as the eyes have it
        things: Iterable[Span] = (),  # noqa: ARG002 - as the eyes have it
    ) -> SeenCursor | None:
        return None if self._shown is None else SeenCursor(kind, "floor", 0.0, self._shown, 0.1)


@functools.cache
def pointing_at_the_floor(number: int) -> tuple[tuple[float, ...], float]:
    """Return the distance from the light to the target, m, at every step, and the reach, rad."""
    person = SimulatedPerson(
        UserSimConfig(position_m=(0.0, 0.0, 0.0), target_kinds=("spot",)), "a", np.random.default_rng(number)
    )
    laser = Laser()
    person._sight.eyes = laser
    eyes_m = Stance(BodyMeasures()).eyes_m
    target = TARGETS[number % len(TARGETS)]
    spot = TrackedObject(id="spot", kind="spot", position_m=target, length_m=2 * WITHIN_M)
    person.see(0, UserProfile(stamp_ns=0))
    person.see(0, Feedback(stamp_ns=0, cue="started"))
    off_m: list[float] = []
    amplitude_rad = 0.0
    for step in range(round(6.0 / PERIOD_S)):
        now_ns = step * PERIOD_NS
        if now_ns >= BEGIN_NS:
            person.see(now_ns, TrackedObjects(stamp_ns=now_ns, objects=(spot,)))
        sample, _ = person.step(now_ns)
        assert sample is not None
        finger = rotation.rotate(sample.orientation_xyzw, (0.73, 0.0, 0.0))
        ray = vector.normalized(vector.subtract(finger, (0.0, 0.0, 0.21)))
        reach_m = eyes_m[2] / -ray[2] if ray[2] < -0.1 else math.inf
        point = vector.add(eyes_m, vector.scale(ray, reach_m)) if reach_m < 15.0 else None
        laser.points.append(point)
        person.see(now_ns, StripsFrame(stamp_ns=now_ns, seq=step, strips=()))
        if now_ns == BEGIN_NS:
            amplitude_rad = vector.angle_between(ray, vector.subtract(target, eyes_m))
        if now_ns >= BEGIN_NS:
            off_m.append(math.inf if point is None else math.dist(point, target))
    return tuple(off_m), amplitude_rad


def time_to_stay_s(off_m: tuple[float, ...]) -> float:
    """Return from when on the light stays within reach until 5 s are over; infinite when it does not."""
    outside = np.flatnonzero(np.array(off_m) > WITHIN_M)
    if not len(outside):
        return 0.0
    return math.inf if outside[-1] == len(off_m) - 1 else (int(outside[-1]) + 1) * PERIOD_S


@pytest.mark.slow
def test_time_to_stay_within_10_cm_at_2_m() -> None:
    """Measured: median 2.86 s, 11 % not within 5 s."""
    times_s = np.array([time_to_stay_s(pointing_at_the_floor(number)[0]) for number in range(PEOPLE)])
    late = float(np.mean(np.isinf(times_s)))
    print(f"\ntime to stay: median {np.median(times_s):.2f} s, {late:.0%} not within 5 s")  # noqa: T201
    assert 2.0 < np.median(times_s) < 3.4
    assert late < 0.2


RED = thing("r", "red", 1.0)
SECOND = thing("s", "red", 4.0)


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


@pytest.mark.parametrize(
    ("before", "left"),
    [("idle", "localizing"), ("localizing", "pointing"), ("pointing", "idle"), ("pointing", "pointing")],
)
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


def test_arm_rests_and_continues_without_a_jump_when_it_yields() -> None:
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
def test_selection_by_another_client_is_kept(selects: str) -> None:
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
    press = ButtonModel(UserSimConfig(anchor_when_off_deg=5.0, lost_press_s=4.0))
    perceived = PerceivedState()
    perceived.state = "pointing"
    now_s = 0.0

    def pressed(duration_s: float) -> list[str]:
        nonlocal now_s
        end_s = now_s + duration_s
        gestures = list[str]()
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


async def test_service_is_silent_while_a_page_moves_the_wrist() -> None:
    async with memory_bench(VirtualClock()) as bench:
        samples = bench.collect(IMU)
        presses = bench.collect(BUTTON)
        reports = bench.collect(HEALTH)
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
        seen = len(samples)
        stopped_ns = bench.clock.now_ns()
        await until(is_said)
        await until(lambda: len(samples) > seen, what="the person again")
        assert 0.95 < (samples[seen].stamp_ns - stopped_ns) / (WRIST_PATIENCE_S * NS_PER_S) < 1.6
        await until(lambda: not is_said())
        assert presses == []  # three seconds after their birth, without a profile
