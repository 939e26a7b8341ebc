"""Messages out of order or late against the docstrings, clocks that are set, and reports of skew."""

import random
from dataclasses import dataclass, field

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.runtime.bus.timeliness import (
    FORGOTTEN_S,
    LATE_S,
    SILENT_S,
    STEADY_S,
    WINDOW_S,
    ClockSkew,
    ClockSkewMonitor,
    LateMessageFilter,
    OutOfOrderFilter,
)
from pointit.schemas import NS_PER_S

S = NS_PER_S
PERIOD_S = 0.02


def play(
    order: OutOfOrderFilter, stamps_s: list[float], began_s: float = 0.0, name: str = "anna"
) -> list[bool]:
    """Offer messages that come every 20 ms; return which are news."""
    times = [began_s + number * PERIOD_S for number in range(len(stamps_s))]
    return [order.accepts(name, round(at_s * S), now_s) for at_s, now_s in zip(stamps_s, times, strict=True)]


names = st.sampled_from(["anna", "ben"])
pauses_s = st.sampled_from(
    [0.01, 0.02, 0.05, 0.09, 0.1, 0.2, 0.45, 0.5, 0.55, 0.9, 1.0, 1.1, 3.0, 19.5, 20.5]
)
stamps_ms = st.sampled_from([0, 100, 501, 600, 1000, 1001, 1500, 2000, 3000, 3001, 5000, 60_000])
ages_s = st.sampled_from([-5.0, 0.0, 0.05, 0.15, 0.25, 0.3, 0.31, 0.4, 0.5, 0.7, 1.0, 3.0])


@settings(max_examples=200)
@given(st.lists(st.tuples(names, pauses_s, stamps_ms), max_size=80))
@example([("anna", 0.1, 0), ("anna", 0.1, 60_000), ("anna", 0.1, 100)])  # a stray from the future
@example([("anna", 0.1, 1000), ("anna", 1.1, 0), ("anna", 0.1, 100)])  # a clock that was set back
def test_any_messages_are_in_order_as_the_docstring_says(messages: list[tuple[str, float, int]]) -> None:
    order = OutOfOrderFilter()
    newest: dict[str, tuple[int, float]] = {}
    now_s = 0.0
    refused = 0
    for name, pause_s, stamp_ms in messages:
        now_s += pause_s
        newest_ms, came_s = newest.get(name, (stamp_ms, now_s))
        is_newest = newest_ms <= stamp_ms <= newest_ms + 2000 or now_s - came_s > SILENT_S
        is_old = not is_newest and stamp_ms < newest_ms - 500
        refused += is_old

        assert order.accepts(name, stamp_ms * 1_000_000, now_s) is not is_old
        if is_newest:
            newest[name] = (stamp_ms, now_s)
        assert order.refused == refused
        assert {each: row.stamp_ns for each, row in order.newest.items()} == {
            each: row[0] * 1_000_000 for each, row in newest.items()
        }


@dataclass
class LinkReading:
    """Model of the delays of one name by the docstring of the module."""

    reference_s: float
    arrived_s: float
    in_time_s: float
    """Arrival of the last message in time, or of the one before the first late one."""
    late: list[tuple[float, float]] = field(default_factory=list)
    """Arrivals and delays of late messages in a row, since their delay is constant."""

    def is_in_time(self, age_s: float, now_s: float) -> bool:
        silent_s = now_s - self.arrived_s
        self.arrived_s = now_s
        grown_s = self.reference_s + 0.05 * min(silent_s, 0.1)
        if silent_s <= FORGOTTEN_S and age_s <= grown_s + LATE_S:
            self.reference_s = min(grown_s, age_s)
            self.in_time_s = now_s
            self.late = []
            return True
        ages = [age for _, age in self.late] + [age_s]
        if silent_s > 0.5 or max(ages) - min(ages) > 0.2:
            self.late = []
        self.late.append((now_s, age_s))
        is_constant = now_s - self.late[0][0] >= STEADY_S
        if is_constant or now_s - self.in_time_s > FORGOTTEN_S:
            self.reference_s = age_s
            self.in_time_s = now_s
            self.late = []
            return True
        return False


@settings(max_examples=300)
@given(st.lists(st.tuples(names, pauses_s, ages_s), max_size=80))
@example([("anna", 0.1, 0.0), *[("anna", 0.1, 1.0)] * 20])  # a link that has become slow
@example([("anna", 0.1, 0.0), *[("anna", 0.45, 1.0), ("anna", 0.45, 0.7)] * 30])  # never constant
def test_any_delays_are_in_time_as_the_docstring_says(messages: list[tuple[str, float, float]]) -> None:
    lateness = LateMessageFilter()
    readings: dict[str, LinkReading] = {}
    now_s = 0.0
    for name, pause_s, age_s in messages:
        now_s += pause_s
        reading = readings.get(name)
        if reading is None:
            readings[name] = LinkReading(reference_s=age_s, arrived_s=now_s, in_time_s=now_s)
            assert lateness.accepts(name, age_s, now_s)
            continue
        reference_s = reading.reference_s
        refused = lateness.refused

        is_in_time = reading.is_in_time(age_s, now_s)

        assert lateness.accepts(name, age_s, now_s) is is_in_time
        assert lateness.refused == refused + (not is_in_time)
        if not is_in_time:
            assert lateness.by_s == pytest.approx(age_s - reference_s)


@pytest.mark.parametrize("back_s", [0.6, 5.0, 3600.0])
def test_clock_set_back_is_accepted_after_a_moment(back_s: float) -> None:
    order = OutOfOrderFilter()
    assert all(play(order, [100.0 + number * PERIOD_S for number in range(50)]))
    later = play(order, [101.0 - back_s + number * PERIOD_S for number in range(100)], began_s=1.0)
    refused = later.index(True)
    assert refused * PERIOD_S <= SILENT_S + 2 * PERIOD_S
    assert all(later[refused:])
    assert order.refused == refused


def test_clock_set_forward_is_believed_and_earlier_stamps_are_old() -> None:
    order = OutOfOrderFilter()
    stamps_s = [
        *(100.0 + number * PERIOD_S for number in range(10)),
        *(200.0 + n * PERIOD_S for n in range(70)),
    ]
    assert all(play(order, stamps_s))
    assert not order.accepts("anna", 100 * S, len(stamps_s) * PERIOD_S)


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


def test_backlog_in_small_parts_is_refused_to_its_end() -> None:
    lateness = LateMessageFilter()
    link(lateness, [0.01] * 100)
    came = [(5.0 + n * 0.015, 3.0 - n * 0.005) for n in range(700)]  # a third more than is said meanwhile
    taken = [age_s for now_s, age_s in came if lateness.accepts("anna", age_s, now_s)]
    assert max(taken) < LATE_S + 0.02


@pytest.mark.parametrize("back_s", [0.5, 5.0, 3600.0])
def test_constant_delay_is_believed_after_a_moment(back_s: float) -> None:
    lateness = LateMessageFilter()
    link(lateness, [0.01] * 100)
    taken = link(lateness, [0.01 + 0.05 * (n % 3) for n in range(200)], began_s=2.0, ahead_s=-back_s)
    assert taken[0] == pytest.approx(2.0 + STEADY_S, abs=0.1)
    assert len(taken) == pytest.approx((4.0 - STEADY_S) / PERIOD_S, abs=5)


def test_clocks_that_run_apart_are_followed() -> None:
    lateness = LateMessageFilter()
    assert all(lateness.accepts("anna", n * PERIOD_S * 0.04, n * PERIOD_S) for n in range(3000))


def test_delays_of_a_busy_machine_are_in_time() -> None:
    lateness = LateMessageFilter()
    assert len(link(lateness, [0.25 if n % 50 == 0 else 0.001 for n in range(1000)])) == 1000


START_NS = 1_700_000_000 * 10**9


def watched(skews_s: dict[str, float], delays_s: dict[str, list[float]]) -> list[ClockSkew]:
    """Return the skews found for machines with these clock offsets and report delays."""
    watch = ClockSkewMonitor("here")
    for host, delays in delays_s.items():
        for second, delay_s in enumerate(delays):
            sent_ns = START_NS + second * 10**9
            stamp_ns = sent_ns + int(skews_s.get(host, 0.0) * 1e9)
            watch.on_report(host, stamp_ns, sent_ns + int(delay_s * 1e9), second + delay_s)
    return list(watch.skews(max(len(delays) for delays in delays_s.values())))


@pytest.mark.parametrize("skew_s", [0.06, 0.3, 1.5, 3600.0, -0.06, -0.3, -1.5, -3600.0])
def test_clock_skew_is_reported_with_machine_and_amount(skew_s: float) -> None:
    found = watched({"there": skew_s}, {"here": [0.001] * 10, "there": [0.002] * 10, "fine": [0.002] * 10})
    assert [skew.host for skew in found] == ["there"]
    assert found[0].ahead_s == pytest.approx(skew_s, abs=0.003)
    assert found[0].exceeds_limit == (abs(skew_s) >= 1.0)


def test_load_is_no_clock_skew_and_wireless_delays_hide_none() -> None:
    loaded_s = [0.07 + 0.01 * number for number in range(20)]
    assert watched({}, {"here": [0.001] * 20, "busy": loaded_s}) == []
    own_s = [0.4 + 0.05 * number for number in range(10)]
    assert watched({}, {"here": own_s, "busy": [0.07 + each for each in own_s]}) == []
    wireless_s = [0.004 + 0.003 * (number % 10) for number in range(20)]
    assert [skew.host for skew in watched({"there": -0.06}, {"there": wireless_s})] == ["there"]


@given(seed=st.integers(0, 10_000), count=st.integers(1, 20), skew_s=st.floats(-0.045, 0.04))
def test_variable_delay_is_not_reported_as_clock_skew(seed: int, count: int, skew_s: float) -> None:
    """Delays of up to a second, of which now and then one is small: as of processes that wait for a core."""
    chance = random.Random(seed)
    delays = [chance.choice([0.002, chance.uniform(0.0, 1.0), chance.expovariate(3.0)]) for _ in range(count)]
    delays[chance.randrange(count)] = 0.002
    assert not watched({"there": skew_s}, {"there": delays})


def test_few_and_uneven_reports_prove_nothing_yet() -> None:
    assert not watched({}, {"there": [0.08]})
    assert not watched({}, {"there": [0.08, 0.3]})
    assert not watched({}, {"there": [0.08, 0.3, 0.2, 0.15]})
    assert watched({"there": -0.5}, {"there": [0.02, 0.1, 0.05]}), "steady for what they are"


def test_a_clock_that_was_set_right_is_believed() -> None:
    watch = ClockSkewMonitor("here")
    for second in range(5):
        watch.on_report("there", START_NS + 10**9, START_NS, float(second))
    assert list(watch.skews(5.0))
    for second in range(5, 5 + int(WINDOW_S)):
        watch.on_report("there", START_NS, START_NS + 10**6, float(second))
    assert not list(watch.skews(5.0 + WINDOW_S))
    assert not list(watch.skews(1000.0))


def test_hosts_are_bounded() -> None:
    watch = ClockSkewMonitor("here")
    for number in range(1000):
        watch.on_report(f"made-up-{number}", START_NS, START_NS, number / 1000)
    assert len(watch._reports) <= 256
