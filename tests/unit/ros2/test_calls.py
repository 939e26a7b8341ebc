"""Requests that are not answered yet: what ends them, and that nothing is left of them."""

import asyncio
import gc
from typing import Any

import pytest

from pointit.bridges.ros2.routing.calls import Calls
from pointit.runtime.errors import BusClosedError
from tests.support.bench import until


class Server:
    """Answers when it is told to; knows whether somebody still waits."""

    def __init__(self, *, fails_late: bool = False) -> None:
        self.is_asked = False
        self.is_given_up = False
        self.may_answer = asyncio.Event()
        self._fails_late = fails_late

    async def answer(self) -> bytes:
        self.is_asked = True
        try:
            await self.may_answer.wait()
        except asyncio.CancelledError:
            self.is_given_up = True
            if self._fails_late:
                raise RuntimeError("it could not be given up") from None
            raise
        return b"yes"


async def asked(calls: Calls, server: Server) -> "asyncio.Task[bytes]":
    """Return a request that is on its way."""
    task = asyncio.create_task(calls.answered(server.answer(), "call it"))
    await until(lambda: server.is_asked)
    return task


async def test_what_it_returns_and_what_it_raises_is_handed_on() -> None:
    calls, server = Calls(), Server()
    server.may_answer.set()
    assert await calls.answered(server.answer(), "call it") == b"yes"

    async def late() -> bytes:
        raise TimeoutError("no node serves it")

    with pytest.raises(TimeoutError, match="no node serves it"):
        await calls.answered(late(), "call it")


async def test_who_waits_while_the_backend_is_closed_is_told() -> None:
    calls, server = Calls(), Server()
    waiting = await asked(calls, server)
    calls.close()
    with pytest.raises(BusClosedError, match="the backend was closed while it waited"):
        await waiting
    assert server.is_given_up


@pytest.mark.parametrize("fails_late", [False, True])
async def test_nothing_is_left_of_a_request_that_nobody_waits_for(fails_late: bool) -> None:  # noqa: FBT001
    said: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _loop, what: said.append(what))
    calls, server = Calls(), Server(fails_late=fails_late)
    waiting = await asked(calls, server)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    await until(lambda: server.is_given_up)
    del waiting  # whose traceback holds the request, which tells of what nobody saw when it is collected
    await asyncio.sleep(0)  # the loop holds it, too, as long as this turn goes on
    gc.collect()
    assert not said
