"""Method gauge: any cursors against a reading of the docstring of `Gauges`, and the speed of the ray."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.services.selector.methods.gauge import Gauges, RaySpeedEstimator
from tests.support import there

MS = 1_000_000
GAP = 250
"""Longest gap, ms."""
FULL = 800
"""Time that fills a gauge, ms. It drains in twice this time."""
LEAVE = 300
"""Time off an object after which its gauge fills again, ms."""

Cursor = tuple[int, str | None, bool]
"""Pause before it, ms, the object that is hovered, and whether its gauge fills."""

pauses_ms = st.sampled_from([1, 10, 50, 100, 240, 249, 250, 251, 290, 300, 400])
cursors = st.lists(
    st.tuples(st.lists(pauses_ms, min_size=1, max_size=12), st.sampled_from(["a", "b", None]), st.booleans()),
    max_size=12,
).map(lambda stays: [(pause, name, fills) for pauses, name, fills in stays for pause in pauses])


def stay(count: int, name: str | None, *, pause_ms: int = 10, fills: bool = True) -> list[Cursor]:
    return [(pause_ms, name, fills)] * count


@dataclass
class Reading:
    """Model of the method by its docstring, with levels in ms of filling, 0 to `FULL`."""

    time_ms: int = 0
    levels: dict[str, float] = field(default_factory=lambda: {"a": 0.0, "b": 0.0})
    left_ms: dict[str, int | None] = field(default_factory=dict)
    """Fired objects, and the time since which they are left."""

    def fired(self, pause_ms: int, hovered: str | None, *, fills: bool, is_first: bool) -> str | None:
        passed_ms = 0 if is_first else pause_ms
        self.time_ms += pause_ms
        has_gap = passed_ms > GAP
        for name, since_ms in [*self.left_ms.items()]:
            if name == hovered:
                self.left_ms[name] = None
            elif since_ms is None or has_gap:
                self.left_ms[name] = self.time_ms
            elif self.time_ms - since_ms >= LEAVE:
                del self.left_ms[name]
        for name, level in self.levels.items():
            if name != hovered or has_gap:
                self.levels[name] = max(level - passed_ms / 2, 0.0)
            elif fills and name not in self.left_ms:
                self.levels[name] = level + passed_ms
        if hovered is None or self.levels[hovered] < FULL:
            return None
        self.levels[hovered] = 0.0
        self.left_ms[hovered] = None
        return hovered


def fired_ms(gauges: Gauges, stream: list[Cursor]) -> Iterator[int]:
    """Yield the times at which a gauge fires, ms after the first cursor."""
    time_ms = 0
    for index, (pause_ms, hovered, fills) in enumerate(stream):
        time_ms += pause_ms if index else 0
        not_left = () if hovered is None else (hovered,)
        if gauges.step(time_ms * MS, hovered, fills=fills, full_s=FULL / 1000, not_left=not_left):
            yield time_ms


@settings(max_examples=200)
@given(cursors)
@example([*stay(81, "a"), *stay(29, None), *stay(200, "a")])  # left for 0.29 s, which is too short
@example([*stay(81, "a"), *stay(31, None), *stay(200, "a")])
@example([*stay(81, "a"), *stay(9, None), *stay(1, None, pause_ms=400), *stay(9, None), *stay(200, "a")])
def test_any_cursors_fill_and_fire_as_the_docstring_says(stream: list[Cursor]) -> None:
    gauges = Gauges(longest_gap_s=GAP / 1000, full_s=FULL / 1000)
    reading = Reading()
    for index, (pause_ms, hovered, fills) in enumerate(stream):
        expected = reading.fired(pause_ms, hovered, fills=fills, is_first=index == 0)
        not_left = () if hovered is None else (hovered,)

        fired = gauges.step(reading.time_ms * MS, hovered, fills=fills, full_s=FULL / 1000, not_left=not_left)

        assert fired == expected
        assert set(gauges.latched) == set(reading.left_ms)
        for name, level in reading.levels.items():
            assert gauges.fill(name) == pytest.approx(level / FULL, abs=1e-9)
            assert gauges.filled_s(name) == pytest.approx(level / 1000, abs=1e-9)


@pytest.mark.parametrize(
    ("stream", "fires_ms"),
    [
        (stay(500, "a"), [800]),
        (stay(5, "a", pause_ms=240), [960]),  # at the first cursor from its time on
        (
            [*stay(41, "a"), *stay(160, "a", fills=False), *stay(100, "a")],
            [2400],
        ),  # a fast ray keeps the level
        ([*stay(41, "a"), *stay(40, "b"), *stay(100, "a")], [1400]),  # drained by half of what it had
        ([*stay(41, "a"), *stay(1, "a", pause_ms=400), *stay(100, "a")], [1400]),  # so does a gap
    ],
)
def test_gauge_by_example(stream: list[Cursor], fires_ms: list[int]) -> None:
    assert [*fired_ms(Gauges(longest_gap_s=0.25, full_s=0.8), stream)] == fires_ms


def test_spent_time_is_that_of_a_shorter_fill() -> None:
    """Beside nothing else a gauge fills faster; of a drained level the same share of the time is left."""
    gauges = Gauges(longest_gap_s=0.25, full_s=0.8)
    for time_ms in range(0, 201, 10):
        gauges.step(time_ms * MS, "a", fills=True, full_s=0.4)
    for time_ms in range(210, 401, 10):
        gauges.step(time_ms * MS, None, fills=True, full_s=0.4)

    assert gauges.fill("a") == pytest.approx(0.5 - 0.125)
    assert gauges.filled_s("a") == pytest.approx(0.2 * 0.375 / 0.5)


S = 1_000_000_000


def speed_deg_s(steadiness: RaySpeedEstimator) -> float:
    return math.degrees(math.hypot(*there(steadiness.rate())))


@given(st.lists(st.integers(1, 60), min_size=3, max_size=12), st.floats(-40, 40), st.floats(-40, 40))
def test_speed_does_not_depend_on_the_times_of_rays(
    gaps_ms: list[int], turned_deg_s: float, raised_deg_s: float
) -> None:
    steadiness = RaySpeedEstimator(0.15)
    time_ms = 0
    elevation = 0.0
    for gap_ms in gaps_ms:
        time_ms += gap_ms
        elevation = math.radians(raised_deg_s * time_ms / 1000)
        steadiness.add(
            time_ms * 1_000_000, vector.direction(math.radians(turned_deg_s * time_ms / 1000), elevation)
        )
    rate = there(steadiness.rate())
    assert math.degrees(rate[0]) == pytest.approx(turned_deg_s * math.cos(elevation), abs=1e-6)
    assert math.degrees(rate[1]) == pytest.approx(raised_deg_s, abs=1e-6)


@pytest.mark.parametrize("frequency_hz", [6.0, 12.0])
def test_highest_tremor_counts_as_steady(frequency_hz: float) -> None:
    steadiness = RaySpeedEstimator(0.15)
    highest = 0.0
    for index in range(400):
        time_s = index / 100
        wiggle_deg = 0.1 * math.sqrt(2.0) * math.sin(2 * math.pi * frequency_hz * time_s)
        steadiness.add(round(time_s * S), vector.direction(math.radians(wiggle_deg), -0.3))
        if index > 20:
            highest = max(highest, speed_deg_s(steadiness))
    assert highest < 4.0  # the momentary speed goes up to 10.7 degrees/s


def test_single_wrong_sample_changes_the_speed_little() -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(100):
        wrong = 0.3 if index == 95 else 0.0
        steadiness.add(index * S // 100, vector.direction(wrong, -0.3))
        if index > 1:
            assert speed_deg_s(steadiness) < 1e-9


def test_speed_needs_two_rays_at_any_rate() -> None:
    steadiness = RaySpeedEstimator(0.15)
    assert steadiness.rate() is None
    steadiness.add(0, (1.0, 0.0, 0.0))
    assert steadiness.rate() is None
    steadiness.add(S // 5, vector.direction(math.radians(1.0), 0.0))
    assert speed_deg_s(steadiness) == pytest.approx(5.0)
    steadiness.clear()
    assert steadiness.rate() is None


def test_rays_a_nanosecond_apart_have_a_speed() -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(4):
        steadiness.add(1_700_000_000 * S + index, vector.direction(math.radians(1e-6 * index), 0.0))
    assert speed_deg_s(steadiness) == pytest.approx(1000.0, rel=1e-6)


@pytest.mark.parametrize("turned_deg_s", [10.0, -10.0])
def test_speed_does_not_jump_with_the_azimuth(turned_deg_s: float) -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(11):
        turned_deg = 180.0 + turned_deg_s * (index - 5) / 100
        steadiness.add(index * S // 100, vector.direction(math.radians(turned_deg), 0.0))
    assert math.degrees(there(steadiness.rate())[0]) == pytest.approx(turned_deg_s)
