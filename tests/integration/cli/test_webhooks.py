"""Webhooks of `--on` at a real web server: what it gets, and servers that stall, refuse, or are not there."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field

import httpx
import pytest

from pointit.runtime.errors import ConfigError
from pointit.services.reactions import http_status, targets
from pointit.services.reactions.targets import Reaction, Webhook
from tests.support.acts import act_on, failure_of
from tests.support.bench import until
from tests.support.buses import free_port

STALLED = 0
"""Status of a server that does not answer."""


@dataclass
class Server:
    """A web server that answers with one status after the other, then with the last one."""

    port: int
    statuses: list[int]
    heads: list[str] = field(default_factory=list[str])
    bodies: list[str] = field(default_factory=list[str])
    served: "set[asyncio.Task[None]]" = field(default_factory=set["asyncio.Task[None]"])

    def accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.served.add(asyncio.create_task(self.answer(reader, writer)))

    async def answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.closing(writer), contextlib.suppress(asyncio.IncompleteReadError):
            head = (await reader.readuntil(b"\r\n\r\n")).decode()
            length = next(line for line in head.splitlines() if line.lower().startswith("content-length"))
            body = await reader.readexactly(int(length.split(":")[1]))
            status = self.statuses[min(len(self.bodies), len(self.statuses) - 1)]
            self.heads.append(head)
            self.bodies.append(body.decode())
            if status == STALLED:
                await reader.read()  # until the other side goes
            else:
                writer.write(f"HTTP/1.1 {status} Some Words\r\nContent-Length: 0\r\n\r\n".encode())


@contextlib.asynccontextmanager
async def serving(*statuses: int) -> AsyncGenerator[Server]:
    server = Server(free_port(), list(statuses))
    async with await asyncio.start_server(server.accept, "127.0.0.1", server.port):
        yield server
        await asyncio.gather(*server.served)


@pytest.fixture(autouse=True)
def impatience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "PAUSES_S", (0.01, 0.01))
    for name in ("NO_PROXY", "no_proxy", "HTTP_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)


async def send(url: str, user: str = "anna") -> tuple[str, str]:
    """Return code and sentence of the failure."""
    return await failure_of(Webhook.parse(url), act_on("screws", user=user, confidence=0.876))


async def test_the_server_gets_one_request_with_what_happened() -> None:
    async with serving(204) as server:
        assert await send(f"http://127.0.0.1:{server.port}/hook?by={{user}}", "anna.b-c") == ("", "")
        assert server.heads[0].startswith("POST /hook?by=anna.b-c HTTP/1.1\r\n")
        assert json.loads(server.bodies[0]) == {
            "thing": "screws", "user": "anna.b-c", "state": "on", "confidence": 0.88, "stamp_ns": 7,
        }  # fmt: skip


async def test_a_busy_server_is_asked_again_with_the_same_key() -> None:
    async with serving(503, 429, 200) as server:
        assert await send(f"http://127.0.0.1:{server.port}/") == ("", "")
        keys = [line for head in server.heads for line in head.splitlines() if "idempotency" in line.lower()]
        assert len(keys) == 3
        assert len(set(keys)) == 1


@pytest.mark.parametrize(
    ("status", "requests", "sentence"),
    [
        (404, 1, "http://127.0.0.1:PORT/... answered 404 Some Words"),
        (500, 3, "http://127.0.0.1:PORT/... answered 500 Some Words, 3 times"),
        (302, 1, "http://127.0.0.1:PORT/... answered 302 Some Words"),
    ],
)
async def test_a_failure_is_a_sentence_without_the_secret(
    monkeypatch: pytest.MonkeyPatch, status: int, requests: int, sentence: str
) -> None:
    monkeypatch.setattr(targets, "WEBHOOK_TIMEOUT_S", 60.0)
    async with serving(status) as server:
        failure = await send(f"http://127.0.0.1:{server.port}/secret")
        assert failure == ("refused", sentence.replace("PORT", str(server.port)))
        assert len(server.bodies) == requests


async def test_a_server_that_stalls_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "WEBHOOK_TIMEOUT_S", 0.2)
    async with serving(STALLED) as server:  # which may not read all three in time
        code, sentence = await send(f"http://127.0.0.1:{server.port}/secret")
        assert code == "no_answer"
        assert sentence == f"http://127.0.0.1:{server.port}/... did not answer within 0.2 s, 3 times"


async def test_no_server_is_a_failure() -> None:
    code, sentence = await send(f"http://me:secret@127.0.0.1:{free_port()}/")
    assert code == "no_answer"
    assert "could not be reached" in sentence
    assert "secret" not in sentence


async def test_act_can_be_cancelled_before_the_answer_and_between_tries(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(targets, "PAUSES_S", (1000.0,))
    for status in (STALLED, 503):
        async with serving(status) as server:
            sending = asyncio.create_task(send(f"http://127.0.0.1:{server.port}/"))
            await until(lambda: bool(server.bodies), what="the request")
            sending.cancel()
            await asyncio.wait({sending})
            assert sending.cancelled()


PROXIES = {
    "scheme of a desktop": "socks://127.0.0.1:9/",
    "no such scheme": "quic://127.0.0.1:9",
    "not installed": "socks5://127.0.0.1:9",
    "no URL": "http://[::1",
    "port": "http://proxy:port",
    "port that no system has": "http://127.0.0.1:999999",
    "port without a scheme": "proxy:70000",
}


@pytest.mark.parametrize("proxy", PROXIES.values(), ids=PROXIES.keys())
async def test_server_of_this_network_gets_the_request_whatever_the_proxy(
    monkeypatch: pytest.MonkeyPatch, proxy: str
) -> None:
    monkeypatch.setenv("ALL_PROXY", proxy)
    async with serving(204) as server:
        assert await send(f"http://127.0.0.1:{server.port}/") == ("", "")
        assert len(server.bodies) == 1


@pytest.mark.parametrize("proxy", PROXIES.values(), ids=PROXIES.keys())
async def test_unusable_proxy_is_a_failure_that_names_the_remedy(
    monkeypatch: pytest.MonkeyPatch, proxy: str
) -> None:
    monkeypatch.setenv("ALL_PROXY", proxy)
    code, sentence = await send("http://hooks.example/")
    assert code == "error"
    assert "http://hooks.example/... cannot be reached by the proxy" in sentence
    assert "or name its host in no_proxy" in sentence


async def test_missing_certificates_are_a_failure_that_names_the_variable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SSL_CERT_FILE", "/nowhere/authority.pem")
    _code, sentence = await send("https://hooks.example/")
    assert "was not sent: the file of SSL_CERT_FILE cannot be used" in sentence


async def test_server_of_the_internet_is_asked_by_the_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    async with serving(204) as proxy:
        monkeypatch.setenv("ALL_PROXY", f"http://127.0.0.1:{proxy.port}")
        assert await send("http://hooks.example/shop") == ("", "")
        assert proxy.heads[0].startswith("POST http://hooks.example/shop HTTP/1.1\r\n")


@pytest.mark.parametrize("exception", ["[::1]", "::1, [2606:4700::5]", "*.example", "[fe80::1]:80"])
async def test_no_proxy_entries_do_not_exempt_other_hosts(
    monkeypatch: pytest.MonkeyPatch, exception: str
) -> None:
    monkeypatch.setenv("no_proxy", exception)
    async with serving(204) as proxy:
        monkeypatch.setenv("http_proxy", f"127.0.0.1:{proxy.port}")
        assert await send("http://hooks.other/shop") == ("", "")
        assert proxy.heads[0].startswith("POST http://hooks.other/shop HTTP/1.1\r\n")


@pytest.mark.parametrize(
    ("exceptions", "url", "has_proxy"),
    [
        ("[2606:4700::5]", "http://[2606:4700::5]:8080/a", False),
        ("2606:4700::5", "http://[2606:4700::5]/a", False),
        ("example.org", "https://hooks.example.org/a", False),
        (".example.org", "https://me@hooks.example.org:444/a", False),
        ("hooks.example.org:444", "https://hooks.example.org:444/a", False),
        ("example.org", "https://badexample.org/a", True),
        ("[2606:4700::5]", "http://[2606:4700::6]/a", True),
    ],
)
def test_hosts_in_no_proxy_are_asked_directly(
    monkeypatch: pytest.MonkeyPatch, exceptions: str, url: str, *, has_proxy: bool
) -> None:
    monkeypatch.setenv("no_proxy", exceptions)
    monkeypatch.setenv("all_proxy", "http://proxy:3128")
    assert http_status.proxy_address(httpx.URL(url)) == ("http://proxy:3128" if has_proxy else None)


async def test_invalid_host_name_fails_after_one_attempt() -> None:
    _code, sentence = await send("http://xn--/hook")
    assert "http://xn--/... was not sent, as its address is not valid (" in sentence
    assert sentence.endswith("): correct it")


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        *((host, True) for host in ("localhost", "127.3.2.1", "[::1]", "192.168.7.9", "10.1.2.3:8080")),
        *((host, True) for host in ("[fd12::3]:80", "[fe80::1]", "169.254.3.4", "hub.local.", "hub")),
        *((host, False) for host in ("8.8.8.8", "[2606:4700::1]", "hub.local.example.org", "example.org")),
    ],
)
def test_hosts_of_this_network_need_no_proxy(host: str, *, expected: bool) -> None:
    assert http_status.is_local(f"https://me@{host}/path") == expected


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("http://", "has no host"),
        ("https:///path", "has no host"),
        ("http://[::1/", "is no URL"),
        ("http://hub:999999/", r"is no URL: write"),
        ("http://192.168.1/hook", r"is no URL: write"),
        ("http://x/{usr}", "did you mean user"),
    ],
)
def test_invalid_webhook_is_one_sentence(url: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        Reaction.parse(f"screws={url}")
