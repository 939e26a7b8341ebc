"""The procedure with lamps, in the given order or chosen for information, stepped in virtual time."""

import itertools
import math

import numpy as np
import pytest

from pointit.schemas import NS_PER_S, Lamp
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.static_targets import StaticTargets
from tests.support.known import known
from tests.unit.localizer.person import START_NS, Person, config, poses, told, yaw_difference

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
    aim, since_ns, current = (1.0, 1.0, 1.0), start_ns, ""
    for now_ns in range(start_ns, start_ns + round(duration_s * NS_PER_S), tick_ns):
        lit = "".join(lamps_lit(outputs))
        if lit != current:
            current, since_ns = lit, now_ns
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


def test_rays_of_a_slow_imu_suffice_if_all_given_lamps_together_bring_enough() -> None:
    """Eight in each hold of 2 s, 24 of three lamps, where 20 are needed."""
    outputs = run(StaticTargets(LAMPS, config()), Person(0.6, -0.4), 15.0, tick_ns=NS_PER_S // 4)
    last = told(outputs)[-1]
    assert last.phase == "solved"
    assert last.samples == pytest.approx(25, abs=2)
    assert (last.stamp_ns - START_NS) / NS_PER_S == pytest.approx(10.5, abs=0.3)


def test_repeated_and_older_rays_are_not_counted_twice() -> None:
    procedure = StaticTargets(LAMPS, config())
    procedure.start(START_NS)
    person = Person()
    for _ in range(50):
        procedure.on_ray(person.ray(PLACES["a"], START_NS + 2 * NS_PER_S))
        procedure.on_ray(person.ray(PLACES["a"], START_NS + 2 * NS_PER_S - 1))
    assert told(procedure.step(START_NS + 2 * NS_PER_S))[-1].samples == 1


def test_cancel_puts_the_lamp_off_and_only_once() -> None:
    procedure = StaticTargets(LAMPS, config())
    outputs = run(procedure, Person(), 5.0)
    assert lamps_lit(outputs) == {"b"}
    outputs += procedure.cancel(START_NS + 5 * NS_PER_S)
    assert not lamps_lit(outputs)
    assert told(outputs)[-1].phase == "cancelled"
    assert procedure.cancel(START_NS + 6 * NS_PER_S) == []
    assert procedure.step(START_NS + 60 * NS_PER_S) == []


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
    lit, off = "", (0.0, 0.0)
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
    assert known(last.position_sigma_m) <= SURE.enough.position_m
    assert known(last.yaw_sigma_rad) <= math.radians(SURE.enough.yaw_deg)


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


@pytest.mark.parametrize("is_free", [False, True])
def test_people_stand_on_the_floor_unless_its_height_is_asked_for(*, is_free: bool) -> None:
    """All lamps hang higher on the map: 5 cm for somebody tall for their measures, 50 on a platform."""
    up_m = 0.5 if is_free else 0.05
    x_y_z = ((lamp.id, lamp.position_m) for lamp in GOOD)
    raised = [Lamp(id=name, position_m=(x, y, z + up_m)) for name, (x, y, z) in x_y_z]
    procedure = StaticTargets(raised, config(order="informative", targets=5, free_height=is_free))
    (pose,) = poses(chosen(procedure))
    assert pose.position_m[2] == (pytest.approx(0.5, abs=0.1) if is_free else 0.0)
    assert (pose.z_sigma_m > 0.0) == is_free


def test_unsolvable_lamps_are_refused_with_a_reason() -> None:
    outputs = chosen(StaticTargets(EYE_HIGH, SURE), error_deg=1.0)
    last = told(outputs)[-1]
    assert last.phase == "refused"
    assert last.reason.startswith("after pointing 4 times ")
    assert poses(outputs) == []
    assert order(outputs) in (["a", "b", "a", "b"], ["a", "b", "b", "a"], ["b", "a", "b", "a"])
