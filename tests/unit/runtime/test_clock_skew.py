"""Clock skew is reported for sure, for the right machine, and never only because a machine is busy."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.bus.timeliness import APART_S, WINDOW_S, ClockSkew, ClockSkewMonitor

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


@pytest.mark.parametrize("skew_s", [0.04, -0.04])
def test_a_little_apart_is_nothing(skew_s: float) -> None:
    assert not watched({"there": skew_s}, {"there": [0.002] * 10})


@given(seed=st.integers(0, 10_000), count=st.integers(1, 20), skew_s=st.floats(-0.045, 0.04))
def test_variable_delay_is_not_reported_as_clock_skew(seed: int, count: int, skew_s: float) -> None:
    """Delays of up to a second, of which now and then one is small: as of processes that wait for a core."""
    chance = random.Random(seed)
    delays = [chance.choice([0.002, chance.uniform(0.0, 1.0), chance.expovariate(3.0)]) for _ in range(count)]
    delays[chance.randrange(count)] = 0.002
    assert not watched({"there": skew_s}, {"there": delays})


def test_what_delays_all_is_this_machines_own_load() -> None:
    assert not watched({}, {"here": [0.4] * 10, "there": [0.42] * 10})


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
    for number in range(10_000):
        watch.on_report(f"made-up-{number}", START_NS, START_NS, number / 1000)
    assert len(watch._late) <= 256


def test_the_sentence_names_machine_amount_and_consequence() -> None:
    little = ClockSkew(host="pi", ahead_s=-0.08).sentence("desk")
    assert "machine pi is 80 ms behind the clock of desk" in little
    assert "latency" in little
    much = ClockSkew(host="pi", ahead_s=1.5).sentence("desk")
    assert "machine pi is 1.5 s ahead of the clock of desk" in much
    assert "refused" in much
    assert APART_S < 1
