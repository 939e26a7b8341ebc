"""Connections to routers, and what goes on after a loss."""

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.mqtt.broker import keep_connected
from pointit.runtime.zenoh.connections import LinkWatch

LOST = "lost"
BACK = "back"


class Session:
    """Stands for a session of Zenoh: tells of its connections."""

    def __init__(self) -> None:
        self.info = self
        self._tell: Callable[[Any], Any] = lambda _event: None

    def declare_transport_events_listener(
        self, callback: Callable[[Any], Any], *, history: bool
    ) -> "Session":
        self._tell = callback
        assert history
        self.tells("+a")
        return self

    def undeclare(self) -> None:
        self._tell = lambda _event: None

    def tells(self, event: str) -> None:
        kind = zenoh.SampleKind.PUT if event[0] == "+" else zenoh.SampleKind.DELETE
        transport = SimpleNamespace(zid=event[1:], whatami=zenoh.WhatAmI.ROUTER)
        self._tell(SimpleNamespace(transport=transport, kind=kind))


@pytest.mark.parametrize(
    ("events", "told"),
    [
        ("-a", [LOST]),
        ("-a +b", [LOST, BACK]),
        ("-a +a", [LOST, BACK]),
        ("+b -a", [LOST, BACK]),
        ("+a -a", [LOST, BACK]),
        ("+b -a -b", [LOST, BACK, LOST]),
        ("+a -a -a", [LOST, BACK, LOST]),
        ("+b -a +a -b", [LOST, BACK, LOST, BACK]),
        ("-a -b +b", [LOST]),
    ],
)
async def test_a_client_notices_each_router_that_it_has_lost(
    events: str, told: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    session: Any = Session()
    backs: list[str] = []
    watch = LinkWatch(session, Link(connect=("tcp/127.0.0.1:1",)), lambda: backs.append(BACK))
    for event in events.split():
        session.tells(event)
    await asyncio.sleep(0)
    said = [LOST if "is lost" in it.message else BACK for it in caplog.records if "router at" in it.message]
    assert said == told
    assert len(backs) == told.count(BACK)
    assert watch.up == (told[-1] == BACK)
    watch.close()


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


async def test_connection_is_renewed_after_each_loss() -> None:
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
