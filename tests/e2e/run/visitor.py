"""A visitor who opens the page of a run: the browser's cookies and messages; a scenario to visit."""

import contextlib
import json
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Origin


def own_scenario(folder: Path, duration_s: int) -> str:
    """Write a scenario whose person points at strips. Return its path."""
    path = folder / "mine.yaml"
    path.write_text(
        f"about: mine\nduration_s: {duration_s}\nplaces: [{{position_m: [2.0, 0.5, 0.0], yaw_deg: 20.0}}]\n"
        "site: {pui: {map: lab, surfaces: [strip]}, led-driver: {}}\n"
        "user: {pointing: {}, localizer: {}, supervisor: {}, user-sim: {think_s: 0.1, behaviour: strips}}\n"
    )
    return f"{path}"


async def entered(url: str) -> tuple[str, httpx.Response]:
    """Return the cookie that the address gives, and the page behind it, as soon as it answers."""
    async with httpx.AsyncClient(
        follow_redirects=True, transport=httpx.AsyncHTTPTransport(retries=20)
    ) as client:
        response = await client.get(url)
        return "; ".join(f"{name}={value}" for name, value in client.cookies.items()), response


@contextlib.asynccontextmanager
async def looking_on(url: str) -> AsyncGenerator[tuple[ClientConnection, dict[str, Any]]]:
    """Hold the page open, as a browser does. Yield the first message, too."""
    cookie, _ = await entered(url)
    origin = url.partition("/?")[0]
    where = origin.replace("http", "ws", 1) + "/ws"
    async with connect(where, additional_headers={"Cookie": cookie}, origin=Origin(origin)) as socket:
        yield socket, json.loads(await socket.recv())
