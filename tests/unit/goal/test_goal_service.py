"""The service: what it takes from the bus, what it says there."""

from pointit.schemas import NS_PER_S, ButtonEvent, Interaction, UserPose
from pointit.schemas.topics import BUTTON, CURSOR, FEEDBACK, GOAL, INTERACTION, MAP, POSE
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.service import Goals
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.goal.floor import ROOM, cursor

THERE = (2.0, 1.0, 0.0)


async def furnish(bench: Bench, *, config: GoalConfig | None = None) -> None:
    bench.start(Goals, config, "anna")
    await bench.settle()
    now_ns = bench.clock.now_ns()
    bench.put(MAP, ROOM)
    bench.put(POSE, UserPose(stamp_ns=now_ns, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0), "anna")
    bench.put(INTERACTION, Interaction(stamp_ns=now_ns, state="pointing"), "anna")
    await bench.settle()


async def stay(bench: Bench, clock: ManualClock, x_m: float | None, user: str = "anna") -> None:
    for _ in range(14):
        point = None if x_m is None else (x_m, 1.0, 0.0)
        bench.put(CURSOR, cursor(clock.advance(0.1), point), user)
        await bench.settle(2)


async def test_a_place_pointed_at_twice_becomes_a_goal() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        goals, cues = bench.collect(GOAL, "anna"), bench.collect(FEEDBACK, "anna")
        await furnish(bench)
        await stay(bench, clock, 2.0, "ben")  # somebody else
        await stay(bench, clock, 2.0)
        await until(lambda: len(cues) == 1, what="the proposal")
        await stay(bench, clock, None)
        await stay(bench, clock, 2.0)
        await until(lambda: bool(goals), what="the goal")
        assert goals[0].position_m == THERE
        assert [cue.cue for cue in cues] == ["selected", "selected"]


async def test_a_place_near_to_somebody_else_is_refused_and_a_press_confirms_where_it_is_to() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        goals, cues = bench.collect(GOAL, "anna"), bench.collect(FEEDBACK, "anna")
        await furnish(bench, config=GoalConfig(confirm="press"))
        bench.put(POSE, UserPose(stamp_ns=clock.now_ns(), position_m=THERE, yaw_rad=0.0), "ben")
        await stay(bench, clock, 2.0)
        await until(lambda: [cue.cue for cue in cues] == ["refused"], what="the refusal")
        assert "from ben" in cues[0].text
        await stay(bench, clock, 3.0)
        await until(lambda: len(cues) == 2, what="the proposal")
        bench.put(BUTTON, ButtonEvent(stamp_ns=clock.now_ns()), "anna")
        await until(lambda: bool(goals), what="the goal")
        assert goals[0].confirmed_by == "press"


async def test_unconfirmed_proposal_is_withdrawn_without_further_messages() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        cues = bench.collect(FEEDBACK, "anna")
        await furnish(bench, config=GoalConfig(confirm_s=0.5))
        await stay(bench, clock, 2.0)
        assert len(cues) == 1
        clock.time_ns += NS_PER_S
        await until(lambda: [cue.cue for cue in cues] == ["selected", "deselected"], what="the end")
