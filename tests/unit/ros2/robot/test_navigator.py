"""Commands to a robot with Nav2: goals, whatever a server answers and when, and what becomes of them."""

import asyncio
from collections.abc import AsyncIterator, Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit import plugins
from pointit.bridges.ros2.robot.goal_book import RESULT_NS, RETRY_NS, GoalBook, GoalStatus
from pointit.bridges.ros2.robot.navigator import Navigator
from pointit.bridges.ros2.robot.plugin import Ros2RobotConfig
from pointit.geometry import rotation, vector
from pointit.schemas import NS_PER_S
from tests.support.bench import START_NS, ManualClock, until
from tests.unit.ros2.robot.fake_nav2 import ACTION, FakeNav2
from tests.unit.ros2.scenes import jazzy


class Bench:
    """A navigator, its server, and what it reports."""

    def __init__(self) -> None:
        self.nav2 = FakeNav2()
        self.clock = ManualClock()
        self.news: list[tuple[int, str]] = []
        self.reasons: list[str] = []
        self.problems: list[str] = []
        self.distances_m: list[float] = []
        self.navigator = Navigator(
            self.nav2,
            jazzy(),
            Ros2RobotConfig(frame="map"),
            now_ns=self.clock.now_ns,
            report=self._on_report,
            on_problem=self.problems.append,
            on_distance=self.distances_m.append,
        )
        self.navigator.on_report(plugins.RobotReport(START_NS, (0.0, 0.0, 0.0)))

    def _on_report(self, item: plugins.ReportItem) -> None:
        assert isinstance(item, plugins.OrderStatus)
        self.news.append((item.order, item.state))
        self.reasons.append(item.reason)

    async def told(self, command: plugins.Command, goals: int) -> bytes:
        """Give a command, wait for so many goals at the server, and return the newest."""
        self.navigator.command(command)
        await until(lambda: len(self.nav2.goals) == goals)
        await settled()
        return list(self.nav2.goals)[-1]

    def passes(self, duration_s: float) -> None:
        self.clock.advance(duration_s)
        self.navigator.tick()


async def settled() -> None:
    """Let answers of the fake server, which waits for nothing, arrive."""
    for _ in range(10):
        await asyncio.sleep(0)


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    made = Bench()
    yield made
    await made.navigator.close()
    assert not made.nav2.readers


def heading(bench: Bench, goal: bytes) -> float:
    turned = bench.nav2.goals[goal].pose.pose.orientation
    return vector.azimuth(rotation.rotate((turned.x, turned.y, turned.z, turned.w), (1.0, 0.0, 0.0)))


async def test_path_becomes_a_sequence_of_goals_done_at_the_last(bench: Bench) -> None:
    first = await bench.told(plugins.FollowPath(1, ((0.0, 1.0, 0.0), (2.0, 2.0, 0.0)), yaw_rad=0.5), 1)
    pose = bench.nav2.goals[first].pose
    assert (pose.header.frame_id, pose.header.stamp.sec) == ("map", START_NS // plugins.NS_PER_S)
    assert abs(heading(bench, first) - 1.5707963) < 1e-6  # the way there

    bench.nav2.feedback(first)
    assert bench.distances_m == [0.75]
    bench.nav2.end(first, GoalStatus.SUCCEEDED)
    await until(lambda: len(bench.nav2.goals) == 2)

    second = list(bench.nav2.goals)[-1]
    assert abs(heading(bench, second) - 0.5) < 1e-6
    await settled()
    assert bench.news == [(1, "accepted"), (1, "active"), (1, "accepted")]

    bench.nav2.end(second, GoalStatus.SUCCEEDED)
    await until(lambda: (1, "done") in bench.news)
    assert bench.nav2.places_m == [(0.0, 1.0, 0.0), (2.0, 2.0, 0.0)]

    bench.passes(9.0)
    await settled()
    assert bench.nav2.cancelled == []


async def test_stop_cancels_the_goal_and_the_remaining_path(bench: Bench) -> None:
    goal = await bench.told(plugins.FollowPath(1, ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))), 1)
    bench.navigator.command(plugins.Stop(2))
    await until(lambda: bench.nav2.cancelled == [goal])
    await settled()
    bench.passes(9.0)
    await settled()
    assert len(bench.nav2.goals) == 1
    assert bench.nav2.cancelled == [goal]
    assert bench.news == [(1, "accepted")]


async def test_stop_cancels_goals_of_other_clients_until_the_server_answers(bench: Bench) -> None:
    foreign = bench.nav2.ends[b"crashed earlier."] = asyncio.get_running_loop().create_future()
    bench.nav2.clear_failures = 1
    bench.navigator.command(plugins.Stop(1))
    await until(lambda: bench.nav2.clears == 1)

    await settled()
    bench.passes(0.1)
    await settled()
    assert (bench.nav2.clears, foreign.done()) == (1, False)

    bench.passes(0.5)
    await until(foreign.done)
    await settled()
    bench.passes(9.0)
    await settled()
    assert bench.nav2.clears == 2
    assert bench.news == []


async def test_goal_after_a_stop_waits_for_all_cancellations(bench: Bench) -> None:
    bench.nav2.clear_gate = asyncio.Event()
    bench.navigator.command(plugins.Stop(1))
    await until(lambda: bench.nav2.clears == 1)
    bench.navigator.command(plugins.FollowPath(2, ((1.0, 0.0, 0.0),)))
    bench.navigator.command(plugins.FollowPath(3, ((2.0, 0.0, 0.0),)))
    await settled()
    assert bench.nav2.goals == {}
    bench.nav2.clear_gate.set()
    await until(lambda: bench.news == [(3, "accepted")])
    assert bench.nav2.places_m == [(2.0, 0.0, 0.0)]
    assert not next(iter(bench.nav2.ends.values())).done()


async def test_goal_accepted_after_a_stop_is_cancelled(bench: Bench) -> None:
    bench.nav2.gate = asyncio.Event()
    goal = await bench.told(plugins.FollowPath(1, ((1.0, 0.0, 0.0),)), 1)
    bench.navigator.command(plugins.Stop(2))
    await until(lambda: bench.nav2.cancelled == [goal])  # unknown to the server as yet
    bench.nav2.gate.set()
    await until(lambda: bench.nav2.cancelled == [goal, goal])
    await settled()
    assert bench.nav2.ends[goal].done()
    assert bench.news == []


async def test_refusals_and_failures_are_reported_with_reasons(bench: Bench) -> None:
    bench.nav2.accepts = False
    await bench.told(plugins.FollowPath(1, ((1.0, 0.0, 0.0),)), 1)
    assert bench.news == [(1, "refused")]
    assert "/navigate_to_pose refused the goal" in bench.reasons[-1]
    bench.nav2.accepts = True
    goal = await bench.told(plugins.FollowPath(2, ((1.0, 0.0, 0.0),)), 2)
    bench.nav2.end(goal, GoalStatus.ABORTED, error_code=208)
    await until(lambda: (2, "failed") in bench.news)
    assert bench.reasons[-1] == "Nav2 gave up: error 208"


async def test_unanswered_goal_is_reported_and_cancelled_when_it_appears(
    bench: Bench,
) -> None:
    bench.nav2.is_silent = True
    goal = await bench.told(plugins.FollowPath(1, ((1.0, 0.0, 0.0),)), 1)
    assert bench.news == [(1, "failed")]
    assert "did not answer" in bench.reasons[-1]
    bench.passes(1.0)
    await until(lambda: bench.nav2.cancelled == [goal])


async def test_end_known_by_the_status_topic_only_is_reported_late(bench: Bench) -> None:
    goal = await bench.told(plugins.FollowPath(1, ((1.0, 0.0, 0.0),)), 1)
    bench.nav2.status((goal, GoalStatus.ABORTED))
    assert bench.news == [(1, "accepted")]
    bench.passes(RESULT_NS / plugins.NS_PER_S)
    assert bench.news == [(1, "accepted"), (1, "failed")]
    bench.nav2.end(goal, GoalStatus.ABORTED)  # twice
    await settled()
    assert len(bench.news) == 2


async def test_moving_place_is_a_new_goal_once_a_second(bench: Bench) -> None:
    bench.passes(1.0)
    await bench.told(plugins.Follow(1, (1.0, 0.0, 0.0)), 1)
    for count in range(20):
        bench.navigator.command(plugins.Follow(2 + count, (1.0 + 0.05 * count, 0.0, 0.0)))
    await settled()
    assert bench.nav2.places_m == [(1.0, 0.0, 0.0)]

    bench.passes(1.0)
    await until(lambda: len(bench.nav2.goals) == 2)
    assert bench.nav2.places_m[-1] == pytest.approx((1.95, 0.0, 0.0))

    bench.navigator.command(plugins.Follow(40, (2.0, 0.0, 0.0)))  # hardly any farther
    bench.passes(1.0)
    await settled()
    assert len(bench.nav2.goals) == 2
    assert bench.news == []  # who follows a cursor is told of no single goal

    old = next(iter(bench.nav2.goals))
    bench.passes(1.1)
    await until(lambda: bench.nav2.cancelled == [old])  # this server does not end it by itself


async def test_landing_is_refused_and_closing_cancels_the_goal(bench: Bench) -> None:
    bench.navigator.command(plugins.Land(1))
    assert bench.news == [(1, "refused")]
    goal = await bench.told(plugins.FollowPath(2, ((1.0, 0.0, 0.0),)), 1)
    await bench.navigator.close()
    assert bench.nav2.cancelled == [goal]


async def test_unreadable_server_messages_are_reported_without_an_outcome(bench: Bench) -> None:
    say: Callable[[bytes], None] = bench.nav2.readers[f"{ACTION}/status"]
    say(b"\x00\x01\x00\x00\xff\xff\xff\xff")
    bench.nav2.readers[f"{ACTION}/feedback"](b"")
    assert len(bench.problems) == 2
    assert all("was dropped" in each for each in bench.problems)
    assert bench.news == []


A = b"a" * 16
B = b"b" * 16
LATER_NS = 10 * NS_PER_S


def accepted(goal: bytes = A, now_ns: int = LATER_NS) -> GoalBook:
    book = GoalBook()
    book.begin(goal)
    assert book.on_response(goal, accepted=True, now_ns=now_ns) == "accepted"
    return book


def test_refused_goal_leaves_the_previous_one_to_cancel() -> None:
    book = GoalBook()
    book.begin(A)
    assert book.on_response(A, accepted=False, now_ns=LATER_NS) == "refused"
    assert book.to_cancel(LATER_NS) == []
    book = accepted()
    book.begin(B)
    assert book.on_response(B, accepted=False, now_ns=LATER_NS) == "refused"
    assert book.to_cancel(LATER_NS) == [A]


def test_stopped_goal_is_cancelled_repeatedly_until_it_ends() -> None:
    book = accepted()
    book.drop()
    assert book.to_cancel(LATER_NS) == [A]
    assert book.to_cancel(LATER_NS + RETRY_NS - 1) == []
    assert book.to_cancel(LATER_NS + RETRY_NS) == [A]
    assert book.on_status([(A, GoalStatus.CANCELED)], LATER_NS) == []
    assert book.to_cancel(LATER_NS + 2 * RETRY_NS) == []


def test_unanswered_goal_is_cancelled_when_it_appears() -> None:
    book = GoalBook()
    book.begin(A)
    assert book.on_silence(A) == "failed"
    assert book.to_cancel(LATER_NS) == [A]
    book.on_unknown(A)
    assert not book.has_unwanted
    assert book.on_status([(A, GoalStatus.EXECUTING)], 2 * LATER_NS) == []
    assert book.to_cancel(2 * LATER_NS) == [A]


def test_status_topic_gives_missing_ends_and_other_clients_are_ignored() -> None:
    book = accepted()
    assert book.on_status([(B, GoalStatus.EXECUTING), (B, GoalStatus.ABORTED)], LATER_NS) == []
    assert book.on_end(B, GoalStatus.ABORTED) is None
    assert book.to_cancel(LATER_NS) == []
    assert book.on_status([(A, GoalStatus.ABORTED)], LATER_NS) == []
    assert book.overdue(LATER_NS + RESULT_NS - 1) is None
    assert book.overdue(LATER_NS + RESULT_NS) == "failed"
    assert book.on_end(A, GoalStatus.ABORTED) is None


GOALS = st.integers(0, 3).map(lambda number: bytes([number]) * 16)
CALLS = ("begin", "drop", "accepted", "refused", "silence", "feedback", "unknown", "end")
EVENTS = st.tuples(st.sampled_from((*CALLS, *GoalStatus)), GOALS)


def told(book: GoalBook, what: str | GoalStatus, goal: bytes, now_ns: int) -> list[object]:
    """Tell `book` of an event that a server causes, or of a stop; return the news."""
    if isinstance(what, GoalStatus):
        return [*book.on_status([(goal, what)], now_ns)]
    calls: dict[str, Callable[[], object]] = {
        "drop": book.drop,
        "accepted": lambda: book.on_response(goal, accepted=True, now_ns=now_ns),
        "refused": lambda: book.on_response(goal, accepted=False, now_ns=now_ns),
        "silence": lambda: book.on_silence(goal),
        "feedback": lambda: book.on_feedback(goal, now_ns),
        "unknown": lambda: book.on_unknown(goal),
        "end": lambda: book.on_end(goal, GoalStatus.SUCCEEDED),
    }
    return [calls[what]()] if what in calls else []


@given(st.lists(EVENTS, max_size=40))
def test_goals_end_once_and_wanted_ones_are_never_cancelled(
    events: list[tuple[str | GoalStatus, bytes]],
) -> None:
    book = GoalBook()
    now_ns = LATER_NS
    ends: dict[bytes, int] = {}
    begun: set[bytes] = set()
    for what, goal in events:
        now_ns += NS_PER_S
        wanted = book.wanted
        if what == "begin" and goal not in begun:
            begun.add(goal)
            book.begin(goal)
        news = told(book, what, goal, now_ns)
        if wanted is not None and any(each in {"done", "cancelled", "refused", "failed"} for each in news):
            ends[wanted] = ends.get(wanted, 0) + 1
        cancelled = book.to_cancel(now_ns)
        assert book.wanted not in cancelled
        assert set(cancelled) <= begun
        if book.wanted is None:
            assert book.to_cancel(now_ns + RETRY_NS) == cancelled
            assert book.has_unwanted == bool(cancelled)

    assert all(count == 1 for count in ends.values())
