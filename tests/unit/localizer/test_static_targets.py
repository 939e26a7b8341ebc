"""The procedure with lamps, stepped in virtual time."""

import itertools
import math

import pytest

from pointit.schemas import NS_PER_S, Lamp, UserPose
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.procedures.static_targets import StaticTargets
from tests.unit.localizer.person import START_NS, Person, config, told, yaw_difference

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
    (pose,) = [o for o in outputs if isinstance(o, UserPose)]
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
    (pose,) = [o for o in outputs if isinstance(o, UserPose)]
    assert pose.residual_rad < math.radians(0.5)
    hasty = run(StaticTargets(LAMPS, config(reaction_s=0.0)), Person(0.6, -0.4, 2.2), 12.0)
    assert told(hasty)[-1].phase == "refused"
    assert "rays miss the targets" in told(hasty)[-1].reason
    assert not lamps_lit(hasty)


def test_progress_rises_and_names_the_lamp() -> None:
    steps = [m for m in told(run(StaticTargets(LAMPS, config()), Person(), 12.0)) if m.phase == "sampling"]
    assert [m.progress for m in steps] == sorted(m.progress for m in steps)
    assert list(dict.fromkeys((m.target_index, m.target_id) for m in steps)) == [(0, "a"), (1, "b"), (2, "c")]
    assert {m.target_count for m in steps} == {3}
    assert steps[0].samples == 0
    assert steps[0].stamp_ns == START_NS


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
