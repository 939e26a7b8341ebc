"""Incoming requests are bounded, and handled a slice of time per turn."""

import asyncio
import threading
import time
from collections.abc import Iterator

import pytest

from pointit.runtime.zenoh.queries import MAX_WAITING, SHOWN_S, SLICE_S, BoundedWorkQueue, OverflowCounter
from tests.support.bench import until

pytestmark = pytest.mark.wall_time


async def test_items_beyond_the_limit_are_rejected_and_the_rest_handled_in_order() -> None:
    seen: list[int] = []
    turned_away = OverflowCounter()

    def work(item: int) -> tuple[()]:
        seen.append(item)
        return ()

    line = BoundedWorkQueue("users/*/profile", work, turned_away)
    taken: list[bool] = []
    thread = threading.Thread(
        target=lambda: taken.extend(line.offer(item) for item in range(MAX_WAITING + 3))
    )
    thread.start()
    thread.join()  # the loop is held up meanwhile
    assert taken == [True] * MAX_WAITING + [False] * 3
    sentence = turned_away.problem(time.monotonic())
    assert sentence.startswith("3 questions were turned away, the last for users/*/profile, ")
    assert turned_away.problem(time.monotonic() + SHOWN_S + 1.0) == ""
    await until(lambda: len(seen) == MAX_WAITING)
    assert seen == list(range(MAX_WAITING))
    assert line.offer(7), "there is room again"
    await until(lambda: seen[-1] == 7)


def test_a_single_rejection_is_reported_in_the_singular() -> None:
    turned_away = OverflowCounter()
    turned_away.add("users/anna/profile", 10.0)
    assert turned_away.problem(10.0).startswith(
        f"1 question was turned away, for users/anna/profile, as more than {MAX_WAITING} waited: "
    )


async def test_other_tasks_run_while_a_long_item_is_worked_on() -> None:
    turns = 0
    counts: list[int] = []

    def work(steps: int) -> Iterator[None]:
        for _ in range(steps):
            counts.append(turns)
            time.sleep(SLICE_S)
            yield

    line = BoundedWorkQueue("key", work, OverflowCounter())
    assert line.offer(20)
    while len(counts) < 20:
        await asyncio.sleep(0)
        turns += 1
    assert len(set(counts)) == 20, "a step longer than a slice is the only one of its turn"


async def test_a_failing_item_does_not_stop_the_next(caplog: pytest.LogCaptureFixture) -> None:
    seen: list[int] = []

    def work(item: int) -> Iterator[None]:
        yield
        seen.append(10 // item)

    line = BoundedWorkQueue("led/brightness", work, OverflowCounter())
    assert line.offer(0)
    assert line.offer(5)
    await until(lambda: seen == [2])
    assert "led/brightness" in caplog.text
