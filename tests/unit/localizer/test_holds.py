"""A hold: when it begins and ends, and its rays for the solver; pointings at lamps that are not taken."""

import dataclasses
import math

import numpy as np
import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, BodyMeasures, Lamp, PointingRay, UserPose
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, SolverSettings
from pointit.services.localizer.estimation.unfiltered_rays import Mean, believed, mean, unfiltered
from pointit.services.localizer.heading_window import HeadingWindow
from pointit.services.localizer.procedure import Hold
from pointit.services.localizer.static_targets import StaticTargets
from pointit.services.localizer.verification import held, outlier_lamps, without_spikes
from pointit.services.pointing.pointer import ArmRay
from tests.support import there
from tests.unit.localizer.person import EYES_M, START_NS, Person, config, pointings, told
from tests.unit.localizer.test_static_targets import TICK_NS

LAMPS: tuple[Vec3, ...] = (
    (3.0, 2.0, 0.1),
    (-3.0, 2.5, 0.9),
    (-2.5, -3.0, 2.0),
    (3.0, -2.0, 0.3),
    (0.0, 3.5, 2.4),
    (0.5, -3.5, 1.2),
)
RAYS = 40
NAMES = [each.name for each in dataclasses.fields(Pointings)]
UNLIMITED = dataclasses.replace(SolverSettings().unlimited(), max_act_residual_rad=math.inf)
TURNS: dict[str, Quaternion] = {
    "across": rotation.from_yaw(math.pi / 2.0),
    "backwards": rotation.from_yaw(math.pi),
    "along": rotation.IDENTITY,
}


def pointed(
    seed: int, lamps_m: tuple[Vec3, ...], *, wrong: int | None = None, turn: Quaternion = rotation.IDENTITY
) -> tuple[Person, Pointings]:
    """Return a person, and a hold of 2 s at each of `lamps_m`, each another few degrees off.

    Number `wrong` was at another lamp; the sensor is turned by `turn` on an arm that rolls.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1.0, 1.0, 2).tolist()
    person = Person(x, y, float(rng.uniform(-3.0, 3.0)), float(rng.normal(0.0, math.radians(4.0))))
    aims = list(lamps_m)
    if wrong is not None:
        aims[wrong] = lamps_m[(wrong + 1) % len(lamps_m)]
    sensors: list[Quaternion] = []
    for aim in aims:
        ray = person.direction(aim)
        off_rad = rng.normal(0.0, np.radians([3.0, 1.5]))
        elevation = vector.elevation(ray) + float(off_rad[1])
        body = BodyMeasures()
        raised = elevation + math.asin(
            body.neck_to_eyes_m * math.cos(elevation) / (body.shoulder_to_wrist_m + body.wrist_to_finger_m)
        )
        arm = rotation.from_azimuth_elevation(vector.azimuth(ray) + float(off_rad[0]), raised)
        rolled = rotation.from_axis_angle((1.0, 0.0, 0.0), float(rng.normal(0.0, math.radians(10.0))))
        sensors += [rotation.multiply(rotation.multiply(arm, rolled), turn)] * RAYS
    origins, directions = ArmRay().rays(np.array(sensors))
    stamps_s = np.arange(len(sensors)) / 20.0 + 2.0 * np.repeat(np.arange(len(aims)), RAYS)
    return person, Pointings(stamps_s, origins, directions, np.repeat(np.array(lamps_m), RAYS, axis=0))


def error_m(found: Solution, person: Person) -> float:
    return math.hypot(found.x_m - person.x, found.y_m - person.y)


@pytest.mark.slow
@pytest.mark.parametrize("swap", [(0, 1), (3, 5)])
def test_lamps_that_are_swapped_in_the_map_are_named(swap: tuple[int, int]) -> None:
    reasons: list[str] = []
    first, second = ("abcdef"[each] for each in swap)
    order = np.arange(len(LAMPS))
    order[list(swap)] = swap[::-1]
    for seed in range(20):
        rays = pointed(seed, LAMPS)[1]
        swapped = np.array(LAMPS)[order].repeat(RAYS, axis=0)
        found = held(dataclasses.replace(rays, targets_m=swapped), SolverSettings(), lamps="abcdef")
        assert isinstance(found, Refusal)
        reasons.append(found.reason)
    assert sum(f"agree if the lamps {first} and {second} are swapped" in reason for reason in reasons) >= 18
    assert all(f"{first} and {second}" in reason for reason in reasons if "swapped" in reason)


@pytest.mark.slow
def test_one_pointing_at_another_lamp_is_ignored_when_five_agree() -> None:
    taken = 0
    for seed in range(20):
        wrong = seed % len(LAMPS)
        person, pointings = pointed(seed, LAMPS, wrong=wrong)
        assert outlier_lamps(pointings, SolverSettings()) in {(wrong,), ()}
        found = held(pointings, SolverSettings())
        if isinstance(found, Solution):
            taken += 1
            assert error_m(found, person) < max(0.5, 2.0 * found.position_sigma_m)
    assert taken >= 15


def test_one_mistaken_lamp_rarely_gives_a_confident_wrong_pose() -> None:
    wrong = 0
    for count in (3, 4):
        for seed in range(20):
            person, pointings = pointed(seed, LAMPS[:count], wrong=seed % count)
            found = held(pointings, SolverSettings())
            if isinstance(found, Solution):
                wrong += error_m(found, person) > max(0.5, 2.0 * found.position_sigma_m)
    assert wrong <= 2


def test_pointings_that_agree_leave_none_out() -> None:
    assert {outlier_lamps(pointed(seed, LAMPS)[1], SolverSettings()) for seed in range(20)} == {()}


@pytest.mark.parametrize("turn", ["across", "backwards"])
def test_turned_sensor_is_named_at_lamps(turn: str) -> None:
    named = 0
    for seed in range(20):
        found = held(pointed(seed, LAMPS[:4], turn=TURNS[turn])[1], SolverSettings())
        assert isinstance(found, Refusal)
        named += f"mounted {'backwards on' if turn == 'backwards' else 'across'} the arm" in found.reason
    assert named >= 10


def test_procedure_tells_which_pointing_does_not_count() -> None:
    lamps = tuple(Lamp(id=name, position_m=at) for name, at in zip("abcdef", LAMPS, strict=True))
    places = {lamp.id: lamp.position_m for lamp in lamps}
    procedure = StaticTargets(lamps, config())
    person = Person(0.6, -0.4, 2.2, math.radians(3.0))
    outputs = procedure.start(START_NS)
    for now_ns in range(START_NS, START_NS + 30 * NS_PER_S, TICK_NS):
        lit = told(outputs)[-1].target_id
        aim = places["e" if lit == "b" else lit or "a"]
        direction = person.direction(aim)
        procedure.on_ray(PointingRay(stamp_ns=now_ns, origin_m=(0.0, 0.0, EYES_M), direction=direction))
        outputs += procedure.step(now_ns)
    (pose,) = (each for each in outputs if isinstance(each, UserPose))
    assert math.hypot(pose.position_m[0] - person.x, pose.position_m[1] - person.y) < 0.1
    assert told(outputs)[-1].reason == "the pointing at b missed it by far and does not count"


STEADY = config(reaction_s=1.0, patience_s=3.0, steady_degps=8.0)


def ns(t_s: float) -> int:
    return START_NS + round(t_s * NS_PER_S)


def ray_at(t_s: float, azimuth_deg: float = 0.0, elevation_deg: float = -10.0) -> PointingRay:
    direction = vector.direction(math.radians(azimuth_deg), math.radians(elevation_deg))
    return PointingRay(stamp_ns=ns(t_s), origin_m=(0.0, 0.0, 1.64), direction=direction)


def reaching(hold: Hold, settles_s: float, until_s: float, jitter_deg: float = 0.0) -> None:
    """The arm turns at 40 °/s until `settles_s`, then rests; 50 rays a second, each given twice."""
    for tick in range(round(until_s * 50)):
        t_s = tick / 50.0
        wobble = jitter_deg if tick % 2 else -jitter_deg
        hold.add(ray_at(t_s, 40.0 * min(0.0, t_s - settles_s) + wobble))
        hold.add(ray_at(t_s, 90.0))


def test_hold_without_a_gate_begins_after_the_reaction_time() -> None:
    hold = Hold(START_NS, config(reaction_s=1.0))
    reaching(hold, 1.6, 3.1)
    assert hold.rays[0].stamp_ns == ns(1.02)
    assert not hold.is_over(ns(2.99), 10)
    assert hold.is_over(ns(3.0), 10)
    assert not hold.is_over(ns(3.0), 1000)


@pytest.mark.parametrize("jitter_deg", [0.0, 0.3])
def test_a_slow_reach_is_waited_for(jitter_deg: float) -> None:
    hold = Hold(START_NS, STEADY)
    reaching(hold, 1.8, 2.0, jitter_deg)
    assert not hold.is_settled
    assert hold.progress(ns(2.0)) == 0.0
    assert not hold.is_over(ns(9.0), 0)
    hold = Hold(START_NS, STEADY)
    reaching(hold, 1.8, 4.5, jitter_deg)
    assert hold.is_settled
    assert 1.6 <= (hold.rays[0].stamp_ns - START_NS) / NS_PER_S <= 1.9
    off = [abs(math.degrees(vector.azimuth(each.direction))) for each in hold.rays]
    assert max(off) < 8.0  # nothing of the reach but its end
    assert hold.is_over(hold.rays[0].stamp_ns + 2 * NS_PER_S, 20)


def test_steady_ray_settles_without_delay() -> None:
    hold = Hold(START_NS, STEADY)
    reaching(hold, 0.5, 3.2)
    assert hold.rays[0].stamp_ns == ns(1.02)
    assert hold.is_over(ns(3.0), 20)


def test_ray_that_never_settles_counts_in_the_end() -> None:
    hold = Hold(START_NS, STEADY)
    reaching(hold, 100.0, 6.5)
    assert hold.is_settled
    assert 3.5 <= (hold.rays[0].stamp_ns - START_NS) / NS_PER_S <= 4.1
    assert hold.is_over(ns(6.1), 20)


def test_silence_is_hopeless_after_patience() -> None:
    hold = Hold(START_NS, STEADY)
    assert not hold.has_timed_out(ns(5.9))
    assert hold.has_timed_out(ns(6.0))


def test_the_unfiltered_ray_is_the_raw_one_with_the_offset() -> None:
    raw = vector.direction(1.0, -0.2)
    plain = ray_at(0.0)
    assert unfiltered(plain) == plain.direction
    corrected = plain.model_copy(
        update={"raw_direction": raw, "azimuth_correction_rad": 0.05, "elevation_correction_rad": -0.1}
    )
    assert unfiltered(corrected) == pytest.approx(vector.direction(1.05, -0.3))
    assert unfiltered(plain.model_copy(update={"raw_direction": raw})) == raw


def test_a_calibrated_person_has_a_narrower_prior() -> None:
    trust = SolverSettings()
    known = ray_at(0.0).model_copy(update={"elevation_sigma_rad": math.radians(1.2)})
    assert believed(trust, [known, known]).bias_sigma_rad == pytest.approx(math.radians(1.2))
    assert believed(trust, [known, ray_at(1.0)]).bias_sigma_rad == trust.bias_sigma_rad
    exact = known.model_copy(update={"elevation_sigma_rad": 0.0})
    assert believed(trust, [exact]).bias_sigma_rad == pytest.approx(math.radians(1.0))
    vague = known.model_copy(update={"elevation_sigma_rad": 3.0})
    assert (believed(trust, [vague]).bias_sigma_rad, believed(trust, [])) == (trust.bias_sigma_rad, trust)


def test_the_mean_ray_with_its_spread_and_its_time() -> None:
    rays = [ray_at(0.0, -2.0, 0.0), ray_at(1.0, 2.0, 0.0)]
    middle = there(mean(rays))
    assert math.degrees(middle.spread_rad) == pytest.approx(2.0)
    assert middle.stamp_ns == ns(0.5)
    assert middle.direction == pytest.approx((1.0, 0.0, 0.0))
    assert mean([]) is None
    assert mean([ray_at(0.0, 0.0, 0.0), ray_at(1.0, 180.0, 0.0)]) is None


def test_facing_takes_the_last_half_second_when_it_is_steady() -> None:
    facing = HeadingWindow()
    assert "no rays come" in str(facing.mean(ns(0.0)))
    for tick in range(200):
        facing.add(ray_at(tick / 50.0, 80.0 if tick < 170 else 10.0))
    told = facing.mean(ns(4.0))
    assert isinstance(told, Mean)
    assert math.degrees(vector.azimuth(told.direction)) == pytest.approx(10.0)
    assert "no rays come" in str(facing.mean(ns(5.0)))
    for tick in range(50):
        facing.add(ray_at(4.0 + tick / 50.0, 4.0 * (tick % 5)))
    assert "the arm moves by" in str(facing.mean(ns(5.0)))
    for tick in range(50):
        facing.add(ray_at(5.0 + tick / 50.0, 0.0, -75.0))
    assert "too steeply" in str(facing.mean(ns(6.0)))


SPIKE = np.array([-1.0, 0.2, 0.1]) / np.linalg.norm([-1.0, 0.2, 0.1])


@pytest.mark.parametrize("at", [0, 1, 20, 38, 39])
def test_one_ray_that_leaps_is_left_out_and_no_other(at: int) -> None:
    steady = pointings(Person(), [(3.0, 1.0, 1.0)], each=40, noise_rad=0.01)
    assert len(without_spikes(steady)) == 40
    steady.directions[at] = SPIKE
    left = without_spikes(steady)
    assert list(left.stamps_s) == [stamp for index, stamp in enumerate(steady.stamps_s) if index != at]
