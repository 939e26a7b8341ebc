"""A place is proposed by staying there and becomes a goal when that is confirmed, or is refused."""

import itertools
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import ButtonEvent, Feedback, Goal, Interaction, UserPose
from pointit.schemas.topics import BUTTON, CURSOR, FEEDBACK, GOAL, INTERACTION, MAP, POSE
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.goal_checker import GoalChecker
from pointit.services.goal.service import Goals
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.goal.floor import POINTING, ROOM, START_NS, Anna, cursor

THERE: Vec3 = (2.0, 1.0, 0.0)
ELSEWHERE: Vec3 = (1.0, -1.5, 0.0)


def pose(x_m: float, y_m: float, **fields: Any) -> UserPose:
    return UserPose(stamp_ns=START_NS, position_m=(x_m, y_m, 0.0), yaw_rad=0.0, **fields)


def test_staying_proposes_and_staying_again_sends() -> None:
    anna = Anna().stay(THERE, 1.5)
    assert (anna.cues, anna.goals) == (["selected"], [])
    assert "point elsewhere, then there again within 8 s" in anna.last_text
    anna.stay(ELSEWHERE, 0.4).stay((2.1, 1.1, 0.0), 1.1)
    (goal,) = anna.goals
    assert goal.position_m == pytest.approx(THERE)  # what was proposed, not what was met the second time
    assert goal.yaw_rad == pytest.approx(math.atan2(1.0, 2.0))
    assert (goal.surface_id, goal.confirmed_by, goal.seq, goal.age_s) == ("floor", "again", 1, 0.0)
    assert goal.clearance_m == pytest.approx(math.sqrt(5.0))
    assert 0.02 < goal.position_sigma_m < 0.2
    assert START_NS < goal.proposed_ns < goal.stamp_ns == anna.now_ns - round(0.08e9)
    assert (anna.cues, anna.last_text) == (["selected", "selected"], "the robot is sent there")


def test_staying_on_without_leaving_sends_nothing() -> None:
    anna = Anna().stay(THERE, 7.9)
    assert (anna.cues, anna.goals) == (["selected"], [])
    anna.stay((2.5, 1.0, 0.0), 0.5).stay(THERE, 1.5)  # not far enough away
    assert anna.goals == []


def test_unconfirmed_proposal_is_withdrawn_in_time() -> None:
    anna = Anna().stay(THERE).stay(None, 0.2).wait(8.0)
    assert anna.cues == ["selected", "deselected"]
    assert anna.last_text == "no robot is sent: not confirmed within 8 s"
    assert anna.steps.deadline_ns is None
    anna.stay(THERE)
    assert (anna.cues[2:], anna.goals) == (["selected"], [])  # only proposed again


def test_stay_at_the_place_of_a_goal_proposes_nothing() -> None:
    anna = Anna().stay(THERE).stay(None, 0.2).stay((2.4, 1.0, 0.0))
    assert len(anna.goals) == 1
    before = len(anna.cues)
    anna.stay((1.5, 1.0, 0.0), 2.0)  # nearer to the goal than twice the radius, though not to the second stay
    assert len(anna.cues) == before
    assert len(anna.stay(ELSEWHERE, 1.2).cues) == before + 1


def test_stay_elsewhere_is_another_proposal() -> None:
    anna = Anna().stay(THERE).stay(ELSEWHERE).stay(THERE)
    assert (anna.cues, anna.goals) == (["selected"] * 3, [])
    assert len(anna.stay(None, 0.1).stay(THERE).goals) == 1


@pytest.mark.parametrize("surface_id", ["wall", "ceiling", "elsewhere", ""])
def test_only_configured_surfaces_and_level_planes_from_above_count(surface_id: str) -> None:
    point = (2.0, 1.0, 3.0 if surface_id == "ceiling" else 0.0)
    assert Anna().stay(point, surface_id=surface_id).outputs == []
    assert Anna(surfaces=["elsewhere"]).stay(point, surface_id="elsewhere").cues == ["selected"]
    assert Anna().stay(THERE, surface_id="workspace/horizontal").cues == ["selected"]


def test_restless_cursor_proposes_nothing() -> None:
    anna = Anna()
    for x_m in (1.0, 1.5, 2.0, 2.5) * 3:
        anna.stay((x_m, 1.0, 0.0), 0.5)
    assert anna.outputs == []


def test_gap_between_cursors_ends_a_stay() -> None:
    anna = Anna().stay(THERE, 0.8).wait(0.5).stay(THERE, 0.8)
    assert anna.outputs == []
    assert anna.stay(THERE, 0.3).cues == ["selected"]


@pytest.mark.parametrize("lag_s", [0.25, -0.25])
def test_old_or_future_cursors_are_refused(lag_s: float) -> None:
    anna = Anna()
    anna.lag_s = lag_s
    anna.stay(THERE)
    assert anna.cues == ["refused"]
    assert ("0.2 s old" if lag_s > 0 else "0.2 s ahead") in anna.last_text
    timely = Anna()
    timely.lag_s = lag_s * 0.7
    assert timely.stay(THERE).cues == ["selected"]


def test_unsure_place_is_refused() -> None:
    def known_to(place_m: float, yaw_rad: float) -> Anna:
        at = pose(0.0, 0.0, covariance=covariance(place_m, yaw_rad))
        return Anna().change(lambda it: it.on_pose("anna", at))

    assert known_to(0.1, 0.02).stay(THERE).cues == ["selected"]
    unsure = known_to(0.6, 0.02).stay(THERE)
    assert unsure.cues == ["refused"]
    assert "sure to 0.6 m only" in unsure.last_text
    turned = known_to(0.1, 0.3)
    assert turned.stay(THERE).cues == ["refused"]  # 0.3 rad over 2.2 m
    assert turned.stay((0.5, 0.5, 0.0)).cues == ["refused", "selected"]
    far = Anna().stay((12.0, 0.0, 0.0))  # a degree is 1.5 m there
    assert far.cues == ["refused"]
    grazing = Anna(surfaces=["shelf"]).stay((2.0, 1.0, 1.64), surface_id="shelf")
    assert "not known well enough" in grazing.last_text


def covariance(place_m: float, yaw_rad: float) -> tuple[float, ...]:
    return (place_m**2, 0.0, 0.0, 0.0, place_m**2, 0.0, 0.0, 0.0, yaw_rad**2)


def test_goal_near_a_person_is_refused() -> None:
    near_anna = Anna().stay((0.4, 0.0, 0.0))
    assert near_anna.cues == ["refused"]
    assert near_anna.last_text == "the place is 0.4 m from you: choose one 0.5 m away"
    anna = Anna().change(lambda it: it.on_pose("ben", pose(2.4, 1.0))).stay(THERE)
    assert anna.last_text == "the place is 0.4 m from ben: choose one 0.5 m away"
    anna = Anna().stay(THERE).change(lambda it: it.on_pose("ben", pose(2.3, 1.0)))
    anna.stay(None, 0.1).stay(THERE)
    assert (anna.cues, anna.goals) == (["selected", "refused"], [])


def test_goal_of_a_person_who_does_not_point_is_refused() -> None:
    idle = Interaction(stamp_ns=START_NS, state="idle")
    anna = Anna().stay(THERE)
    anna.outputs += anna.steps.on_interaction(idle, anna.now_ns)
    assert anna.cues == ["selected", "deselected"]
    assert anna.stay(None, 0.1).stay(THERE).cues[2:] == ["refused"]
    assert anna.last_text.startswith("you are not pointing")
    anna.change(lambda it: it.on_interaction(POINTING, anna.now_ns))
    assert anna.stay(None, 0.1).stay(THERE).cues[3:] == ["selected"]
    unsure = POINTING.model_copy(update={"is_unsure": True})
    anna = Anna().change(lambda it: it.on_interaction(unsure, START_NS)).stay(THERE)
    assert "uncertain" in anna.last_text


def test_goal_of_a_person_with_unknown_position_is_refused() -> None:
    anna = Anna(place=None)
    assert anna.stay(THERE).last_text == "your position is unknown: localize first"


def test_press_sends_a_robot_when_presses_confirm() -> None:
    anna = Anna(confirm="press").stay(THERE).press("double").press("hold").press(ago_s=5.0)
    assert (anna.cues, anna.goals) == (["selected"], [])
    anna.press()
    (goal,) = anna.goals
    assert goal.confirmed_by == "press"
    assert goal.position_m == pytest.approx(THERE)
    assert len(anna.press().goals) == 1
    assert Anna().stay(THERE).press().goals == []  # else a press ends the pointing


def test_press_elsewhere_or_late_is_refused() -> None:
    anna = Anna(confirm="press").stay(THERE).stay(ELSEWHERE, 0.2).press()
    assert (anna.cues, anna.goals) == (["selected", "refused"], [])
    assert "you pointed elsewhere" in anna.last_text
    late = Anna(confirm="press").stay(THERE).stay(THERE, 1.0).press(ago_s=0.5)
    assert (late.cues, late.goals) == (["selected", "refused"], [])
    silent = Anna(confirm="press").stay(THERE).wait(0.4).press()
    assert (silent.cues, silent.goals) == (["selected", "refused"], [])
    assert "the last data of your arm is 0.4 s old" in silent.last_text
    again = Anna(confirm="press").stay(THERE).stay(None, 0.1).stay(THERE)
    assert (again.cues, again.goals) == (["selected", "selected"], [])


@pytest.mark.parametrize("held_s", [0.15, 0.6, 1.5])
def test_press_of_a_headset_may_be_late_by_its_duration(held_s: float) -> None:
    anna = Anna(confirm="press").stay(THERE).stay(THERE, 2.0).press(ago_s=held_s, source="headset")
    assert [goal.confirmed_by for goal in anna.goals] == ["press"]
    late = Anna(confirm="press").stay(THERE).stay(THERE, 3.0).press(ago_s=2.5, source="headset")
    assert (late.cues, late.goals) == (["selected", "refused"], [])


def test_step_back_of_the_wrists_clock_restarts_the_stay() -> None:
    anna = Anna().stay(THERE, 0.9)
    anna.lag_s = 5.0
    assert anna.stay(THERE, 0.9).cues == []
    assert anna.stay(THERE, 0.2).cues == ["refused"]


class Told:
    """Last reported states of the actions below, to compare goals with."""

    def __init__(self, anna: Anna) -> None:
        self.anna = anna
        self.state: Any = "pointing"
        self.ben = (9.0, 9.0)

    def do(self, what: str, how: Any) -> None:
        anna = self.anna
        if what in ("stay", "press", "wait"):
            getattr(anna, what)(*how)
        elif what == "lag":
            anna.lag_s = how
        elif what == "ben":
            self.ben = how
            anna.steps.on_pose("ben", pose(*how))
        else:
            self.state = how
            said = Interaction(stamp_ns=anna.now_ns, state=how)
            anna.outputs += anna.steps.on_interaction(said, anna.now_ns)


places = st.sampled_from([THERE, THERE, ELSEWHERE, (2.2, 1.2, 0.0), (0.3, 0.1, 0.0), (11.0, 3.0, 0.0), None])
stays = st.tuples(st.just("stay"), st.tuples(places, st.sampled_from([0.04, 0.3, 1.1, 2.5])))
doings = st.one_of(
    stays,
    stays,
    st.tuples(st.just("wait"), st.tuples(st.sampled_from([0.1, 0.5, 9.0]))),
    st.tuples(
        st.just("press"), st.tuples(st.sampled_from(["press", "double", "hold"]), st.sampled_from([0.0, 0.5]))
    ),
    st.tuples(st.just("state"), st.sampled_from(["pointing", "idle", "localizing"])),
    st.tuples(st.just("ben"), st.sampled_from([(2.0, 1.0), (9.0, 9.0)])),
    st.tuples(st.just("lag"), st.sampled_from([0.0, 0.0, 0.5])),
)


@given(st.sampled_from(["again", "press"]), st.lists(doings, max_size=25))
def test_no_goal_is_unproposed_or_against_the_rules(confirm: str, all_doings: list[tuple[str, Any]]) -> None:
    told = Told(Anna(confirm=confirm))
    anna = told.anna
    for what, how in all_doings:
        before = len(anna.outputs)
        told.do(what, how)
        for goal in [each for each in anna.outputs[before:] if isinstance(each, Goal)]:
            assert told.state == "pointing"
            assert goal.age_s <= 0.2
            assert goal.position_sigma_m <= 0.5
            assert goal.clearance_m >= 0.5
            assert math.dist(goal.position_m[:2], told.ben) >= 0.5
            assert 0 < goal.stamp_ns - goal.proposed_ns <= 8 * 10**9 + 200_000_000
            assert confirm == goal.confirmed_by

    assert all(a.stamp_ns < b.stamp_ns for a, b in itertools.pairwise(anna.goals))
    texts = [each.text for each in anna.outputs if isinstance(each, Feedback)]
    assert sum(text.startswith("send a robot there?") for text in texts) >= len(anna.goals)


@given(
    st.floats(0.6, 20.0),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(0, 5),
)
def test_uncertainty_of_a_place_follows_from_pose_and_aim(
    range_m: float, azimuth_rad: float, place_m: float, yaw_rad: float, aim_deg: float
) -> None:
    judging = GoalChecker(GoalConfig(aim_sigma_deg=aim_deg), "anna")
    judging.on_pose("anna", pose(0.0, 0.0, covariance=covariance(place_m, yaw_rad)))
    point = (range_m * math.cos(azimuth_rad), range_m * math.sin(azimuth_rad), 0.0)
    sigma = judging.sigma_m(point, cursor(0, point))
    slope = 1.64 / math.hypot(range_m, 1.64)
    aim = math.radians(aim_deg) * math.hypot(range_m, 1.64)
    along = place_m**2 + (aim / slope) ** 2
    across = place_m**2 + aim**2 + (range_m * yaw_rad) ** 2
    assert sigma == pytest.approx(math.sqrt(max(along, across)), rel=1e-6, abs=1e-6)


class Served:
    """The service for Anna, who stands in the origin, on a bench."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.clock = clock
        self.goals, self.cues = bench.collect(GOAL, "anna"), bench.collect(FEEDBACK, "anna")

    async def stay(self, x_m: float | None, user: str = "anna") -> None:
        for _ in range(14):
            point = None if x_m is None else (x_m, 1.0, 0.0)
            self.bench.put(CURSOR, cursor(self.clock.advance(0.1), point), user)
            await self.bench.settle(2)

    async def until_cues(self, *cues: str) -> None:
        await until(lambda: [cue.cue for cue in self.cues] == [*cues], what=f"{cues}")


@asynccontextmanager
async def served(config: GoalConfig | None = None) -> AsyncGenerator[Served]:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        here = Served(bench, clock)
        bench.start(Goals, config, "anna")
        await bench.settle()
        bench.put(MAP, ROOM)
        bench.put(POSE, pose(0.0, 0.0), "anna")
        bench.put(INTERACTION, Interaction(stamp_ns=clock.now_ns(), state="pointing"), "anna")
        await bench.settle()
        yield here


async def test_place_near_another_person_is_refused_and_a_press_confirms() -> None:
    async with served(GoalConfig(confirm="press")) as anna:
        anna.bench.put(POSE, pose(*THERE[:2]), "ben")
        await anna.stay(2.0, "ben")  # somebody else
        await anna.stay(2.0)
        await anna.until_cues("refused")
        assert "from ben" in anna.cues[0].text
        await anna.stay(3.0)
        await anna.until_cues("refused", "selected")
        anna.bench.put(BUTTON, ButtonEvent(stamp_ns=anna.clock.now_ns()), "anna")
        await until(lambda: bool(anna.goals), what="the goal")
        assert anna.goals[0].confirmed_by == "press"


async def test_unconfirmed_proposal_is_withdrawn_without_further_messages() -> None:
    async with served(GoalConfig(confirm_s=0.5)) as anna:
        await anna.stay(2.0)
        assert len(anna.cues) == 1
        anna.clock.advance(1.0)
        await anna.until_cues("selected", "deselected")


def test_request_sends_a_robot_as_two_stays_do() -> None:
    anna = Anna().stay(ELSEWHERE, 0.2)
    anna.outputs += anna.steps.send("", THERE, anna.now_ns)
    (goal,) = anna.goals
    assert goal.position_m == THERE
    assert goal.yaw_rad == pytest.approx(math.atan2(1.0, 2.0))
    assert anna.last_text == "the robot is sent there"


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ((0.3, 0.0, 0.0), "0.3 m from you"),
        ((2.0, 1.0, 1.0), "1.0 m above the floor"),
        ((30.0, 1.0, 0.0), "choose one nearer to you"),
    ],
)
def test_requested_place_is_refused_for_the_reasons_of_pointing(place: Vec3, why: str) -> None:
    anna = Anna().stay(ELSEWHERE, 0.2)
    with pytest.raises(RefusedError, match=why):
        anna.steps.send("", place, anna.now_ns)
    assert anna.goals == []


def test_request_needs_a_person_who_points() -> None:
    with pytest.raises(RefusedError, match="point while you speak"):
        Anna().steps.send("", THERE, START_NS)
    anna = Anna().stay(ELSEWHERE, 0.2)
    with pytest.raises(RefusedError, match="s old"):
        anna.steps.send("", THERE, anna.now_ns + 10**9)
    anna.steps.on_interaction(POINTING.model_copy(update={"state": "idle"}), anna.now_ns)
    with pytest.raises(RefusedError, match="you are not pointing"):
        anna.steps.send("", THERE, anna.now_ns)
    with pytest.raises(RefusedError, match="rover cannot be chosen here"):
        anna.steps.send("rover", THERE, anna.now_ns)
