"""Lamps in sequence, and the choice of the next one."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Lamp
from pointit.services.localizer.estimation.solution import Refusal
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.static_targets import (
    ObservationModel,
    StaticTargets,
    best_for_yaw,
    fisher_information,
    lamp_for_anchor,
    next_target,
    prior,
)
from tests.support import there
from tests.unit.localizer.person import (
    EYES_M,
    LAB,
    START_NS,
    Person,
    config,
    poses,
    told,
    yaw_difference,
)

LAMPS = (
    Lamp(id="a", position_m=(3.0, 2.0, 0.1)),
    Lamp(id="b", position_m=(-3.0, 2.5, 0.9)),
    Lamp(id="c", position_m=(-2.5, -3.0, 2.0)),
)
PLACES = {lamp.id: lamp.position_m for lamp in LAMPS}
TICK_NS = NS_PER_S // 50


def lamps_lit(outputs: list[Output]) -> set[str]:
    return {told(outputs)[-1].target_id} - {""}


def run(
    procedure: StaticTargets,
    person: Person,
    duration_s: float,
    *,
    start_ns: int = START_NS,
    delay_s: float = 1.2,
    tick_ns: int = TICK_NS,
    outputs: list[Output] | None = None,
) -> list[Output]:
    """Have `person` point at what is lit, `delay_s` late; until then the arm stays where it was."""
    outputs = outputs if outputs is not None else procedure.start(start_ns)
    aim = (1.0, 1.0, 1.0)
    since_ns = start_ns
    current = ""
    for now_ns in range(start_ns, start_ns + round(duration_s * NS_PER_S), tick_ns):
        lit = "".join(lamps_lit(outputs))
        if lit != current:
            current = lit
            since_ns = now_ns
        if current and now_ns - since_ns >= delay_s * NS_PER_S:
            aim = PLACES[current]
        procedure.on_ray(person.ray(aim, now_ns))
        outputs += procedure.step(now_ns)
    return outputs


def test_lamps_in_sequence_then_the_pose_and_darkness() -> None:
    person = Person(0.6, -0.4, 2.2, math.radians(3.0))
    procedure = StaticTargets(LAMPS, config())
    outputs = run(procedure, person, 12.0)
    assert [lamp for lamp, _ in itertools.groupby(news.target_id for news in told(outputs))] == [*"abc", ""]
    assert not procedure.running

    (pose,) = poses(outputs)
    assert math.hypot(pose.position_m[0] - person.x, pose.position_m[1] - person.y) < 0.1
    assert abs(pose.position_m[2]) < 0.05  # the height of the eyes is not known better
    assert abs(yaw_difference(pose.yaw_rad, person.yaw_rad)) < 0.03
    assert pose.method == "static_targets"
    assert pose.covariance[0] > 0.0

    last = told(outputs)[-1]
    assert (last.phase, last.progress, last.target_id) == ("solved", 1.0, "")
    assert last.samples == pose.samples == pytest.approx(300, abs=6)
    # 3 lamps, each 1.5 s of reaction and 2 s of holding
    assert (last.stamp_ns - START_NS) / NS_PER_S == pytest.approx(10.5, abs=0.1)
    assert 0 <= last.stamp_ns - pose.stamp_ns < NS_PER_S // 10  # the pose bears its newest ray's time


def test_rays_during_the_reaction_do_not_count() -> None:
    """The person's arm is still at the lamp before for the first 1.2 s; it would cost degrees."""
    outputs = run(StaticTargets(LAMPS, config()), Person(0.6, -0.4, 2.2), 12.0)
    (pose,) = poses(outputs)
    assert pose.residual_rad < math.radians(0.5)
    hasty = run(StaticTargets(LAMPS, config(reaction_s=0.0)), Person(0.6, -0.4, 2.2), 12.0)
    assert told(hasty)[-1].phase == "refused"
    assert "rays miss the targets" in told(hasty)[-1].reason
    assert not lamps_lit(hasty)


def test_rays_that_come_late_are_waited_for() -> None:
    procedure = StaticTargets(LAMPS, config())
    outputs = procedure.start(START_NS)
    outputs += procedure.step(START_NS + 5 * NS_PER_S)  # the hold is over, nothing came
    outputs = run(procedure, Person(0.2, 0.1), 12.0, start_ns=START_NS + 5 * NS_PER_S, outputs=outputs)
    assert told(outputs)[-1].phase == "solved"


def test_rays_of_a_slow_imu_suffice_over_all_given_lamps() -> None:
    """Eight in each hold of 2 s, 24 of three lamps, where 20 are needed."""
    outputs = run(StaticTargets(LAMPS, config()), Person(0.6, -0.4), 15.0, tick_ns=NS_PER_S // 4)
    last = told(outputs)[-1]
    assert last.phase == "solved"
    assert last.samples == pytest.approx(25, abs=2)
    assert (last.stamp_ns - START_NS) / NS_PER_S == pytest.approx(10.5, abs=0.3)


GOOD = (
    Lamp(id="high", position_m=(4.0, 0.5, 1.7)),
    Lamp(id="near_high", position_m=(4.0, 0.7, 1.7)),
    Lamp(id="low", position_m=(1.5, -3.0, 0.1)),
    Lamp(id="left", position_m=(-2.0, 2.0, 0.1)),
    Lamp(id="back", position_m=(-2.5, -2.0, 0.3)),
)
EYE_HIGH = (Lamp(id="a", position_m=(2.0, 3.0, 1.64)), Lamp(id="b", position_m=(2.5, 3.0, 1.64)))
ANNA = Person(0.6, -0.4, 2.2, math.radians(3.0))
SURE = config(order="informative", enough={"yaw_deg": 3.0})


def chosen(procedure: StaticTargets, person: Person = ANNA, error_deg: float = 0.0) -> list[Output]:
    """The person points at what is lit, each time another `error_deg` (1 sigma) off."""
    generator = np.random.default_rng(1)
    places = {lamp.id: lamp.position_m for lamp in (*GOOD, *EYE_HIGH)}
    outputs = procedure.start(START_NS)
    lit = ""
    off = (0.0, 0.0)
    for tick in range(50 * 120):
        now_ns = START_NS + tick * NS_PER_S // 50
        last = told(outputs)[-1]
        if last.target_id and last.target_id + str(last.target_index) != lit:
            lit = last.target_id + str(last.target_index)
            azimuth, elevation = generator.normal(0.0, math.radians(error_deg), 2)
            off = (float(azimuth), float(elevation))
        aiming = Person(person.x, person.y, person.yaw_rad - off[0], person.bias_rad + off[1])
        procedure.on_ray(aiming.ray(places[last.target_id], now_ns))
        outputs += procedure.step(now_ns)
        if not procedure.running:
            break
    return outputs


def order(outputs: list[Output]) -> list[str]:
    holds = ((news.target_index, news.target_id) for news in told(outputs) if news.target_id)
    return [lamp for (_, lamp), _ in itertools.groupby(holds)]


def test_it_stops_when_it_is_sure_enough() -> None:
    outputs = chosen(StaticTargets(GOOD, SURE))
    (pose,) = poses(outputs)
    assert math.hypot(pose.position_m[0] - ANNA.x, pose.position_m[1] - ANNA.y) < 0.1
    assert abs(yaw_difference(pose.yaw_rad, ANNA.yaw_rad)) < 0.03
    assert 2 <= len(order(outputs)) < len(GOOD)
    last = told(outputs)[-1]
    assert last.phase == "solved"
    assert there(last.position_sigma_m) <= SURE.enough.position_m
    assert there(last.yaw_sigma_rad) <= math.radians(SURE.enough.yaw_deg)


def test_it_is_told_on_the_way_how_sure_it_is() -> None:
    strict = config(order="informative", enough={"position_m": 0.101, "yaw_deg": 0.2})
    outputs = chosen(StaticTargets(GOOD, strict))
    by_hold = {news.target_index: news.position_sigma_m for news in told(outputs) if news.phase == "sampling"}
    assert by_hold[0] is None
    assert by_hold[1] is None
    sigmas = [sigma for index, sigma in sorted(by_hold.items()) if index >= 2 and sigma is not None]
    assert len(sigmas) == len(by_hold) - 2
    assert {lamp.id for lamp in GOOD} == set(order(outputs)[: len(GOOD)])  # all, before one comes again
    assert len(order(outputs)) <= 2 * len(GOOD)
    assert told(outputs)[-1].phase == "solved"  # within what `trust` demands
    yaws = [news.yaw_sigma_rad for news in told(outputs) if news.yaw_sigma_rad is not None]
    assert yaws[-1] < yaws[0]


def test_no_more_than_were_asked_for() -> None:
    strict = config(order="informative", targets=3, enough={"yaw_deg": 0.2})
    outputs = chosen(StaticTargets(GOOD, strict))
    assert len(order(outputs)) == 3
    assert {news.target_count for news in told(outputs)} == {3}
    more = chosen(StaticTargets(EYE_HIGH, config(order="informative", targets=4)))
    assert sorted(order(more)) == ["a", "a", "b", "b"]


@pytest.mark.parametrize("targets", [3, 4, 5])
def test_no_fewer_than_were_asked_for_however_sure_it_is(targets: int) -> None:
    sure_at_once = config(order="informative", targets=targets, enough={"position_m": 9.0, "yaw_deg": 90.0})
    outputs = chosen(StaticTargets(GOOD, sure_at_once))
    assert (len(order(outputs)), told(outputs)[-1].phase) == (targets, "solved")
    assert (
        len(order(chosen(StaticTargets(GOOD, sure_at_once.model_copy(update={"targets": 0}))))) < targets + 1
    )


def test_unsolvable_lamps_are_refused_with_a_reason() -> None:
    outputs = chosen(StaticTargets(EYE_HIGH, SURE), error_deg=1.0)
    last = told(outputs)[-1]
    assert last.phase == "refused"
    assert last.reason.startswith("after pointing 4 times ")
    assert poses(outputs) == []
    assert order(outputs) in (["a", "b", "a", "b"], ["a", "b", "b", "a"], ["b", "a", "b", "a"])


CONVEYOR: tuple[Vec3, ...] = ((0.15, 0.05, 1.55), (-2.4, -0.025, 1.25), (-2.85, -3.775, 2.55))
SIGMA = math.radians(2.0)
ONE = ObservationModel(ray_sigma_rad=SIGMA, elevation_sigma_rad=SIGMA, body_sigma_m=0.0, bias_sigma_rad=1e-6)
"""One pointing of 2° a target, whose bias is known: the bound that pointing.md §4 gives."""


def bounds(targets_m: Sequence[Vec3], eyes_m: Vec3, acuity: ObservationModel) -> tuple[float, float]:
    """Return 1 sigma of position (m, both directions together) and yaw (rad) after a hold at each."""
    told: Array = fisher_information(np.array(targets_m), np.array([eyes_m]), acuity)[0].sum(axis=0)
    covariance = np.linalg.inv(told + prior(acuity)).astype(np.float64)
    return math.sqrt(covariance[0, 0] + covariance[1, 1]), math.sqrt(covariance[2, 2])


def around(distance_m: float, *azimuths_deg: float) -> list[Vec3]:
    return [
        (distance_m * math.cos(math.radians(a)), distance_m * math.sin(math.radians(a)), 0.0)
        for a in azimuths_deg
    ]


@pytest.mark.parametrize(
    ("targets", "stand", "position_m", "yaw_deg"),
    [
        # the maps are the original's; where people stood is not written down, so these are places in the
        # room from which the bound is as stated
        pytest.param(CONVEYOR[:2], (1.5, 1.1), 0.98, 9.0, id="two LEDs of the conveyor"),
        pytest.param(LAB[:2], (0.5, -0.3), 0.50, 7.2, id="two LEDs of the lab"),
        pytest.param(around(2.45, -64, 0, 64), (0.0, 0.0), 0.14, 2.3, id="three on the floor"),
        pytest.param(around(4.0, 45, 135, 225, 315), (0.0, 0.0), 0.14, 1.1, id="four in corners"),
    ],
)
def test_the_bounds_are_as_stated(
    targets: Sequence[Vec3], stand: tuple[float, float], position_m: float, yaw_deg: float
) -> None:
    sigma_m, sigma_rad = bounds(targets, (*stand, EYES_M), ONE)
    assert sigma_m == pytest.approx(position_m, rel=0.05)
    assert math.degrees(sigma_rad) == pytest.approx(yaw_deg, rel=0.05)


@given(st.integers(0, 10_000))
def test_the_choice_is_the_one_that_leaves_the_least_uncertainty(seed: int) -> None:
    generator = np.random.default_rng(seed)
    lamps: list[Vec3] = [
        (x, y, z) for x, y, z in generator.uniform((-4, -4, 0), (4, 4, 2.5), (5, 3)).tolist()
    ]
    place = (float(generator.uniform(-1, 1)), float(generator.uniform(-1, 1)))
    acuity = ObservationModel()
    chosen = next_target(lamps, [1, 1, 0, 0, 0], acuity, place_m=place)
    assert chosen in (2, 3, 4)
    eyes = (*place, EYES_M)

    def volume(index: int) -> float:
        seen = np.array([lamps[0], lamps[1], lamps[index]])
        told: Array = fisher_information(seen, np.array([eyes]), acuity)[0].sum(axis=0)
        prior = np.diag([1e-2, 1e-2, 1.0 / math.pi**2, acuity.bias_sigma_rad**-2])
        return float(np.linalg.det(np.linalg.inv(told + prior)[:3, :3]))

    assert volume(chosen) == pytest.approx(min(volume(index) for index in (2, 3, 4)), rel=1e-6)


def test_first_targets_are_not_in_the_same_direction() -> None:
    lamps: list[Vec3] = [(3.0, 0.0, 1.6), (3.05, 0.0, 1.6), (0.0, 3.0, 0.1), (-3.0, 0.0, 0.1)]
    first = next_target(lamps, [0, 0, 0, 0], ObservationModel())
    visits = [0, 0, 0, 0]
    visits[first] = 1
    second = next_target(lamps, visits, ObservationModel())
    assert {first, second} == {2, 3}  # low and far apart


def test_worlds_origin_and_the_order_of_lamps_do_not_matter() -> None:
    shifted = [(x + 100.0, y - 50.0, z + 7.0) for x, y, z in LAB]
    for visits in ([0, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0]):
        here = next_target(LAB, visits, ObservationModel())
        assert next_target(shifted, visits, ObservationModel(), floor_m=7.0) == here
        back = next_target(LAB[::-1], visits[::-1], ObservationModel())
        assert LAB[::-1][back] == LAB[here]


def test_yaw_is_determined_best_by_a_far_and_level_lamp() -> None:
    lamps: list[Vec3] = [(0.1, 0.0, 0.0), (1.0, 0.0, 1.6), (6.0, 0.0, 1.6), (1.0, 1.0, 5.0)]
    vague = np.diag([0.04, 0.04, 0.3])
    assert best_for_yaw(lamps, (0.0, 0.0), vague, ObservationModel()) == 2
    assert (
        best_for_yaw(lamps[:2], (0.0, 0.0), np.diag([0.0, 0.0, 0.3]), ObservationModel()) == 1
    )  # not at the feet
    assert best_for_yaw(lamps[:1], (0.0, 0.0), vague, ObservationModel()) == 0
    across = np.diag([0.0, 0.25, 0.3])  # uncertain sideways for the lamps ahead
    beside: list[Vec3] = [(4.0, 0.0, 1.6), (0.0, 4.0, 1.6)]
    assert best_for_yaw(beside, (0.0, 0.0), across, ObservationModel()) == 1


ROOM_WITH_LAMPS = Environment(stamp_ns=1, name="lab", lamps=LAMPS)


@pytest.mark.parametrize(
    ("asked", "remedy"),
    [("attic", "ask for one of those"), ("", "correct `lamps`")],
    ids=["asked", "configured"],
)
def test_refusal_of_a_missing_lamp_addresses_who_named_it(asked: str, remedy: str) -> None:
    refusal = lamp_for_anchor(ROOM_WITH_LAMPS, ("attic",), asked)
    assert isinstance(refusal, Refusal)
    assert refusal.reason.startswith("lamps attic are not on map ")
    assert refusal.reason.endswith(f"; {remedy}")
