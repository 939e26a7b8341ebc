"""On a secured site an assistant may do what the identity may by which it has joined, whatever its token."""

import contextlib
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import pytest
from mcp import Client

import pointit
from pointit.access.site_folder import SiteFolder
from pointit.assistants.audit_file import FOLDER, AuditFile
from pointit.assistants.server import make_server
from pointit.assistants.site_connection import SiteConnection
from pointit.assistants.tools import Tools
from pointit.errors import ConnectError
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Done, Environment, FindReferents, Lamp, Query, Referents, topics
from tests.integration.access.secured import link_of, make_site, routed
from tests.support.bench import until

MAP = Environment(stamp_ns=1, name="lab", lamps=(Lamp(id="desk", position_m=(1.0, 0.0, 1.0)),))


async def done(_query: Query, _name: str) -> Done:
    return Done(message="done")


async def found(_query: FindReferents, _user: str) -> Referents:
    return Referents()


@contextlib.asynccontextmanager
async def services(folder: SiteFolder) -> AsyncGenerator[None]:
    """Play the services of a site where two people are."""
    bus = await ZenohBus.open(link_of(folder, "supervisor"))
    try:
        for user in ("anna", "ben"):
            bus.announce(topics.USER_ALIVE, user)
        room = bus.publisher(topics.MAP)
        room.put(MAP)
        bus.serve(topics.FIND_REFERENTS, found)
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
async def test_a_tool_has_the_rights_of_the_identity_that_joined(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab")
    with routed(folder):
        async with services(folder):
            everything = dict.fromkeys(("own", "another's", "say to another", "light", "stop"), True)
            assert await allowed(folder, "operator") == everything
            nothing = dict.fromkeys(everything, False)
            assert await allowed(folder, "anna") == {**nothing, "own": True, "stop": True}
            assert await allowed(folder, "dashboard1") == {**nothing, "stop": True}
