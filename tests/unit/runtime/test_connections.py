"""Connections that come and go, told by threads of Zenoh in any order."""

import asyncio
import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.connections import LinkWatch

LOST, BACK = "lost", "back"


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
