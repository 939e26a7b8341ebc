"""The whole person, by themselves and through the service: what they do when, and where they point."""

import functools
import math
from collections.abc import Iterable

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    BodyMeasures,
    ButtonEvent,
    Feedback,
    ImuSample,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas.topics import BUTTON, FEEDBACK, IMU, PROFILE
from pointit.services.user_sim.config import AimConfig, ArmConfig, UserSimConfig
from pointit.services.user_sim.eyes import Eyes, Kind, SeenCursor, Span
from pointit.services.user_sim.goal import REST, PersonGoal, on_object
from pointit.services.user_sim.perceived_objects import Sight
from pointit.services.user_sim.person import SimulatedPerson
from pointit.services.user_sim.service import UserSim
from pointit.sim.aim import Stance
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.user_sim.life import PRECISE, ROOM, Life, living, thing


def test_the_button_is_pressed_after_thinking_and_again_after_a_pause() -> None:
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


def test_an_idle_arm_rests_towards_the_floor() -> None:
    life = living("idle")
    assert vector.elevation(life.ray(life.run(2.0))) < math.radians(-60.0)


def test_the_lit_lamp_is_pointed_at_after_the_reaction_time() -> None:
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


def test_without_a_cursor_people_err_as_measured() -> None:
    config = PRECISE.model_copy(update={"aim": AimConfig()})
    errors: list[float] = []
    for seed in range(60):
        life = Life(config, seed)
        life.state("localizing")
        life.shine("led_1")
        errors.append(math.degrees(life.error_rad(life.run(3.0), ROOM.lamps[0].position_m)))
    assert 4.0 < np.median(errors) < 8.0  # 6.7 degrees in the recordings


def test_a_moving_object_is_followed_where_it_is_not_where_it_was_seen() -> None:
    life = living("pointing")

    def move() -> None:
        life.objects(thing("a", "red", 0.5 + 0.5 * life.now_ns / NS_PER_S, 0.5))

    life.before_step = move
    sample = life.run(2.1)  # settled, and not yet searching for a cursor
    where = (4.85, -1.425 + 0.5 + 0.5 * sample.stamp_ns / NS_PER_S, 0.9)
    assert life.error_rad(sample, where) < math.radians(0.05)


def test_the_cursor_takes_the_person_to_the_target_although_everything_errs() -> None:
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


def test_the_same_seed_is_the_same_person() -> None:
    def trace(seed: int) -> list[tuple[float, float, float, float]]:
        life = Life(UserSimConfig(yaw_deg=None), seed)
        life.state("pointing")
        life.before_step = lambda: life.objects(thing("a", "red", 2.0))
        return [life.run(0.02).orientation_xyzw for _ in range(100)]

    assert trace(1) == trace(1)
    assert trace(1) != trace(2)


async def test_the_service_sends_samples_and_presses_its_persons_button() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        samples: list[ImuSample] = bench.collect(IMU, "anna")
        presses: list[ButtonEvent] = bench.collect(BUTTON, "anna")
        bench.start(UserSim, UserSimConfig(rate_hz=200.0), user="anna")
        await until(lambda: len(samples) > 1)
        assert samples[-1].stamp_ns == clock.now_ns()

        async def live(steps: int, step_s: float) -> None:
            for _ in range(steps):
                clock.advance(step_s)
                seen = len(samples)
                await until(lambda seen=seen: len(samples) > seen + 1)
                await bench.settle()

        bench.put(FEEDBACK, Feedback(stamp_ns=0, cue="started"), "anna")
        bench.put(FEEDBACK, Feedback(stamp_ns=0, cue="stopped"), "ben")
        await bench.settle()
        await live(8, 1.0)
        assert presses == []
        bench.put(PROFILE, UserProfile(stamp_ns=0), "anna")
        bench.put(FEEDBACK, Feedback(stamp_ns=0, cue="stopped"), "anna")
        await live(5, 0.5)
        await until(lambda: len(presses) == 1)


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


def test_time_to_stay_within_10_cm_at_2_m() -> None:
    """Measured: median 2.86 s, 11 % not within 5 s."""
    times_s = np.array([time_to_stay_s(pointing_at_the_floor(number)[0]) for number in range(PEOPLE)])
    late = float(np.mean(np.isinf(times_s)))
    print(f"\ntime to stay: median {np.median(times_s):.2f} s, {late:.0%} not within 5 s")  # noqa: T201
    assert 2.0 < np.median(times_s) < 3.4
    assert late < 0.2
