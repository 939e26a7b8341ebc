"""The whole person, by themselves and through the service: what they do when, and where they point."""

import math

import numpy as np
import pytest

from pointit.geometry import rotation, vector
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Cursor,
    ImuSample,
    Interaction,
    LampColor,
    Localization,
    SelectedObject,
    Selection,
    TrackedObject,
)
from pointit.schemas.topics import BUTTON, IMU, INTERACTION
from pointit.services.user_sim.config import AimConfig, ArmConfig, UserSimConfig
from pointit.services.user_sim.person import Person
from pointit.services.user_sim.service import UserSim
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.user_sim.life import PRECISE, ROOM, Life, thing


def test_the_button_is_pressed_after_thinking_and_again_after_a_pause() -> None:
    life = Life(PRECISE)
    life.run(3.0)
    assert life.presses == []  # nobody says what state the interaction is in
    life.state("idle")
    life.run(5.9)
    assert [round((t - 3 * NS_PER_S) / NS_PER_S, 1) for t in life.presses] == [1.2]
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
    life = Life(PRECISE)
    life.state("idle")
    assert vector.elevation(life.ray(life.run(2.0))) < math.radians(-60.0)


def test_the_lit_lamp_is_pointed_at_after_the_reaction_time() -> None:
    life = Life(PRECISE)
    life.state("localizing")
    resting = life.ray(life.run(1.0))
    life.person.see(life.now_ns, LampColor(stamp_ns=0, color=(255, 255, 255)), "led_1")
    assert vector.angle_between(life.ray(life.run(0.34)), resting) < 1e-9
    assert vector.angle_between(life.ray(life.run(0.1)), resting) > 1e-3
    settled = life.run(2.0)
    assert life.error_rad(settled, ROOM.lamps[0].position_m) < 1e-6
    life.person.see(life.now_ns, LampColor(stamp_ns=0, color=(0, 0, 0)), "led_1")
    life.person.see(life.now_ns, LampColor(stamp_ns=0, color=(0, 0, 9)), "led_2")
    assert life.error_rad(life.run(2.0), ROOM.lamps[1].position_m) < 1e-6


def test_the_lamp_that_the_own_localizer_names_comes_before_any_that_is_lit() -> None:
    life = Life(PRECISE)
    life.state("localizing")
    life.person.see(life.now_ns, LampColor(stamp_ns=0, color=(255, 255, 255)), "led_1")
    own = Localization(stamp_ns=0, phase="sampling", target_id="led_2")
    life.person.see(life.now_ns, own)
    assert life.error_rad(life.run(3.0), ROOM.lamps[1].position_m) < 1e-6


def test_without_a_cursor_people_err_as_measured() -> None:
    config = PRECISE.model_copy(update={"aim": AimConfig()})
    errors: list[float] = []
    for seed in range(60):
        life = Life(config, seed)
        life.state("localizing")
        life.person.see(0, LampColor(stamp_ns=0, color=(255, 255, 255)), "led_1")
        errors.append(math.degrees(life.error_rad(life.run(3.0), ROOM.lamps[0].position_m)))
    assert 4.0 < np.median(errors) < 8.0  # 6.7 degrees in the recordings


def test_a_moving_object_is_followed_where_it_is_not_where_it_was_seen() -> None:
    life = Life(PRECISE)
    life.state("pointing")

    def move() -> None:
        life.objects(thing("a", "red", 0.5 + 0.5 * life.now_ns / NS_PER_S, 0.5))

    life.before_step = move
    sample = life.run(1.8)  # settled, and not yet searching for a cursor
    where = (4.85, -1.425 + 0.5 + 0.5 * sample.stamp_ns / NS_PER_S, 0.9)
    assert life.error_rad(sample, where) < math.radians(0.05)


def test_the_cursor_takes_the_person_to_the_target_although_everything_errs() -> None:
    config = PRECISE.model_copy(update={"aim": AimConfig(), "arm": ArmConfig()})
    finals: list[float] = []
    for seed in range(40):
        life = Life(config, seed)
        life.state("pointing")
        drift_rad = math.radians(10.0)  # the system believes the person turned by so much
        target = thing("a", "red", 2.0)
        last: list[Cursor] = []

        def show(life: Life = life, last: list[Cursor] = last, target: TrackedObject = target) -> None:
            life.objects(target)
            if last:
                life.person.see(life.now_ns, last[-1])

        life.before_step = show
        for _ in range(200):
            sample = life.run(0.02)
            direction = vector.turn(life.ray(sample), drift_rad)
            # where the turned ray crosses x = 4.85, brought onto the strip
            reach = (4.85 - life.eyes_m[0]) / direction[0] if direction[0] > 0.1 else math.inf
            y_m = life.eyes_m[1] + reach * direction[1]
            last.append(
                Cursor(
                    stamp_ns=sample.stamp_ns,
                    surface="strip",
                    surface_id="0",
                    point_m=(4.85, min(max(y_m, -1.425), 3.575), 0.9),
                )
                if reach < 10.0
                else Cursor(stamp_ns=sample.stamp_ns)
            )
        shown = [c.point_m for c in last[-25:] if c.point_m is not None]
        off_m = np.array([point[1] - target.position_m[1] for point in shown])
        finals.append(math.degrees(float(np.median(np.abs(off_m))) / 3.0))
    assert len(finals) == 40
    assert np.median(finals) < 0.7  # the closed-loop median of people
    assert np.quantile(finals, 0.9) < 1.6


def choice(life: Life, duration_s: float = 1.0) -> str:
    life.run(duration_s)
    return life.person.goal.key


def test_the_red_object_that_leaves_first_is_chosen_but_not_one_beyond_reach() -> None:
    life = Life(PRECISE)
    life.state("pointing")
    life.before_step = lambda: life.objects(
        thing("gone", "red", 4.9, 0.25),
        thing("second", "red", 2.0, 0.25),
        thing("first", "red", 3.0, 0.25),
        thing("blue", "blue", 3.5, 0.25),
    )
    assert choice(life) == "object first"
    life.person.see(
        life.now_ns,
        Selection(stamp_ns=0, objects=(SelectedObject(id="first", user="anna", since_ns=0),)),
    )
    assert choice(life) == "object second"
    both = tuple(SelectedObject(id=name, user="anna", since_ns=0) for name in ("first", "second"))
    life.person.see(life.now_ns, Selection(stamp_ns=0, objects=both))
    assert choice(life) == "rest"


@pytest.mark.parametrize(("along_m", "speed_mps"), [(0.0, 0.1), (5.0, -0.1)])
def test_an_object_that_is_still_coming_in_is_waited_for(along_m: float, speed_mps: float) -> None:
    life = Life(PRECISE)
    life.state("pointing")
    life.before_step = lambda: life.objects(
        thing("a", "red", along_m + speed_mps * life.now_ns / NS_PER_S, speed_mps)
    )
    assert choice(life, 2.9) == "rest"
    assert choice(life, 0.5) == "object a"


def test_what_was_selected_by_accident_is_taken_back_what_others_selected_is_left() -> None:
    life = Life(PRECISE)
    life.state("pointing")
    life.before_step = lambda: life.objects(thing("b", "blue", 2.0, 0.1), thing("r", "red", 1.0, 0.1))
    theirs = Selection(
        stamp_ns=0,
        objects=(
            SelectedObject(id="r", user="ben", since_ns=0),
            SelectedObject(id="b", user="ben", since_ns=0),
        ),
    )
    life.person.see(life.now_ns, theirs)
    assert choice(life) == "rest"
    own = SelectedObject(id="b", user="anna", since_ns=0)
    mine = theirs.model_copy(update={"objects": (theirs.objects[0], own)})
    life.person.see(life.now_ns, mine)
    assert choice(life) == "object b"


def test_an_object_that_cannot_be_selected_is_given_up_for_a_while() -> None:
    life = Life(PRECISE)
    life.state("pointing")
    life.before_step = lambda: life.objects(thing("a", "red", 2.0), thing("b", "red", 1.0))
    first = choice(life)
    second = choice(life, PRECISE.give_up_s)
    assert {first, second} == {"object a", "object b"}
    assert choice(life, PRECISE.give_up_s) == first


def test_along_the_strip_end_to_end() -> None:
    config = PRECISE.model_copy(update={"behaviour": "strips"})
    life = Life(config)
    life.state("pointing")
    ends: list[float] = []
    for _ in range(1100):
        direction = life.ray(life.run(0.02))
        if life.now_ns > 2 * NS_PER_S:
            y_m = life.eyes_m[1] + (4.85 - life.eyes_m[0]) / direction[0] * direction[1]
            ends.append(y_m)
    assert min(ends) == pytest.approx(-1.425, abs=0.05)
    assert max(ends) == pytest.approx(3.575, abs=0.05)
    speeds = np.abs(np.diff(ends)) * 50
    assert np.median(speeds) == pytest.approx(0.5, rel=0.05)


def test_a_lost_cursor_is_searched_for() -> None:
    life = Life(PRECISE)
    life.state("pointing")
    life.before_step = lambda: life.objects(thing("a", "red", 2.0))
    elevations = [vector.elevation(life.ray(life.run(0.1))) for _ in range(40)][15:]
    assert math.degrees(max(elevations) - min(elevations)) > 8.0


def test_the_same_seed_is_the_same_person() -> None:
    def trace(seed: int) -> list[tuple[float, float, float, float]]:
        life = Life(UserSimConfig(yaw_deg=None), seed)
        life.state("pointing")
        life.before_step = lambda: life.objects(thing("a", "red", 2.0))
        return [life.run(0.02).orientation_xyzw for _ in range(100)]

    assert trace(1) == trace(1)
    assert trace(1) != trace(2)


def test_an_unknown_yaw_origin_differs_between_people() -> None:
    resting = [
        vector.azimuth(
            rotation.rotate(Life(UserSimConfig(yaw_deg=None), s).run(0.02).orientation_xyzw, (1, 0, 0))
        )
        for s in range(8)
    ]
    # the arm hangs at the yaw origin; what differs is where that lies in the room
    assert np.allclose(resting, 0.0, atol=0.1)
    origins = {
        round(Person(UserSimConfig(yaw_deg=None), "a", np.random.default_rng(s)).yaw_rad, 3) for s in range(8)
    }
    assert len(origins) == 8


async def test_the_service_sends_samples_and_presses_its_persons_button() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        samples: list[ImuSample] = bench.collect(IMU, "anna")
        presses: list[ButtonEvent] = bench.collect(BUTTON, "anna")
        bench.start(UserSim, UserSimConfig(rate_hz=200.0), user="anna")
        await until(lambda: len(samples) > 1)
        assert samples[-1].stamp_ns == clock.now_ns()
        bench.put(INTERACTION, Interaction(stamp_ns=0, state="idle"), "ben")
        bench.put(INTERACTION, Interaction(stamp_ns=0, state="pointing"), "anna")
        await bench.settle()
        for _ in range(5):
            clock.advance(1.0)
            seen = len(samples)
            await until(lambda: len(samples) > seen + 1)  # noqa: B023 - awaited within the loop
        assert presses == []
        bench.put(INTERACTION, Interaction(stamp_ns=0, state="idle"), "anna")
        await bench.settle()
        for _ in range(5):
            clock.advance(0.5)
            seen = len(samples)
            await until(lambda: len(samples) > seen + 1)  # noqa: B023 - awaited within the loop
        await until(lambda: len(presses) == 1)
