"""Host time of capture from a device's clock: bounds, gain over arrivals, and clocks that are set."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.wrist.device_clock import MAX_AGE_NS, DeviceClock, slope_below

MS = NS_PER_S // 1000
HOST_NS = 1_700_000_000 * NS_PER_S
SEEDS = 20
Link = tuple[list[int], list[int], list[int]]
"""True captures, device times and arrivals, ns."""


def radio(seed: int, *, drift: float = 3e-5, interval_s: float = 0.015, seconds: int = 40) -> Link:
    """Return 100 samples a second through a radio with connection events, some of which are lost."""
    random = np.random.default_rng(seed)
    captured_s = np.arange(0.0, seconds, 0.01) + random.uniform(0.0, 0.01)
    events_s = np.arange(0.0, seconds + 5.0, interval_s)
    is_good = random.random(len(events_s)) > 0.1
    for start in np.nonzero(random.random(len(events_s)) < 0.01)[0]:  # bursts of loss
        is_good[start : start + int(random.exponential(0.08) / interval_s) + 1] = False
    good_s = events_s[is_good]
    sent_s = good_s[np.searchsorted(good_s, captured_s + 0.0015)]
    busy_s = (random.random(len(sent_s)) < 0.01) * random.exponential(0.01, len(sent_s))
    arrived_s = np.maximum.accumulate(sent_s + 0.001 + random.exponential(0.0005, len(sent_s)) + busy_s)
    device_s = captured_s * (1.0 + drift) + random.uniform(0.0, 1000.0)
    return (
        [HOST_NS + round(each * 1e9) for each in captured_s.tolist()],
        [round(each * 1e6) * 1000 for each in device_s.tolist()],
        [HOST_NS + round(each * 1e9) for each in arrived_s.tolist()],
    )


def spread_ms(stamps_ns: list[int], captured_ns: list[int]) -> float:
    """Return the standard deviation of the errors of stamps, after the first 5 s, ms."""
    errors = np.array(stamps_ns[500:]) - np.array(captured_ns[500:])
    return float(errors.std()) / MS


@pytest.mark.parametrize(
    ("drift", "interval_s", "limit_ms"), [(3e-5, 0.015, 1.0), (-1e-4, 0.045, 2.0), (5e-3, 0.015, 2.0)]
)
def test_jitter_of_a_radio_is_removed(drift: float, interval_s: float, limit_ms: float) -> None:
    before: list[float] = []
    after: list[float] = []
    drifts: list[float] = []
    for seed in range(SEEDS):
        captured_ns, device_ns, arrived_ns = radio(seed, drift=drift, interval_s=interval_s)
        clock = DeviceClock()
        stamps_ns = [clock.capture_ns(*each) for each in zip(device_ns, arrived_ns, strict=True)]
        assert clock.jumps == 0
        before.append(spread_ms(arrived_ns, captured_ns))
        after.append(spread_ms(stamps_ns, captured_ns))
        drifts.append(clock.drift)
    assert min(before) > 5.0
    assert max(after) < limit_ms
    assert np.mean(drifts) == pytest.approx(drift, abs=2e-5 + 0.02 * abs(drift))


@given(
    st.lists(
        st.tuples(st.integers(-3 * NS_PER_S, 3 * NS_PER_S), st.integers(0, 3 * NS_PER_S)),
        min_size=1,
        max_size=60,
    )
)
def test_stamps_are_never_in_the_future_nor_decreasing_nor_old(steps: list[tuple[int, int]]) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns, before_ns = 0, HOST_NS, 0
    for device_step_ns, arrival_step_ns in steps:
        device_ns += device_step_ns
        arrival_ns += arrival_step_ns
        stamp_ns = clock.capture_ns(device_ns, arrival_ns)
        assert arrival_ns - MAX_AGE_NS <= stamp_ns <= arrival_ns
        assert stamp_ns >= before_ns
        before_ns = stamp_ns


def fed(clock: DeviceClock, device_ns: int, arrival_ns: int, seconds: float) -> tuple[int, int]:
    """Feed 100 samples a second without jitter. Return the next device time and arrival."""
    for _ in range(round(100 * seconds)):
        stamp_ns = clock.capture_ns(device_ns, arrival_ns)
        assert stamp_ns <= arrival_ns
        device_ns, arrival_ns = device_ns + 10 * MS, arrival_ns + 10 * MS
    return device_ns, arrival_ns


@pytest.mark.parametrize("step_s", [-30.0, -1.0, 1.0, 30.0])
def test_clock_that_is_set_is_recognized_and_followed(step_s: float) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 7 * NS_PER_S, HOST_NS, 20.0)
    device_ns, arrival_ns = fed(clock, device_ns + round(step_s * NS_PER_S), arrival_ns, 5.0)
    assert clock.jumps == 1
    assert clock.jump_s == pytest.approx(step_s, abs=0.1)
    assert clock.capture_ns(device_ns, arrival_ns) == pytest.approx(arrival_ns, abs=5 * MS)


def oldest_ms(clock: DeviceClock, device_ns: int, arrival_ns: int, seconds: float) -> float:
    """Feed 100 samples a second, which arrive at once. Return the largest age of their stamps, ms."""
    ages_ns = [
        arrival_ns + passed_ns - clock.capture_ns(device_ns + passed_ns, arrival_ns + passed_ns)
        for passed_ns in range(0, round(seconds * NS_PER_S), 10 * MS)
    ]
    return max(ages_ns) / MS


@pytest.mark.parametrize(("step_s", "jumps"), [(-0.45, 1), (-0.2, 1), (0.2, 0), (0.45, 0)])
def test_small_step_of_a_clock_is_followed_within_a_second(step_s: float, jumps: int) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 7 * NS_PER_S, HOST_NS, 60.0)
    device_ns, arrival_ns = fed(clock, device_ns + round(step_s * NS_PER_S), arrival_ns, 1.1)
    assert oldest_ms(clock, device_ns, arrival_ns, 60.0) < 5.0
    assert clock.jumps == jumps  # a step ahead may be a link that was slow until then


@pytest.mark.parametrize("ahead_s", [0.2, 0.45, 3.0])
def test_one_device_time_that_is_ahead_is_ignored(ahead_s: float) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 7 * NS_PER_S, HOST_NS, 60.5)
    assert clock.capture_ns(device_ns + round(ahead_s * NS_PER_S), arrival_ns) == arrival_ns
    assert oldest_ms(clock, device_ns + 10 * MS, arrival_ns + 10 * MS, 60.0) < 5.0
    assert clock.jumps == 0


def test_link_that_stalls_is_no_jump() -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 0, HOST_NS, 20.0)
    for number in range(150):  # all that the device has sent meanwhile
        clock.capture_ns(device_ns + number * 10 * MS, arrival_ns + 1500 * MS)
    fed(clock, device_ns + 1500 * MS, arrival_ns + 1500 * MS, 5.0)
    assert clock.jumps == 0


@pytest.mark.parametrize("speed", [0.0, 1e-3, 1000.0])
def test_clock_of_another_unit_or_that_stands_still_is_not_used(speed: float) -> None:
    clock = DeviceClock()
    for number in range(2000):
        clock.capture_ns(round(number * 10 * MS * speed), HOST_NS + number * 10 * MS)
    assert not clock.is_used
    arrival_ns = HOST_NS + 20 * NS_PER_S
    assert clock.capture_ns(round(20 * NS_PER_S * speed), arrival_ns) == arrival_ns


def test_clock_that_runs_again_is_used_again() -> None:
    clock = DeviceClock()
    for number in range(1200):
        clock.capture_ns(5, HOST_NS + number * 10 * MS)
    assert not clock.is_used
    fed(clock, 5, HOST_NS + 12 * NS_PER_S, 60.0)
    assert clock.is_used


def test_slope_is_that_of_the_hull_below_the_points() -> None:
    points = [(0, 5.0), (10, 1.0), (20, 9.0), (30, 3.0), (40, 8.0)]
    assert slope_below(points) == pytest.approx(2.0 / 20)
    assert slope_below([(0, 1.0)]) == 0.0
