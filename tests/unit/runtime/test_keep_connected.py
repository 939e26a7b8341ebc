"""A loop that connects again and again goes on after its TaskGroup has failed, and ends when cancelled."""

import asyncio
from contextlib import suppress

import pytest

from pointit.runtime.mqtt.broker import keep_connected


class Serving:
    def __init__(self) -> None:
        self.lost = asyncio.Event()
        self.times = 0
        self.told = list[str]()

    async def run(self) -> None:
        await keep_connected(self._serve, self.told.append, has_user=False, retry_s=0.1)

    async def _serve(self) -> None:
        self.times += 1
        with suppress(TimeoutError):
            async with asyncio.timeout(0.1):  # ends the task where it counts as cancelled (3.11.2)
                await asyncio.Event().wait()
        async with asyncio.TaskGroup() as group:
            group.create_task(self._lose())
            group.create_task(asyncio.sleep(100.0))

    async def _lose(self) -> None:
        await self.lost.wait()
        self.lost.clear()
        raise OSError("the broker is gone")


async def test_it_goes_on_after_each_loss() -> None:
    serving = Serving()
    running = asyncio.create_task(serving.run())
    for _ in range(3):
        await asyncio.sleep(1.0)
        serving.lost.set()
    await asyncio.sleep(1.0)
    assert serving.times == 4
    assert (
        serving.told
        == ["the broker cannot be reached (the broker is gone): start it, or correct its address"] * 3
    )
    running.cancel()
    await asyncio.wait({running})


@pytest.mark.parametrize("rounds", range(6))
async def test_a_cancellation_is_not_lost_while_the_group_fails(rounds: int) -> None:
    serving = Serving()
    running = asyncio.create_task(serving.run())
    await asyncio.sleep(1.0)
    serving.lost.set()
    for _ in range(rounds):
        await asyncio.sleep(0)
    running.cancel()
    await asyncio.wait({running}, timeout=0.05)
    assert running.cancelled()
