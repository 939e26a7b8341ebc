"""Messages delayed by a link are refused, a clock that was set is believed."""

import pytest

from pointit.runtime.bus.timeliness import FORGOTTEN_S, LATE_S, STEADY_S, LateMessageFilter

PERIOD_S = 0.02


def link(
    lateness: LateMessageFilter, delays_s: list[float], began_s: float = 0.0, ahead_s: float = 0.0
) -> list[float]:
    """Send every 20 ms over a link that keeps the order. Return the send times of accepted messages.

    Args:
        lateness: of the reader.
        delays_s: of each message by itself. None arrives before earlier ones.
        began_s: time of the first message.
        ahead_s: lead of the writer's clock.
    """
    taken: list[float] = []
    comes_s = began_s
    for number, delay_s in enumerate(delays_s):
        said_s = began_s + number * PERIOD_S
        comes_s = max(comes_s, said_s + delay_s)
        if lateness.accepts("anna", comes_s - said_s - ahead_s, comes_s):
            taken.append(said_s)
    return taken


@pytest.mark.parametrize("held_s", [0.6, 3.0, 8.0])
@pytest.mark.parametrize("ahead_s", [0.0, 0.7, -5.0])
def test_delayed_messages_are_refused_whatever_the_clocks_say(held_s: float, ahead_s: float) -> None:
    lateness = LateMessageFilter()
    delays_s = [0.01] * 100 + [held_s] + [0.01] * 1000
    taken = link(lateness, delays_s, ahead_s=ahead_s)
    stalled_s = 100 * PERIOD_S
    held = [said_s for said_s in taken if stalled_s <= said_s < stalled_s + held_s - LATE_S - 2 * PERIOD_S]
    assert held == []
    assert len(taken) == len(delays_s) - lateness.refused
    assert lateness.refused == pytest.approx((held_s - LATE_S) / PERIOD_S, abs=3)
    assert lateness.by_s == pytest.approx(LATE_S, abs=2 * PERIOD_S)


def test_repeated_delays_are_never_mistaken_for_a_slow_clock() -> None:
    lateness = LateMessageFilter()
    stalls = [delay_s for _ in range(20) for delay_s in [2.0] + [0.01] * 120]
    taken = link(lateness, [0.01] * 50 + stalls)
    assert lateness.refused > 20 * 80
    assert len(taken) > 20 * 20
    late = LateMessageFilter()
    assert late.accepts("anna", 0.01, 0.0)
    bursts = [(burst * 1.6, 1.0 + number * PERIOD_S) for burst in range(1, 10) for number in range(3)]
    assert not any(late.accepts("anna", age_s, now_s) for now_s, age_s in bursts)


def test_a_backlog_that_comes_bit_by_bit_is_refused_to_its_end() -> None:
    lateness = LateMessageFilter()
    link(lateness, [0.01] * 100)
    came = [(5.0 + n * 0.015, 3.0 - n * 0.005) for n in range(700)]  # a third more than is said meanwhile
    taken = [age_s for now_s, age_s in came if lateness.accepts("anna", age_s, now_s)]
    assert max(taken) < LATE_S + 0.02


@pytest.mark.parametrize("back_s", [0.5, 5.0, 3600.0])
def test_a_clock_that_was_set_back_and_a_link_that_became_slow_are_believed(back_s: float) -> None:
    lateness = LateMessageFilter()
    link(lateness, [0.01] * 100)
    taken = link(lateness, [0.01 + 0.05 * (n % 3) for n in range(200)], began_s=2.0, ahead_s=-back_s)
    assert taken[0] == pytest.approx(2.0 + STEADY_S, abs=0.1)
    assert len(taken) == pytest.approx((4.0 - STEADY_S) / PERIOD_S, abs=5)


def test_a_clock_that_was_ahead_and_is_set_right_is_believed() -> None:
    lateness = LateMessageFilter()
    link(lateness, [0.01] * 100, ahead_s=5.0)
    assert link(lateness, [0.01] * 200, began_s=2.0)[0] <= 2.0 + STEADY_S + 0.1


def test_clocks_that_run_apart_are_followed() -> None:
    lateness = LateMessageFilter()
    assert all(lateness.accepts("anna", n * PERIOD_S * 0.04, n * PERIOD_S) for n in range(3000))


def test_delays_of_a_busy_machine_are_in_time() -> None:
    lateness = LateMessageFilter()
    assert len(link(lateness, [0.25 if n % 50 == 0 else 0.001 for n in range(1000)])) == 1000


def test_a_long_silence_resets_each_name_separately() -> None:
    lateness = LateMessageFilter()
    assert lateness.accepts("anna", 0.0, 0.0)
    assert lateness.accepts("ben", 9.0, 0.0)
    assert not lateness.accepts("anna", 9.0, FORGOTTEN_S - 1.0)
    assert lateness.accepts("anna", 9.0, FORGOTTEN_S + 1.0)
    assert lateness.refused == 1
