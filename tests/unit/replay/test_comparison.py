"""Messages of two runs paired and measured."""

from typing import Any

import pytest

from pointit.cli.recordings.replay import first_lines
from pointit.replay.comparison import Comparison, ComparisonReport, Leaf, Sample, TopicReport, differences

MS = 1_000_000
RAY, POSE, CURSOR = "users/anna/ray", "users/anna/pose", "users/anna/cursor"


def sample(key: str, at_ms: int, stamp_ms: int | None = None, **content: Any) -> Sample:
    stamp_ns = (at_ms if stamp_ms is None else stamp_ms) * MS
    return Sample(key, at_ms * MS, stamp_ns, {"stamp_ns": stamp_ns, **content})


def report(
    recorded: list[Sample], replayed: list[Sample], *, time_tolerance_s: float = 0.1
) -> ComparisonReport:
    comparison = Comparison(time_tolerance_s=time_tolerance_s)
    there = [each.time_ns for each in (*recorded, *replayed)]
    for time_ns in sorted(set(there)):
        for each in recorded:
            if each.time_ns == time_ns:
                comparison.add("recorded", each)
        for each in replayed:
            if each.time_ns == time_ns:
                comparison.add("replayed", each)
    return comparison.finish()


def one(recorded: list[Sample], replayed: list[Sample], **options: float) -> TopicReport:
    (topic,) = report(recorded, replayed, **options).topics
    return topic


def test_equal_runs_have_no_difference() -> None:
    both = [sample(RAY, at, direction=(1.0, 0.0, 0.0)) for at in range(0, 5000, 20)]
    found = report(both, both)
    assert found.is_same
    assert found.first is None
    assert found.topics[0].recorded == found.topics[0].replayed == 250


@pytest.mark.parametrize(
    ("key", "change", "differ"), [(RAY, 5e-10, 0), (RAY, 5e-9, 1), (POSE, 5e-7, 0), (POSE, 5e-6, 1)]
)
def test_numbers_differ_beyond_the_tolerance_of_their_topic(key: str, change: float, differ: int) -> None:
    topic = one([sample(key, 0, x=1.0)], [sample(key, 0, x=1.0 + change)])
    assert topic.differ == differ


def test_largest_difference_is_told_by_field_with_the_first_message() -> None:
    before = [sample(CURSOR, at, point_m=(0.0, 0.0, 1.0)) for at in (0, 20, 40)]
    after = [
        sample(CURSOR, at, point_m=(0.0, x, 1.0)) for at, x in zip((0, 20, 40), (0.0, 0.1, -0.3), strict=True)
    ]
    topic = one(before, after)
    assert (topic.differ, topic.only_recorded, topic.only_replayed) == (2, 0, 0)
    assert [(each.field, each.differ, each.largest) for each in topic.fields] == [("point_m", 2, 0.3)]
    assert topic.first is not None
    assert topic.first.time_ns == 20 * MS
    assert topic.first.recorded == before[1].content
    assert topic.first.replayed == after[1].content


def test_a_lost_message_is_missing_and_the_others_stay_paired() -> None:
    both = [sample(CURSOR, at, x=float(at)) for at in range(0, 200, 20)]
    topic = one(both, both[:3] + both[4:])
    assert (topic.differ, topic.only_recorded, topic.only_replayed) == (0, 1, 0)
    topic = one(both[:3] + both[4:], both)
    assert (topic.differ, topic.only_recorded, topic.only_replayed) == (0, 0, 1)


def test_a_message_with_another_stamp_is_paired_by_its_time() -> None:
    topic = one([sample(CURSOR, 0, x=1.0)], [sample(CURSOR, 3, x=1.0)])
    assert topic.is_same
    assert topic.shift_s == 0.003
    exact = one([sample(CURSOR, 0, x=1.0)], [sample(CURSOR, 3, x=1.0)], time_tolerance_s=0.0)
    assert exact.differ == 1
    far = one([sample(CURSOR, 0, x=1.0)], [sample(CURSOR, 900, x=1.0)])
    assert (far.only_recorded, far.only_replayed) == (1, 1)


def test_memory_is_bounded_when_only_one_side_writes() -> None:
    comparison = Comparison()
    for at in range(0, 100_000, 20):
        comparison.add("replayed", sample(RAY, at, x=1.0))
    assert sum(len(each) for each in comparison._topics[RAY].waiting.values()) < 200


@pytest.mark.parametrize(
    ("before", "after", "leaf"),
    [
        ({"a": {"b": [1.0, 2.0]}}, {"a": {"b": [1.0, 2.5]}}, Leaf("a.b", 0.5)),
        ({"until_ns": 2_000_000_000}, {"until_ns": 500_000_000}, Leaf("until_ns", 1.5)),
        ({"rgb": b"\x00\x05"}, {"rgb": b"\x00\xff"}, Leaf("rgb", 250.0, is_exact=True)),
        ({"name": "a"}, {"name": "b"}, Leaf("name", None)),
        ({"seen": True}, {"seen": False}, Leaf("seen", None)),
        ({"items": [1]}, {"items": [1, 2]}, Leaf("items", None)),
        ({"x": None}, {"x": 1.0}, Leaf("x", None)),
    ],
)
def test_differences_name_field_and_size(before: dict[str, Any], after: dict[str, Any], leaf: Leaf) -> None:
    assert differences(before, after) == [leaf]
    assert differences(before, before) == []


def test_the_first_that_differs_shows_only_the_strips_that_do_and_their_pixel() -> None:
    def frame(red: int) -> Sample:
        strips = [{"id": "1", "rgb": bytes(6)}, {"id": "2", "rgb": bytes([0, 0, 0, red, 20, 30])}]
        return sample("strips/frame", 0, strips=strips)

    _, recorded, replayed = first_lines(report([frame(10)], [frame(11)]), 0)
    assert recorded == '- recorded: {stamp_ns: 0, strips: [{id: "2", rgb: {pixel: 1, rgb: [10, 20, 30]}}]}'
    assert replayed == recorded.replace("recorded", "replayed").replace("10", "11")
