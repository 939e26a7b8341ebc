"""Two publishers of one frame, at rates of their own, and frames that only move."""

import math
from collections.abc import Iterable

import pytest

from pointit.bridges.ros2.rival_publishers import RivalPublishers

Step = tuple[str, float, float]
"""Parent and position of a transform, m."""


def sentences(steps: Iterable[Step]) -> list[str]:
    rivals = RivalPublishers()
    return [rivals.describe("base_link", parent, (x, y, 0.0)) for parent, x, y in steps]


def of_two(first: Step, second: Step, ratio: int, count: int) -> list[Step]:
    """Return transforms of two publishers, of which the first sends `ratio` for each of the second."""
    return [second if number % (ratio + 1) == ratio else first for number in range(count)]


@pytest.mark.parametrize("ratio", [1, 3, 10])
@pytest.mark.parametrize(
    ("first", "second"),
    [(("map", 0.0, 0.0), ("odom", 0.0, 0.0)), (("map", 0.0, 0.0), ("map", 2.0, 0.5))],
    ids=["two parents", "two places"],
)
def test_frame_that_two_nodes_publish_is_named(first: Step, second: Step, ratio: int) -> None:
    *_, last = sentences(of_two(first, second, ratio, 12 * (ratio + 1)))
    assert last.startswith("two nodes publish the frame 'base_link' (in 'map'")
    assert "end one of them" in last


def test_fast_or_handed_over_frame_has_one_publisher() -> None:
    circle = [("map", 3.0 * math.cos(0.05 * step), 3.0 * math.sin(0.05 * step)) for step in range(500)]
    handed_over = [*circle, *(("gripper", 0.1, 0.0) for _ in range(50)), *circle]
    shuttle = [("map", abs(5.0 - 0.25 * (step % 40)), 0.0) for step in range(400)]
    assert not any(sentences(handed_over))
    assert not any(sentences(shuttle))


def test_sentence_ends_with_the_second_publisher() -> None:
    one = ("map", 0.0, 0.0)
    two = [*of_two(one, ("odom", 0.0, 0.0), 1, 40), *([one] * 200)]
    assert sentences(two)[39]
    assert not sentences(two)[-1]
