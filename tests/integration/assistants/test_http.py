"""Streamable HTTP: the genuine client, tokens of the page, roles, foreign names, and who is cut off."""

import asyncio

import httpx
import pytest

from pointit.api.site import Site
from pointit.assistants.audit_file import FOLDER, AuditFile, read_audit
from pointit.assistants.server import MAX_BODY, HttpServer, make_server
from pointit.assistants.site_connection import SiteConnection
from pointit.assistants.tools import Tools
from pointit.bridges.web.server.access import Access
from pointit.errors import ConfigError
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.host.state_file import site_folder
from pointit.schemas import Cursor, topics
from tests.integration.assistants.served import HEADERS, HELLO, OPERATOR, SITE, VIEWER, client_of, served
from tests.support.bench import until


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_client_lists_and_calls_with_the_rights_of_its_token(mode: str) -> None:
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


async def test_the_operators_token_only_looks_where_that_is_all_that_is_allowed() -> None:
    async with served("viewer") as (url, _bus), client_of(url, OPERATOR) as client:
        assert (await client.call_tool("say", {"text": "hello"})).is_error
        assert not (await client.call_tool("who_is_here", {})).is_error


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_cancelled_call_ends_on_the_server(mode: str) -> None:
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


async def test_only_a_token_and_a_name_of_this_machine_let_in() -> None:
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


async def test_a_session_belongs_to_the_token_that_began_it() -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=HEADERS) as http:
        begun = await http.post(url, json=HELLO, headers={"Authorization": f"Bearer {OPERATOR}"})
        session = {"mcp-session-id": begun.headers["mcp-session-id"]}
        listing = {"jsonrpc": "2.0", "id": 2, "method": "tools/list"}
        stolen = await http.post(url, json=listing, headers={"Authorization": f"Bearer {VIEWER}", **session})
        assert stolen.status_code == 404


async def test_a_large_request_is_refused() -> None:
    async with served() as (url, _bus), httpx.AsyncClient(headers=HEADERS) as http:
        bearer = {"Authorization": f"Bearer {OPERATOR}"}
        response = await http.post(url, content=b" " * (MAX_BODY + 1), headers=bearer)
        assert response.status_code == 413


async def test_no_other_machine_can_reach_it() -> None:
    bus = MemoryBus()
    door = SiteConnection(lambda: Site.on(bus, WallClock()), "site shop")
    server = make_server(Tools(door, AuditFile(site_folder(SITE, FOLDER)), "viewer"))
    with pytest.raises(ConfigError, match="SSH tunnel"):
        HttpServer(server, Access(OPERATOR, VIEWER), "0.0.0.0", 0)  # noqa: S104 - refused
    await bus.close()
