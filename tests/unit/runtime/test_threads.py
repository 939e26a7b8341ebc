"""Blocking calls that are not joined at the end."""

import asyncio
import threading

import pytest

from pointit.runtime.host.threads import in_daemon_thread
from tests.support.bench import until
from tests.support.invoked import python

pytestmark = pytest.mark.wall_time

PATIENCE_S = 20.0


async def test_the_result_or_error_of_the_work_is_passed_on() -> None:
    def fail() -> int:
        raise KeyError("no")

    assert await in_daemon_thread(lambda: 3, "three") == 3
    with pytest.raises(KeyError):
        await in_daemon_thread(fail, "fails")


def test_the_loop_ends_while_the_work_goes_on() -> None:
    release = threading.Event()
    dropped: list[int] = []
    is_dropped = threading.Event()

    def work() -> int:
        assert release.wait(PATIENCE_S)
        return 4

    def discard(result: int) -> None:
        dropped.append(result)
        is_dropped.set()

    async def main() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await in_daemon_thread(work, "slow", discard=discard)

    asyncio.run(main())
    release.set()  # if the loop had waited for the work, that had given up
    assert is_dropped.wait(PATIENCE_S)
    assert dropped == [4]


async def waiting(name: str) -> tuple[threading.Event, list[bool], asyncio.Task[bool]]:
    """Begin work that ends when it is released; return that event, what is discarded, and its task."""
    release = threading.Event()
    dropped: list[bool] = []
    work = in_daemon_thread(lambda: release.wait(PATIENCE_S), name, discard=dropped.append)
    task = asyncio.create_task(work)
    await asyncio.sleep(0)
    return release, dropped, task


async def test_late_result_of_a_thread_is_discarded() -> None:
    release, dropped, task = await waiting("late")
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert not dropped
    release.set()
    await until(lambda: dropped == [True])


@pytest.mark.parametrize("turns", [0, 1], ids=["before the loop knows", "before the task wakes"])
async def test_a_result_that_comes_with_the_cancelling_is_discarded(turns: int) -> None:
    release, dropped, task = await waiting("raced")
    [thread] = [each for each in threading.enumerate() if each.name == "raced"]
    release.set()
    thread.join(PATIENCE_S)  # the loop is held up: it comes to know of both at once
    for _ in range(turns):
        await asyncio.sleep(0)
    assert task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await until(lambda: dropped == [True])


async def test_an_error_raised_after_cancellation_is_discarded() -> None:
    may_fail = threading.Event()

    def fail() -> int:
        may_fail.wait(PATIENCE_S)
        raise KeyError("no")

    dropped: list[int] = []
    task = asyncio.create_task(in_daemon_thread(fail, "fails", discard=dropped.append))
    await asyncio.sleep(0)
    task.cancel()
    may_fail.set()
    for thread in threading.enumerate():
        if thread.name == "fails":
            thread.join(PATIENCE_S)
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not dropped


LEAVING = """
import asyncio, sys, threading
from pointit.runtime.host import threads
from pointit.runtime.host.threads import exit_now, has_running_threads, in_daemon_thread

threads.EXIT_TIMEOUT_S = None

async def main():
    try:
        async with asyncio.timeout(0.01):
            await in_daemon_thread(threading.Event().wait, "for ever")
    except TimeoutError:
        pass

print("said", end="")
{first}
if has_running_threads():
    exit_now(3)
sys.exit(4)
"""


def ends(program: str) -> tuple[int, str, str]:
    done = python("-c", program)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(("first", "code"), [("asyncio.run(main())", 3), ("", 4)])
def test_a_program_leaves_at_once_what_still_runs(first: str, code: int) -> None:
    assert ends(LEAVING.format(first=first)) == (code, "said", "")


WAITING = """
import asyncio, time
from pointit.runtime.host.threads import in_daemon_thread

def work():
    time.sleep(0.3)
    print("done", flush=True)

async def main():
    try:
        async with asyncio.timeout(0.01):
            await in_daemon_thread(work, "soon")
    except TimeoutError:
        pass

asyncio.run(main())
"""


def test_any_other_process_waits_for_it_at_its_exit() -> None:
    assert ends(WAITING) == (0, "done\n", "")
