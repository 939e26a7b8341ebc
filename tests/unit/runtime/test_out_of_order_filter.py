"""A recording played beside a living stream is refused. A clock that is set back is believed."""

import pytest

from pointit.runtime.bus.timeliness import SILENT_S, OutOfOrderFilter
from pointit.schemas import NS_PER_S

S = NS_PER_S
PERIOD_S = 0.02


def play(
    order: OutOfOrderFilter, stamps_s: list[float], began_s: float = 0.0, name: str = "anna"
) -> list[bool]:
    """Offer messages that come every 20 ms; return which are news."""
    times = [began_s + number * PERIOD_S for number in range(len(stamps_s))]
    return [
        order.accepts(name, round(stamp_s * S), now_s) for stamp_s, now_s in zip(stamps_s, times, strict=True)
    ]


def test_a_recording_played_beside_a_live_stream_is_refused_and_counted() -> None:
    order = OutOfOrderFilter()
    lives = [100.0 + number * PERIOD_S for number in range(50)]
    both = [stamp_s for live_s in lives for stamp_s in (live_s, live_s - 5.0)]
    assert play(order, both) == [True, False] * 50
    assert order.refused == 50


@pytest.mark.parametrize("back_s", [0.6, 5.0, 3600.0])
def test_a_clock_that_was_set_back_is_believed_after_a_moment(back_s: float) -> None:
    order = OutOfOrderFilter()
    assert all(play(order, [100.0 + number * PERIOD_S for number in range(50)]))
    later = play(order, [101.0 - back_s + number * PERIOD_S for number in range(100)], began_s=1.0)
    refused = later.index(True)
    assert refused * PERIOD_S <= SILENT_S + 2 * PERIOD_S
    assert all(later[refused:])
    assert order.refused == refused


def test_strays_from_the_future_do_not_block_later_messages() -> None:
    order = OutOfOrderFilter()
    stamps_s = [stamp_s for number in range(100) for stamp_s in (100.0 + number * PERIOD_S, 9999.0)]
    assert all(play(order, stamps_s))


def test_a_clock_that_was_set_forward_is_believed_and_what_was_before_is_old() -> None:
    order = OutOfOrderFilter()
    stamps_s = [
        *(100.0 + number * PERIOD_S for number in range(10)),
        *(200.0 + n * PERIOD_S for n in range(70)),
    ]
    assert all(play(order, stamps_s))
    assert not order.accepts("anna", 100 * S, len(stamps_s) * PERIOD_S)


def test_slightly_late_messages_are_passed_on() -> None:
    order = OutOfOrderFilter()
    assert play(order, [100.0, 99.8, 100.02, 100.02]) == [True] * 4
    assert order.refused == 0


def test_each_name_has_its_own_order() -> None:
    order = OutOfOrderFilter()
    assert order.accepts("anna", 100 * S, 0.0)
    assert order.accepts("ben", 1 * S, 0.0)
    assert not order.accepts("anna", 1 * S, 0.1)
