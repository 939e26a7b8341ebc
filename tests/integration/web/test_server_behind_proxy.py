"""The page behind a genuine nginx: as it is by default, and with the lines of the guide."""

import re
from pathlib import Path

import httpx
import pytest
from pydantic import ValidationError
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin

from pointit.bridges.web.config import WebConfig
from tests.integration.web.pages import OPERATOR, Server, serving
from tests.support.bench import Bench, until
from tests.support.buses import is_listening
from tests.support.nginx import nginx

GUIDE = Path(__file__).parents[3] / "docs/how-to/network.md"
PUBLIC = "https://lab.example"
HOST = {"Host": "lab.example"}


def lines_of_guide(server: Server) -> str:
    """Return the lines for nginx of the guide, for the address of `server`."""
    (lines,) = re.findall(r"```text\n(location .*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    assert "127.0.0.1:8090" in lines
    return lines.replace("127.0.0.1:8090", server.host)


async def cookie_through(port: int) -> str:
    """Return the cookie that the operator's link gives through the proxy."""
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", headers=HOST, timeout=30.0) as client:
        answer = await client.get("/", params={"token": OPERATOR})
    assert answer.status_code == 303, answer.text
    return answer.headers["set-cookie"]


async def reason_through(port: int, cookie: str) -> str:
    """Return the reason that a page opened at `PUBLIC` receives when it gets no websocket."""
    headers = {**HOST, "Cookie": cookie}
    async with httpx.AsyncClient(
        base_url=f"http://127.0.0.1:{port}", headers=headers, timeout=30.0
    ) as client:
        answer = await client.get("/ws", params={"page": PUBLIC})
    assert answer.headers["content-type"].startswith("text/plain")
    return answer.text


def socket_through(port: int, cookie: str, origin: str = PUBLIC) -> connect:
    return connect(
        "ws://lab.example/ws",
        host="127.0.0.1",
        port=port,
        origin=Origin(origin),
        additional_headers={"Cookie": cookie},
        proxy=None,
    )


async def test_page_behind_default_nginx_names_the_missing_setting(server: Server, tmp_path: Path) -> None:
    with nginx(tmp_path, f"location / {{ proxy_pass {server.url}; }}") as port:
        await until(lambda: is_listening(port), what="nginx")
        cookie = (await cookie_through(port)).partition(";")[0]
        with pytest.raises(InvalidStatus):
            await socket_through(port, cookie)
        reason = await reason_through(port, cookie)
    assert f"opened at {PUBLIC}" in reason
    assert f"passes it on as {server.url}: let it pass on the Host" in reason
    assert f"--set web.public_url={PUBLIC}" in reason
    assert "docs/how-to/network.md" in reason


async def test_page_behind_a_proxy_works_with_the_documented_lines(bench: Bench, tmp_path: Path) -> None:
    async with serving(bench, public_url=f"{PUBLIC}/") as server:
        with nginx(tmp_path, lines_of_guide(server)) as port:
            await until(lambda: is_listening(port), what="nginx")
            cookie = await cookie_through(port)
            assert "; Secure" in cookie, "the browser's connection is encrypted"
            async with socket_through(port, cookie.partition(";")[0]) as socket:
                assert '"hello"' in str(await socket.recv())


async def test_proxy_that_passes_on_no_websocket_is_named(bench: Bench, tmp_path: Path) -> None:
    async with serving(bench, public_url=PUBLIC) as server:
        lines = f"location / {{ proxy_pass {server.url}; proxy_set_header Host $http_host; }}"
        with nginx(tmp_path, lines) as port:
            await until(lambda: is_listening(port), what="nginx")
            cookie = (await cookie_through(port)).partition(";")[0]
            with pytest.raises(InvalidStatus):
                await socket_through(port, cookie)
            assert "let the proxy in front of PointIt pass websockets on" in await reason_through(
                port, cookie
            )


async def test_unknown_proxy_name_leads_to_its_parameter(server: Server, tmp_path: Path) -> None:
    with nginx(tmp_path, lines_of_guide(server)) as port:
        await until(lambda: is_listening(port), what="nginx")
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", headers=HOST) as client:
            answer = await client.get("/", params={"token": OPERATOR})
    assert answer.status_code == 403
    assert "set web.public_url to its address" in answer.text


async def test_refused_visitor_learns_no_address(server: Server) -> None:
    async with server.client() as client:
        answer = await client.get("/ws", params={"page": PUBLIC})
    assert answer.status_code == 403
    assert server.host not in answer.text


async def test_other_sites_get_no_websocket_through_a_proxy(bench: Bench, tmp_path: Path) -> None:
    async with serving(bench, public_url=PUBLIC) as server:
        with nginx(tmp_path, lines_of_guide(server)) as port:
            await until(lambda: is_listening(port), what="nginx")
            cookie = (await cookie_through(port)).partition(";")[0]
            with pytest.raises(InvalidStatus):
                await socket_through(port, cookie, "https://other.example")


@pytest.mark.parametrize(
    "url",
    ["http://lab.example", "lab.example", "https://lab.example/lab", "https://a:b@lab.example", "https://[x"],
)
def test_public_url_that_serves_no_page_is_refused(url: str) -> None:
    with pytest.raises(ValidationError, match="write https:// and a host"):
        WebConfig(public_url=url)
