"""Streamable HTTP: the genuine client, tokens, rights of identities, and floods."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import httpx
import pytest
from mcp import Client

import pointit
from pointit.access.site_folder import SiteFolder
from pointit.api.site import Site
from pointit.assistants.audit_file import FOLDER, AuditFile, read_audit
from pointit.assistants.http_server import MAX_BODY, MAX_SESSIONS, HttpServer
from pointit.assistants.server import make_server
from pointit.assistants.site_connection import SiteConnection
from pointit.assistants.tools import MAX_CALLS, Tools
from pointit.bridges.web.server.access import Access
from pointit.errors import ConfigError, ConnectError
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Done, Environment, FindReferents, Lamp, Query, Referents, topics
from tests.integration.access.secured import link_of, make_site, routed
from tests.integration.assistants import served as site_server
from tests.integration.assistants.served import HEADERS, HELLO, OPERATOR, SITE, VIEWER, client_of, served
from tests.support.bench import until


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_client_has_the_rights_of_its_token(mode: str) -> None:
    async with served() as (url, _bus):
        async with client_of(url, OPERATOR, mode) as client:
            assert len((await client.list_tools()).tools) == 9
            people = await client.call_tool("who_is_here", {})
            assert '"name": "anna"' in str(people.content)
        async with client_of(url, VIEWER, mode) as client:
            assert not (await client.call_tool("stop_robot", {"robot": "rover"})).is_error
            refused = await client.call_tool("say", {"text": "hello"})
            assert refused.is_error
            assert "say needs the operator" in str(refused.content)
        calls = [(each["role"], each["tool"]) for each in read_audit(SITE) if "tool" in each]
        assert calls == [("operator", "who_is_here"), ("viewer", "stop_robot"), ("viewer", "say")]


async def test_operator_token_only_looks_when_the_server_only_looks() -> None:
    async with served("viewer") as (url, _bus), client_of(url, OPERATOR) as client:
        assert (await client.call_tool("say", {"text": "hello"})).is_error
        assert not (await client.call_tool("who_is_here", {})).is_error


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_cancelled_call_ends_on_the_server(mode: str) -> None:
    async with served() as (url, bus), client_of(url, OPERATOR, mode) as client:
        bus.publisher(topics.CURSOR, "anna").put(Cursor(stamp_ns=1))
        call = asyncio.create_task(client.call_tool("wait_for_pointing", {"user": "anna", "timeout": 100}))
        await until(lambda: any("tool" in each for each in records()))
        call.cancel()
        await asyncio.wait({call})
        await until(lambda: [each["outcome"] for each in records() if "outcome" in each] == ["cancelled"])


def records() -> list[dict[str, object]]:
    try:
        return list(read_audit(SITE))
    except ConfigError:
        return []


async def test_request_needs_a_token_and_a_host_of_this_machine() -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=HEADERS) as http:
        for token, more, status in (
            ("nothing", {"Authorization": "Basic eDp5"}, 401),
            ("wrong", {}, 401),
            (VIEWER[:-1], {}, 401),
            (OPERATOR, {"Host": "evil.example"}, 403),
            (OPERATOR, {"Origin": "https://evil.example"}, 403),
            (OPERATOR, {}, 200),
        ):
            headers = {"Authorization": f"Bearer {token}", **more}
            response = await http.post(url, json=HELLO, headers=headers)
            assert response.status_code == status, (token, more)
        assert (await http.post(url, json=HELLO)).headers["www-authenticate"] == "Bearer"


async def test_session_belongs_to_the_token_that_began_it() -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=HEADERS) as http:
        begun = await http.post(url, json=HELLO, headers={"Authorization": f"Bearer {OPERATOR}"})
        session = {"mcp-session-id": begun.headers["mcp-session-id"]}
        listing = {"jsonrpc": "2.0", "id": 2, "method": "tools/list"}
        stolen = await http.post(url, json=listing, headers={"Authorization": f"Bearer {VIEWER}", **session})
        assert stolen.status_code == 404


async def test_large_request_is_refused() -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=HEADERS) as http:
        bearer = {"Authorization": f"Bearer {OPERATOR}"}
        response = await http.post(url, content=b" " * (MAX_BODY + 1), headers=bearer)
        assert response.status_code == 413


async def test_server_is_closed_to_other_machines() -> None:
    bus = MemoryBus()
    door = SiteConnection(lambda: Site.on(bus, WallClock()), "site shop")
    server = make_server(Tools(door, AuditFile(site_folder(SITE, FOLDER)), "viewer"))
    with pytest.raises(ConfigError, match="SSH tunnel"):
        HttpServer(server, Access(OPERATOR, VIEWER), "0.0.0.0", 0)  # noqa: S104 - refused
    await bus.close()


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
async def test_operator_works_while_a_viewer_opens_endless_sessions(mode: str) -> None:
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


MAP = Environment(stamp_ns=1, name="lab", lamps=(Lamp(id="desk", position_m=(1.0, 0.0, 1.0)),))


async def done(_query: Query, _name: str) -> Done:
    return Done(message="done")


@contextlib.asynccontextmanager
async def services(folder: SiteFolder) -> AsyncGenerator[None]:
    """Play the services of a site where two people are."""
    bus = await ZenohBus.open(link_of(folder, "supervisor"))
    try:
        for user in ("anna", "ben"):
            bus.announce(topics.USER_ALIVE, user)
        room = bus.publisher(topics.MAP)
        room.put(MAP)
        bus.serve(topics.FIND_REFERENTS, site_server.found)
        bus.serve(topics.SET_LAMP, done)
        bus.serve(topics.SAY, done)
        bus.serve(topics.STOP_ROBOT, done)
        yield
    finally:
        await bus.close()


async def allowed(folder: SiteFolder, name: str) -> dict[str, bool]:
    """Return the answers to an assistant of the identity `name`."""
    asked: dict[str, tuple[str, dict[str, Any]]] = {
        "own": ("what_is_pointed_at", {"user": "anna"}),
        "another's": ("what_is_pointed_at", {"user": "ben"}),
        "say to another": ("say", {"text": "hello", "user": "ben"}),
        "light": ("light", {"thing": "desk", "colour": "red"}),
        "stop": ("stop_robot", {"robot": "rover"}),
    }
    identity = folder.identity_folder(name)
    door = SiteConnection(lambda: pointit.connect(credentials=identity, timeout_s=None), "site lab")
    tools = Tools(door, AuditFile(site_folder("lab", FOLDER)), "operator")

    def is_joined() -> bool:
        with contextlib.suppress(ConnectError):
            return door.site.latest.map.get("") is not None
        return False

    async with door.opened(), Client(make_server(tools)) as client:
        await until(is_joined)
        results = {what: await client.call_tool(tool, arguments) for what, (tool, arguments) in asked.items()}
    for result in results.values():
        assert not result.is_error or "may not" in str(result.content), result.content
    return {what: not result.is_error for what, result in results.items()}


@pytest.mark.slow
async def test_tool_has_the_rights_of_the_joined_identity(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab")
    with routed(folder):
        async with services(folder):
            everything = dict.fromkeys(("own", "another's", "say to another", "light", "stop"), True)
            assert await allowed(folder, "operator") == everything
            nothing = dict.fromkeys(everything, False)
            assert await allowed(folder, "anna") == {**nothing, "own": True, "stop": True}
            assert await allowed(folder, "dashboard1") == {**nothing, "stop": True}
