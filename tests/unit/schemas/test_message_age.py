"""Age of messages from outside: retained, stamped by other clocks, queued on their way."""

import math

import pytest

from pointit.schemas import NS_PER_S
from pointit.schemas.message_age import MAX_AHEAD_NS, SenderClock, message_age_ns
from tests.support.bench import START_NS

DAY_NS = 86_400 * NS_PER_S
LIMIT_NS = 35 * NS_PER_S


@pytest.mark.parametrize(
    ("stamp_ns", "is_retained", "expected_ns"),
    [
        (None, False, 0),
        (None, True, math.inf),
        (START_NS - 7, False, 7),
        (START_NS - DAY_NS, True, DAY_NS),
        (START_NS + MAX_AHEAD_NS, True, -MAX_AHEAD_NS),
        (START_NS + MAX_AHEAD_NS + 1, True, math.inf),
        (START_NS + DAY_NS, False, -DAY_NS),
    ],
)
def test_message_age_is_unknown_when_retained_without_stamp(
    stamp_ns: int | None, expected_ns: float, *, is_retained: bool
) -> None:
    assert message_age_ns(stamp_ns, START_NS, is_retained=is_retained) == expected_ns


def ages_ns(clock: SenderClock, messages: list[tuple[float, float]]) -> list[float]:
    """Return the ages of messages that arrive as they are sent, each with stamp and arrival, s."""
    return [
        clock.age_ns(
            START_NS + round(stamp_s * NS_PER_S), START_NS + round(arrival_s * NS_PER_S), is_retained=False
        )
        for stamp_s, arrival_s in messages
    ]


def test_clock_behind_by_a_constant_is_believed_after_a_second() -> None:
    behind_s = -3600.0
    messages = [(behind_s + 0.1 * step, 0.1 * step) for step in range(20)]
    ages = ages_ns(SenderClock(LIMIT_NS), messages)
    assert min(ages[:10]) > LIMIT_NS
    assert set(ages[11:]) == {0}


def test_late_queue_is_old_until_it_has_caught_up() -> None:
    hour = [(-3600.0 + step, 0.001 * step) for step in range(3600)]
    ages = ages_ns(SenderClock(LIMIT_NS), [*hour, (4.0, 4.0)])
    assert min(ages[:3500]) > LIMIT_NS
    assert ages[-1] == 0


def test_clock_that_is_ahead_makes_no_message_old() -> None:
    assert ages_ns(SenderClock(LIMIT_NS), [(7200.0, 0.0), (7200.1, 0.1)]) == [0, 0]


def test_late_message_does_not_change_a_known_clock_error() -> None:
    clock = SenderClock(LIMIT_NS)
    ages_ns(clock, [(-3600.0 + 0.1 * step, 0.1 * step) for step in range(20)])
    assert ages_ns(clock, [(-3598.0, 3.0), (-3596.0, 4.0)]) == [0, 0]


def test_messages_from_before_the_end_are_old_until_a_start() -> None:
    clock = SenderClock(LIMIT_NS)
    clock.end(START_NS)
    assert ages_ns(clock, [(-1.0, 1.0)])[0] > LIMIT_NS
    assert ages_ns(clock, [(1.5, 2.0)]) == [0]
    clock.end(START_NS + 3 * NS_PER_S)
    clock.start()
    assert ages_ns(clock, [(2.5, 3.0)]) == [0]
