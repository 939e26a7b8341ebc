"""A running site with its page, and an operator who sends requests as the page does."""

import itertools
import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit, urlunsplit

import httpx
from websockets.asyncio.client import ClientConnection, connect

from pointit.runtime.config.environment_variables import LOG_FORMAT
from tests.support.buses import free_port
from tests.support.commands import Command, Commands
from tests.support.links import link_in

VIEWER_TOKEN = "who-only-looks-on"  # noqa: S105 - of runs of tests only
DURATION_S = 900
"""Duration of a site, longer than all tests of a file take on a busy machine, s."""
SELDOM = {
    "POINTIT_USER_SIM__RATE_HZ": "25",
    "POINTIT_LED_DRIVER__MAX_RATE_HZ": "20",
    "POINTIT_WEB__RATE_HZ": "20",
    LOG_FORMAT: "json",  # the link is read from the log
}
"""Still more than the page draws here (`FRAME_MS`): a site's work goes by its rates."""


@dataclass(frozen=True)
class SitePage:
    command: Command
    endpoint: str
    """Endpoint of its bus."""
    url: str
    """URL of the page on this machine, with the operator's token."""

    @property
    def origin(self) -> str:
        parts = urlsplit(self.url)
        return urlunsplit((parts.scheme, parts.netloc, "", "", ""))

    @property
    def viewer_url(self) -> str:
        return f"{self.origin}/?token={VIEWER_TOKEN}"

    @asynccontextmanager
    async def operator(self, url: str = "") -> AsyncGenerator["Operator"]:
        async with httpx.AsyncClient() as client:
            answer = await client.get(url or self.url)
            assert answer.is_redirect or answer.is_success, answer.text
        cookie = answer.headers["set-cookie"].partition(";")[0]
        socket = f"{self.origin.replace('http', 'ws', 1)}/ws"
        async with connect(socket, origin=self.origin, additional_headers={"Cookie": cookie}) as connection:  # pyrefly: ignore[bad-argument-type]  # a NewType of str
            yield Operator(connection)


class Operator:
    """Sends the requests of the page's panel."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._ids = itertools.count(1)

    async def say(self, **part: Any) -> None:
        """Send a message that is not answered, such as a headset's motion."""
        await self._connection.send(json.dumps(part))

    async def ask(self, **wish: Any) -> dict[str, Any]:
        part = await self._answer(wish)
        assert not part["error"], part["error"]
        return dict(part["reply"])

    async def _answer(self, wish: dict[str, Any]) -> dict[str, Any]:
        number = next(self._ids)
        await self._connection.send(json.dumps({"kind": "ask", "id": number, **wish}))
        while True:
            message = await self._connection.recv()
            if isinstance(message, bytes):
                continue
            part: dict[str, Any] = json.loads(message)
            if part["kind"] == "answer" and part["id"] == number:
                return part

    async def pair(self, user: str) -> str:
        """Return the address that a QR code has for the phone of `user`, by HTTPS."""
        return str((await self.ask(deed="pair", name=user))["url"])


async def running(
    commands: Commands, *arguments: str, state: Path | None = None, ends_unseen: bool = False
) -> SitePage:
    """Start `pointit run` with its page.

    Args:
        commands: start it.
        arguments: of `pointit run`.
        state: folder of the site's state, by default that of the test.
        ends_unseen: keep the scenario's own end, which a page puts off. On a busy machine a page may open, or
            tell that it is there, later than that: other tests get an end that is later than theirs.
    """
    if not ends_unseen and "--duration" not in arguments:
        arguments = (*arguments, "--duration", str(DURATION_S))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    port = () if "--web-port" in arguments else ("--web-port", "0")
    command = commands.start(
        *("run", *arguments, *port, "--no-view", "--no-browser", "--listen", endpoint),
        *("--set", f"web.viewer_token={VIEWER_TOKEN}"),
        environment=SELDOM if state is None else SELDOM | {"POINTIT_STATE": str(state)},
    )
    await command.says("its link is in")
    return SitePage(command=command, endpoint=endpoint, url=link_in("\n".join(command.logged())))
