"""Stale, out of order, from the future, repeated, after a restart."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation
from pointit.schemas import ImuSample
from pointit.services.pointing.pointer import Freshness

S = 1_000_000_000
NOW_NS = 1_700_000_000 * S


def sample(stamp_ns: int, device_time_ns: int | None = None) -> ImuSample:
    return ImuSample(stamp_ns=stamp_ns, orientation_xyzw=rotation.IDENTITY, device_time_ns=device_time_ns)


def test_stale_and_older_samples_are_refused() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(sample(1_000_000_000), 1_300_000_000) == "stale"
    assert freshness.classify(sample(1_000_000_000), 1_100_000_000) == "fresh"
    assert freshness.classify(sample(900_000_000), 1_000_000_000) == "stale"
    assert (freshness.count, freshness.stale) == (3, 2)


def test_one_sample_from_the_future_is_refused_and_spoils_none() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(sample(NOW_NS), NOW_NS) == "fresh"
    assert freshness.classify(sample(NOW_NS + 3600 * S), NOW_NS) == "stale"
    assert freshness.classify(sample(2**63 - 1), NOW_NS) == "stale"
    assert freshness.classify(sample(NOW_NS + S // 50), NOW_NS + S // 50) == "fresh"
    assert freshness.stale == 2


def test_only_the_device_time_proves_a_repeat() -> None:
    freshness = Freshness(0.2)
    still = [freshness.classify(sample(NOW_NS + k), NOW_NS + k) for k in range(5)]  # the same orientation
    assert still == ["fresh"] * 5
    told = [freshness.classify(sample(NOW_NS + 9, 77), NOW_NS + 9) for _ in range(3)]
    assert told == ["fresh", "repeated", "repeated"]
    assert (freshness.repeated, freshness.stale, freshness.restarts) == (2, 0, 0)


def test_a_repeat_with_a_newer_stamp_does_not_make_the_next_sample_old() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(sample(NOW_NS, 0), NOW_NS) == "fresh"
    assert freshness.classify(sample(NOW_NS + 30, 0), NOW_NS + 30) == "repeated"
    assert freshness.classify(sample(NOW_NS + 20, 20), NOW_NS + 30) == "fresh"


def test_a_restarted_device_is_taken_and_counted() -> None:
    freshness = Freshness(0.2)
    times = (60 * S, 60 * S + 20, 5, 25, 25, 45)
    verdicts = [freshness.classify(sample(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert verdicts == ["fresh", "fresh", "fresh", "fresh", "repeated", "fresh"]
    assert freshness.restarts == 1


def test_samples_that_overtook_each_other_are_no_restart() -> None:
    freshness = Freshness(0.2)
    times = (S, S + 40_000_000, S + 20_000_000, S + 60_000_000)
    verdicts = [freshness.classify(sample(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert verdicts == ["fresh", "fresh", "stale", "fresh"]
    assert (freshness.restarts, freshness.stale) == (0, 1)


def test_samples_with_and_without_device_time_may_come_mixed() -> None:
    freshness = Freshness(0.2)
    times = (7, None, 7, None, 9)
    verdicts = [freshness.classify(sample(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert verdicts == ["fresh", "fresh", "repeated", "fresh", "fresh"]


@given(st.lists(st.integers(1, S), max_size=30), st.lists(st.integers(0, 29), max_size=30))
def test_every_news_is_fresh_once_however_often_it_is_said(steps: list[int], again: list[int]) -> None:
    freshness = Freshness(0.2)
    device_ns = 0
    for index, step in enumerate(steps):
        device_ns += step
        now_ns = NOW_NS + device_ns
        said = 1 + again.count(index)
        verdicts = [freshness.classify(sample(now_ns, device_ns), now_ns) for _ in range(said)]
        assert verdicts == ["fresh", *["repeated"] * (said - 1)]
    assert freshness.count == len(steps) + freshness.repeated
