"""Access, headers and files of the server: real requests to a real port."""

import asyncio

import httpx
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.server import access
from pointit.bridges.web.service import Web
from pointit.runtime.errors import ConfigError, ListenError
from tests.integration.web.pages import INDEX, OPERATOR, VIEWER, Server, serve, serving
from tests.support.bench import Bench, memory_bench
from tests.support.links import link_in

CLIENTS = ("httpx", "httpcore", "websockets.client")
"""Loggers of the tests' own side."""


async def refused(server: Server, path: str = "/ws", **headers: str) -> int:
    with pytest.raises(InvalidStatus) as refusal:
        async with connect(f"ws://{server.host}{path}", additional_headers=headers):
            pass
    response = refusal.value.response
    assert "default-src 'none'" in response.headers["content-security-policy"]
    return response.status_code


async def test_link_admits_and_its_token_vanishes(client: httpx.AsyncClient) -> None:
    link = await client.get("/", params={"token": OPERATOR})
    assert link.status_code == 303
    assert link.headers["location"] == "/"
    assert link.headers["cache-control"] == "no-store"
    cookie = link.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert OPERATOR not in cookie
    page = await client.get("/")
    assert page.text == INDEX


async def test_page_without_the_token_says_where_its_link_is(client: httpx.AsyncClient) -> None:
    for query in ({}, {"token": ""}, {"token": "wrong"}):
        answer = await client.get("/", params=query)
        assert answer.status_code == 403
        assert "Open the link that PointIt printed" in answer.text
        assert "set-cookie" not in answer.headers


async def test_link_on_another_site_leads_on_without_a_redirection(server: Server) -> None:
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "document"}
    async with server.client(**headers) as client:
        link = await client.get("/", params={"token": OPERATOR})
        assert link.status_code == 200
        assert 'content="0;url=/"' in link.text
        assert "set-cookie" in link.headers


async def test_every_response_has_the_security_headers(server: Server, client: httpx.AsyncClient) -> None:
    wanted = access.headers(access.RequestInfo(scheme="http", host=server.host, address=""))
    for path in ("/", f"/?token={OPERATOR}", "/static/app.js", "/phone", "/no", "/recording.mcap"):
        headers = (await client.get(path)).headers
        assert {name: headers[name] for name in wanted} == wanted, path
        assert "server" not in headers, path


async def test_foreign_host_name_is_refused(server: Server) -> None:
    async with server.client(Host="evil.example") as client:
        for path in ("/", "/static/app.js", f"/?token={OPERATOR}"):
            answer = await client.get(path)
            assert answer.status_code == 403
            assert "set-cookie" not in answer.headers


async def test_websocket_needs_cookie_and_own_origin(server: Server) -> None:
    cookie = await server.cookie()
    assert await refused(server, Cookie=cookie, Origin="https://evil.example") == 403
    assert await refused(server, Cookie=cookie, Origin="http://127.0.0.1:1") == 403
    assert await refused(server, Cookie=cookie) == 403
    assert await refused(server, Origin=server.url) == 403
    assert await refused(server, Cookie=cookie[:-4] + "0000", Origin=server.url) == 403
    assert await refused(server, f"/ws?token={OPERATOR}", Origin=server.url) == 403
    async with server.page():
        pass


async def test_post_is_refused_when_long_or_from_elsewhere(server: Server, client: httpx.AsyncClient) -> None:
    for headers in ({}, {"Origin": "https://evil.example"}, {"Origin": "null"}):
        answer = await client.post("/wrist", content="[]", headers=headers)
        assert answer.status_code == 403
        assert "only a page of this server" in answer.text
    answer = await client.post("/wrist", content=b"x" * 1_000_000, headers={"Origin": server.url})
    assert answer.status_code == 413


async def test_files_are_sent_once_and_compressed(client: httpx.AsyncClient) -> None:
    script = await client.get("/static/app.js")
    assert script.text == "export {};"
    assert script.headers["content-type"] == "text/javascript; charset=utf-8"
    assert script.headers["cache-control"] == "no-cache"
    again = await client.get("/static/app.js", headers={"If-None-Match": script.headers["etag"]})
    assert again.status_code == 304
    assert again.content == b""
    index = await client.get("/static/index.html", headers={"Accept-Encoding": "gzip"})
    assert index.headers["content-encoding"] == "gzip"
    assert index.text == INDEX
    plain = await client.get("/static/index.html", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.text == INDEX


async def test_files_outside_the_bundle_are_not_served(server: Server) -> None:
    for file in ("../secret.txt", "%2e%2e/secret.txt", "link.txt", "/etc/passwd", "%00"):
        reader, writer = await asyncio.open_connection(*server.host.split(":"))
        request = f"GET /static/{file} HTTP/1.1\r\nHost: {server.host}\r\nConnection: close\r\n\r\n"
        writer.write(request.encode())
        async with asyncio.timeout(60.0):
            answer = await reader.read()
        writer.close()
        await writer.wait_closed()
        assert answer.startswith(b"HTTP/1.1 404"), file
        assert b"secret" not in answer.replace(file.encode(), b"")


async def test_taken_port_is_reported_in_a_sentence(bench: Bench, server: Server) -> None:
    port = int(server.host.rpartition(":")[2])
    with pytest.raises(ListenError, match=rf"port {port} of 127\.0\.0\.1 .*--port"):
        async with asyncio.timeout(60.0):
            await serve(bench, port)


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"host": "0.0.0.0"}, "lan"),  # noqa: S104 - refused
        ({"host": "192.168.1.7"}, "lan"),
        ({"host": "example.org"}, "lan"),
        ({"operator_token": "short"}, "at least 8"),
        ({"operator_token": "the same token", "viewer_token": "the same token"}, "viewer_token"),
    ],
)
def test_unsafe_configuration_is_refused(parameters: dict[str, str], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        Web.validate_config(WebConfig.model_validate(parameters))


def test_only_a_container_may_listen_at_all_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    published = WebConfig(host="0.0.0.0", published_port=8091)  # noqa: S104 - its engine's affair
    monkeypatch.setattr(access, "CONTAINER_MARKS", ())
    monkeypatch.delenv(access.CONTAINER, raising=False)
    with pytest.raises(ConfigError, match="published_port in a container"):
        Web.validate_config(published)
    monkeypatch.setenv(access.CONTAINER, "oci")
    Web.validate_config(published)
    with pytest.raises(ConfigError, match="lan: true"):
        Web.validate_config(published.model_copy(update={"published_port": 0}))


async def test_published_page_opens_at_its_announced_address(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    monkeypatch.setenv(access.CONTAINER, "oci")
    everywhere = {"host": "0.0.0.0", "published_port": 4321, "operator_token": ""}  # noqa: S104 - as above
    async with memory_bench() as bench, serving(bench, **everywhere) as server, server.client() as client:
        link = link_in(caplog.text)
        told = "127.0.0.1:4321"
        assert link.startswith(f"http://{told}/?token=")

        entered = await client.get(link.partition(told)[2], headers={"Host": told})
        assert entered.status_code == 303
        headers = {"Cookie": entered.headers["set-cookie"].partition(";")[0]}
        port = int(server.host.rpartition(":")[2])
        async with connect(
            f"ws://{told}/ws",
            host="127.0.0.1",
            port=port,
            origin=Origin(f"http://{told}"),
            additional_headers=headers,
        ) as page:
            assert "hello" in str(await page.recv())

        for foreign in ("0.0.0.0", "192.168.1.5", "example.org"):  # noqa: S104 - refused
            assert (await client.get("/", headers={**headers, "Host": f"{foreign}:4321"})).status_code == 403


async def test_random_token_is_in_a_file_and_never_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("DEBUG")
    async with memory_bench() as bench:
        async with serving(bench) as server, server.page(), server.client() as client:
            await client.get("/", params={"token": "wrong and secret"})
        ours = [record for record in caplog.records if not record.name.startswith(CLIENTS)]
        logged = " ".join(record.getMessage() for record in ours)
        assert "the page is at" in logged
        for secret in (OPERATOR, VIEWER, "wrong", "secret"):
            assert secret not in logged

        caplog.clear()
        async with serving(bench, operator_token="") as server:
            link = link_in(caplog.text)
            assert link.partition("=")[2] not in caplog.text
            async with httpx.AsyncClient() as client:
                assert (await client.get(link)).status_code == 303
        with pytest.raises(FileNotFoundError):  # it ends with the page
            link_in(caplog.text)


async def test_number_of_pages_is_limited() -> None:
    async with memory_bench() as bench, serving(bench, most_viewers=1) as server:
        cookie = await server.cookie()
        async with server.page():
            assert await refused(server, Cookie=cookie, Origin=server.url) == 503
        async with server.page():
            pass
