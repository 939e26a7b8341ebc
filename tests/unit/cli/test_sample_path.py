"""Joining of messages to samples: order, losses, duplicates, other people's frames; and their figures."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.inspect.sample_path import (
    CAPTURE,
    MAX_OPEN,
    SETTLE_S,
    PathJoiner,
    SamplePath,
    farthest,
    hop_figures,
)

MS = 1_000_000
STAMP = 1_700_000_000_000_000_000
READY_S = SETTLE_S + 0.1
LATER_S = READY_S + SETTLE_S
TIMES_MS = {"imu": 1, "ray": 3, "cursor": 6, "hover": 7, "frame": 10, "light": 30}


def joiner() -> PathJoiner:
    return PathJoiner(lambda stamp_ns: stamp_ns, began_s=0.0)


def add(joined: PathJoiner, hop: str, at_ms: float, *, stamp_ns: int = STAMP, now_s: float = READY_S) -> None:
    joined.add(hop, stamp_ns, stamp_ns + round(at_ms * MS), f"process of {hop}", now_s)


def test_messages_of_one_capture_are_one_sample_in_any_order() -> None:
    for hops in itertools.permutations(TIMES_MS):
        joined = joiner()
        for hop in hops:
            add(joined, hop, TIMES_MS[hop])
        (path,) = joined.settled(LATER_S)
        assert {hop: path.total_s(hop) for hop in TIMES_MS} == pytest.approx(
            {hop: ms / 1e3 for hop, ms in TIMES_MS.items()}
        )
        assert {hop: path.delta_s(hop) for hop in TIMES_MS} == pytest.approx(
            {"imu": 0.001, "ray": 0.002, "cursor": 0.003, "hover": 0.001, "frame": 0.004, "light": 0.02}
        )
        assert path.processes["ray"] == "process of ray"


def test_a_sample_is_judged_once_it_has_settled() -> None:
    joined = joiner()
    add(joined, "imu", 1)
    assert joined.settled(LATER_S - 0.001) == []
    assert [path.stamp_ns for path in joined.settled(LATER_S)] == [STAMP]
    assert joined.settled(LATER_S + 10) == []


def test_a_message_that_comes_after_the_judgement_is_no_sample_of_its_own() -> None:
    joined = joiner()
    add(joined, "imu", 1)
    (path,) = joined.settled(LATER_S)
    add(joined, "ray", 3, now_s=LATER_S)
    assert joined.settled(LATER_S + 10) == []
    assert path.total_s("ray") is None


def test_of_two_messages_for_a_hop_the_first_published_counts() -> None:
    joined = joiner()
    add(joined, "cursor", 6)
    add(joined, "cursor", 4)
    add(joined, "cursor", 9)
    (path,) = joined.settled(LATER_S)
    assert path.total_s("cursor") == pytest.approx(0.004)


def test_a_lost_hop_has_no_time_and_the_next_one_has_no_delta() -> None:
    joined = joiner()
    add(joined, "imu", 1)
    add(joined, "cursor", 6)
    (path,) = joined.settled(LATER_S)
    assert path.total_s("ray") is None
    assert path.delta_s("ray") is None
    assert path.delta_s("cursor") is None
    assert path.total_s("cursor") == pytest.approx(0.006)


def test_frames_of_other_people_are_no_samples() -> None:
    joined = joiner()
    add(joined, "frame", 10)
    add(joined, "light", 12)
    assert joined.settled(LATER_S) == []


def test_samples_first_heard_at_the_start_are_left_out() -> None:
    joined = joiner()
    add(joined, "ray", 3, now_s=SETTLE_S - 0.01)
    add(joined, "hover", 7, now_s=READY_S)
    add(joined, "imu", 1, stamp_ns=STAMP + MS)
    assert [path.stamp_ns for path in joined.settled(LATER_S)] == [STAMP + MS]


def test_capture_is_converted_to_wall_time() -> None:
    joined = PathJoiner(lambda stamp_ns: stamp_ns // 2, began_s=0.0)
    joined.add("imu", 2000 * MS, 1004 * MS, "", READY_S)
    (path,) = joined.settled(LATER_S)
    assert path.delta_s("imu") == pytest.approx(0.004)


def test_memory_is_bounded() -> None:
    joined = joiner()
    for k in range(MAX_OPEN + 10):
        add(joined, "imu", 1, stamp_ns=STAMP + k)
    stamps = [path.stamp_ns for path in joined.settled(LATER_S)]
    assert stamps == [STAMP + k for k in range(10, MAX_OPEN + 10)]


def test_figures_count_what_reached_each_hop() -> None:
    paths = [
        SamplePath(STAMP, {CAPTURE: 0, "imu": 1 * MS, "ray": 2 * MS}),
        SamplePath(STAMP + 1, {CAPTURE: 0, "imu": 3 * MS}),
        SamplePath(STAMP + 2, {CAPTURE: 0, "ray": 9 * MS}),
    ]
    imu, ray = hop_figures(paths)
    assert (imu.hop, imu.after, imu.samples) == ("imu", CAPTURE, 2)
    assert (imu.total_p50_s, imu.total_p99_s) == pytest.approx((0.001, 0.003))
    assert (ray.hop, ray.after, ray.samples) == ("ray", "imu", 2)
    assert (ray.delta_p50_s, ray.delta_p99_s) == pytest.approx((0.001, 0.001))
    assert (ray.total_p50_s, ray.total_p99_s) == pytest.approx((0.002, 0.009))


def test_a_hop_without_the_one_before_has_totals_only() -> None:
    (ray,) = hop_figures([SamplePath(STAMP, {CAPTURE: 0, "ray": 2 * MS})])
    assert (ray.delta_p50_s, ray.delta_p99_s) == (None, None)
    assert ray.total_p50_s == pytest.approx(0.002)


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=300))
def test_percentiles_are_nearest_ranks(values_ns: list[int]) -> None:
    (imu,) = hop_figures([SamplePath(k, {CAPTURE: 0, "imu": ns}) for k, ns in enumerate(values_ns)])
    ranked = sorted(values_ns)
    count = len(ranked)
    assert imu.delta_p50_s == pytest.approx(ranked[(count + 1) // 2 - 1] / 1e9)
    assert imu.delta_p99_s == pytest.approx(ranked[-(-99 * count // 100) - 1] / 1e9)


def test_the_sample_shown_is_the_newest_that_came_farthest() -> None:
    short = SamplePath(STAMP + 9, {CAPTURE: 0, "imu": 1})
    far = SamplePath(STAMP + 1, {CAPTURE: 0, "imu": 1, "ray": 2})
    newer = SamplePath(STAMP + 2, {CAPTURE: 0, "imu": 1, "ray": 2})
    assert farthest([far, newer, short]) is newer
