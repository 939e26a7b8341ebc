"""Floods by one token, during which the other one works as before."""

import asyncio
import json

import httpx
import pytest

from pointit.assistants.audit_file import read_audit
from pointit.assistants.server import MAX_SESSIONS
from pointit.assistants.tools import MAX_CALLS
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas import Cursor, FindReferents, Referents, topics
from tests.integration.assistants.served import HEADERS, HELLO, OPERATOR, SITE, VIEWER, client_of, served
from tests.support.bench import until

FLOOD = 200
VIEWERS = {**HEADERS, "Authorization": f"Bearer {VIEWER}"}
MALFORMED = {
    "no JSON": b"{",
    "nothing": b"",
    "no UTF-8": b"\xff\xfe\x00",
    "a number": b"1",
    "a list": b"[]",
    "a batch": json.dumps([HELLO]).encode(),
    "no version": json.dumps({"id": 1, "method": "initialize"}).encode(),
    "no parameters": json.dumps({"jsonrpc": "2.0", "id": 1, "method": "initialize"}).encode(),
    "wrong parameters": json.dumps({**HELLO, "params": {"protocolVersion": 7}}).encode(),
    "a notification": json.dumps({"jsonrpc": "2.0", "method": "initialize"}).encode(),
    "another method": json.dumps({"jsonrpc": "2.0", "id": 1, "method": "tools/list"}).encode(),
    "a deep one": b"[" * 20_000,
}
"""Requests without a session that begin none."""


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_operator_works_while_a_viewer_opens_sessions_without_end(mode: str) -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=VIEWERS) as http:
        answers = [(await http.post(url, json=HELLO)).status_code for _ in range(2 * MAX_SESSIONS)]
        assert answers == [200] * MAX_SESSIONS + [503] * MAX_SESSIONS
        for _ in range(3):
            async with client_of(url, OPERATOR, mode) as client:
                assert not (await client.call_tool("stop_robot", {"robot": "rover"})).is_error


@pytest.mark.parametrize("body", MALFORMED.values(), ids=MALFORMED.keys())
async def test_malformed_requests_occupy_no_session(body: bytes) -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=VIEWERS) as http:
        for _ in range(2 * MAX_SESSIONS):
            await http.post(url, content=body)
        async with client_of(url, VIEWER, "legacy") as client:
            assert not (await client.call_tool("who_is_here", {})).is_error


class Pointing:
    """A person who points, and a listener that takes its time."""

    def __init__(self, bus: MemoryBus) -> None:
        self._cursors = bus.publisher(topics.CURSOR, "anna")
        self.asked = 0
        self.running = 0
        self.max_running = 0

    async def find(self, _query: FindReferents, _user: str) -> Referents:
        self.asked += 1
        self.running += 1
        self.max_running = max(self.max_running, self.running)
        await asyncio.sleep(0.01)
        self.running -= 1
        return Referents()

    async def move(self) -> None:
        for stamp_ns in range(10**12, 2 * 10**12, 20_000_000):
            self._cursors.put(Cursor(stamp_ns=stamp_ns))
            await asyncio.sleep(0.02)


async def test_calls_beyond_the_limit_are_refused_and_others_go_on() -> None:
    async with served(find=False) as (url, bus), client_of(url, OPERATOR) as client:
        pointing = Pointing(bus)
        bus.serve(topics.FIND_REFERENTS, pointing.find)
        moving = asyncio.create_task(pointing.move())
        wait = {"user": "anna", "timeout": 100}
        calls = [asyncio.create_task(client.call_tool("wait_for_pointing", wait)) for _ in range(FLOOD)]
        await until(lambda: sum(each.done() for each in calls) == FLOOD - MAX_CALLS)
        refused = [each.result() for each in calls if each.done()]
        assert all(f"{MAX_CALLS} calls of wait_for_pointing run, the limit" in str(each) for each in refused)
        assert not (await client.call_tool("stop_robot", {"robot": "rover"})).is_error
        assert 0 < pointing.max_running <= MAX_CALLS
        for call in calls:
            call.cancel()
        await asyncio.wait(calls)
        await until(lambda: sum(each.get("outcome") == "cancelled" for each in read_audit(SITE)) == MAX_CALLS)
        assert not (await client.call_tool("wait_for_pointing", {**wait, "timeout": 0.1})).is_error
        moving.cancel()
