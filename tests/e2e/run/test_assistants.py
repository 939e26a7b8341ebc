"""The genuine client, over stdio, moves a simulated rover to where a simulated person points."""

import asyncio
import math
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import httpx2
import pytest
from mcp import Client, StdioServerParameters
from mcp.client.streamable_http import streamable_http_client

from pointit.assistants.audit_file import read_audit
from pointit.launch.page import stored_tokens
from tests.support.buses import free_port
from tests.support.commands import Commands
from tests.support.pace import Patience

PATIENCE_S = 60.0
LOOK_S = 0.2
NEAR_M = 0.3
START_M = (4.5, 3.5)
HALL = """
about: a person who points at places on the floor, and a rover
places: [{position_m: [2.0, 0.5, 0.0], yaw_deg: 20.0}]
site:
  pui: {map: lab, workspace: horizontal}
  robot.rover: {kind: ground, start_m: [4.5, 3.5, 0.0], radius_m: 0.25, max_speed_mps: 1.0}
  keeper: {}
user:
  pointing: {}
  localizer: {}
  supervisor: {press_while_pointing: confirms}
  goal: {steer: robots, aim_sigma_deg: 1.0}
  listener: {}
  user-sim: {think_s: 0.0, behaviour: send}
"""


async def until_true(look: Callable[[], Awaitable[Any]], what: Callable[[], str]) -> Any:
    """Return the first result of `look` that is true. Fails, saying `what`, if none is in time."""
    patience = Patience(PATIENCE_S)
    while not (found := await look()):
        assert not patience.is_over(), what()
        await asyncio.sleep(LOOK_S)
    return found


async def called(client: Client, tool: str, **arguments: Any) -> tuple[dict[str, Any], str]:
    """Return the result of a tool, and why there is none, or `""`."""
    result = await client.call_tool(tool, arguments)
    if result.is_error:
        return {}, getattr(result.content[0], "text", "")
    return cast("dict[str, Any]", result.structured_content), ""


def is_far(candidate: dict[str, Any]) -> bool:
    """Return True if it is a place to which the rover has to drive."""
    return candidate["kind"] == "place" and math.dist(candidate["position_m"][:2], START_M) > 1.0


@pytest.mark.long
@pytest.mark.slow
async def test_assistant_sends_a_rover_and_finds_a_lost_site_again(
    commands: Commands, endpoint: str, tmp_path: Path
) -> None:
    hall = tmp_path / "hall.yaml"
    hall.write_text(HALL)
    run = ("run", str(hall), "--no-view", "--seed", "1", "--listen", endpoint)
    server = StdioServerParameters(
        command=sys.executable,
        args=["-m", "pointit", "mcp", "--connect", endpoint],
        env={**os.environ, "NO_COLOR": "1"},
    )
    async with Client(server) as client:
        _, why = await called(client, "who_is_here")
        assert "does not answer" in why
        site = commands.start(*run)

        async def is_pointing() -> bool:
            found, _ = await called(client, "who_is_here")
            return any(each["state"] == "pointing" for each in found.get("people", ()))

        await until_true(is_pointing, lambda: "somebody points")
        refusals: list[str] = []

        async def send() -> Any:
            found, why = await called(client, "what_is_pointed_at", user="user1", word="there")
            for place in (each["position_m"] for each in found.get("candidates", ()) if is_far(each)):
                _, why = await called(client, "send_robot", robot="rover", user="user1", place=place)
                if not why:
                    return place
            refusals.append(f"{why} {found}")
            return None

        place = await until_true(send, lambda: f"a place that the rover accepts: {set(refusals)}")

        async def is_there() -> bool:
            found, _ = await called(client, "things")
            (at_m,) = (each["position_m"] for each in found["items"] if each["name"] == "rover")
            return math.dist(at_m[:2], place[:2]) < NEAR_M

        await until_true(is_there, lambda: f"the rover at {place}")
        await site.stop()

        async def is_lost() -> bool:
            return "refused" in (await called(client, "who_is_here"))[1]

        await until_true(is_lost, lambda: "that the site is lost")
        commands.start(*run)
        await until_true(is_pointing, lambda: "the site is back")
    outcomes = {each["outcome"] for each in read_audit("lab") if "outcome" in each}
    assert outcomes == {"done", "refused"}


async def test_http_server_accepts_page_tokens_and_ends_with_ctrl_c(commands: Commands) -> None:
    nowhere = f"tcp/127.0.0.1:{free_port()}"
    server = commands.start("mcp", "--listen", "127.0.0.1:0", "--connect", nowhere)
    await server.says("tokens in ")
    address, _, _ = server.out.partition(": tokens in ")
    tokens, _ = stored_tokens("lab")
    headers = {"Authorization": f"Bearer {tokens.viewer}"}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=PATIENCE_S) as http,
        Client(streamable_http_client(address, http_client=http)) as client,
    ):
        _, why = await called(client, "who_is_here")
        assert f"site lab at {nowhere} does not answer" in why
    new, _ = stored_tokens("lab", renew=True)  # as a page does by --new-link
    async with httpx2.AsyncClient(timeout=PATIENCE_S) as http:
        statuses = [
            (await http.post(address, headers={"Authorization": f"Bearer {token}"})).status_code
            for token in (tokens.viewer, new.viewer)
        ]

    assert statuses[0] == 401
    assert statuses[1] != 401
    ended = await server.stop(code=0)
    assert tokens.operator not in ended.out + ended.err


async def test_a_stopped_assistant_ends_it(commands: Commands, endpoint: str) -> None:
    """Its standard input is at its end from the start, as if the assistant had gone."""
    ended = await commands.pointit("mcp", "--connect", endpoint, code=0)
    assert ended.out == ""
