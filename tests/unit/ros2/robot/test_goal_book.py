"""Goals of an action, whatever a server answers, and when."""

from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.robot.goal_book import RESULT_NS, RETRY_NS, GoalBook, GoalStatus
from pointit.schemas import NS_PER_S

A, B = b"a" * 16, b"b" * 16
LATER_NS = 10 * NS_PER_S


def accepted(goal: bytes = A, now_ns: int = LATER_NS) -> GoalBook:
    book = GoalBook()
    book.begin(goal)
    assert book.on_response(goal, accepted=True, now_ns=now_ns) == "accepted"
    return book


def test_a_refused_goal_leaves_nothing_to_cancel_but_the_one_before() -> None:
    book = GoalBook()
    book.begin(A)
    assert book.on_response(A, accepted=False, now_ns=LATER_NS) == "refused"
    assert book.to_cancel(LATER_NS) == []
    book = accepted()
    book.begin(B)
    assert book.on_response(B, accepted=False, now_ns=LATER_NS) == "refused"
    assert book.to_cancel(LATER_NS) == [A]


def test_a_stopped_goal_is_cancelled_again_and_again_until_it_has_ended() -> None:
    book = accepted()
    book.drop()
    assert book.to_cancel(LATER_NS) == [A]
    assert book.to_cancel(LATER_NS + RETRY_NS - 1) == []
    assert book.to_cancel(LATER_NS + RETRY_NS) == [A]
    assert book.on_status([(A, GoalStatus.CANCELED)], LATER_NS) == []
    assert book.to_cancel(LATER_NS + 2 * RETRY_NS) == []


def test_a_goal_that_no_server_answered_is_cancelled_should_it_turn_up() -> None:
    book = GoalBook()
    book.begin(A)
    assert book.on_silence(A) == "failed"
    assert book.to_cancel(LATER_NS) == [A]
    book.on_unknown(A)
    assert not book.has_unwanted
    assert book.on_status([(A, GoalStatus.EXECUTING)], 2 * LATER_NS) == []
    assert book.to_cancel(2 * LATER_NS) == [A]


def test_the_status_topic_tells_an_end_whose_result_does_not_come_and_of_others_that_do_not_matter() -> None:
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
def test_goals_end_once_and_the_wanted_one_is_never_cancelled(
    events: list[tuple[str | GoalStatus, bytes]],
) -> None:
    book, now_ns = GoalBook(), LATER_NS
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
