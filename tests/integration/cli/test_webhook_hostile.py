"""Webhooks at hostile web servers: endless, huge, slow and compressed answers are cut early."""

import asyncio
import gzip
import tracemalloc

import pytest

from pointit.services.reactions import targets
from pointit.services.reactions.http_status import MAX_HEAD_BYTES
from pointit.services.reactions.targets import Webhook
from tests.support.acts import act_on, failure_of
from tests.support.hostile_server import Chunks, HostileServer, drip, forever, hostile_server

ACT = act_on("screws")
OK = b"HTTP/1.1 200 OK\r\n"
MAX_SENT = 16_000_000
"""Bytes of an endless answer that buffers of the system can hold."""
MAX_MEMORY = 8_000_000


@pytest.fixture(autouse=True)
def one_try(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "PAUSES_S", ())


async def react(server: HostileServer, timeout_s: float = 60.0) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(targets, "WEBHOOK_TIMEOUT_S", timeout_s)
        _code, sentence = await failure_of(Webhook.parse(server.url), ACT)
        return sentence.partition("/... ")[2]


async def test_compressed_body_is_neither_asked_for_nor_decoded() -> None:
    bomb = gzip.compress(bytes(100_000_000), 1)
    head = OK + f"Content-Encoding: gzip\r\nContent-Length: {len(bomb)}\r\n\r\n".encode()
    with hostile_server(lambda _: [head, bomb]) as server:
        tracemalloc.start()
        try:
            assert await react(server) == ""
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    assert peak < MAX_MEMORY
    assert b"accept-encoding: identity\r\n" in server.requests[0].lower()


BODIES: dict[str, Chunks] = {
    "endless": forever(b"x" * 65536, OK + b"\r\n"),
    "endless chunks": forever(
        b"fff0\r\n" + b"x" * 0xFFF0 + b"\r\n", OK + b"Transfer-Encoding: chunked\r\n\r\n"
    ),
    "one byte a second": drip(OK + b"Content-Length: 500\r\n\r\n" + b"x" * 500, 0.0),
    "less than announced": lambda _: [OK + b"Content-Length: 99999999\r\n\r\nx"],
}


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES.keys())
async def test_status_is_enough_whatever_the_body(body: Chunks) -> None:
    with hostile_server(body) as server:
        assert await react(server) == ""
        assert await asyncio.to_thread(server.closed.wait, 30)
    assert server.sent < MAX_SENT


HEADS: dict[str, Chunks] = {
    "interim responses": forever(b"HTTP/1.1 100 Continue\r\n\r\n" * 1000),
    "many headers": forever(b"a: b\r\n" * 1000, OK),
    "a long header": forever(b"x" * 65536, OK + b"a: "),
    "folded lines": forever(b" x\r\n" * 1000, OK + b"a: b\r\n"),
    "a long reason": forever(b"x" * 65536, b"HTTP/1.1 200 "),
    "blank lines": forever(b"\r\n" * 1000),
}


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS.keys())
async def test_answer_with_an_endless_head_is_cut_and_a_failure(head: Chunks) -> None:
    with hostile_server(head) as server:
        problem = await react(server)
        assert await asyncio.to_thread(server.closed.wait, 30)
    assert problem.startswith("could not be reached (")
    assert len(problem) < 300
    assert server.sent < MAX_SENT


async def test_size_of_a_head_is_in_the_sentence() -> None:
    with hostile_server(forever(b"HTTP/1.1 100 Continue\r\n\r\n" * 1000)) as server:
        assert f"the headers of its answer exceed {MAX_HEAD_BYTES} bytes" in await react(server)


async def test_other_tasks_run_while_a_head_is_read() -> None:
    turns = 0

    async def count() -> None:
        nonlocal turns
        while True:
            await asyncio.sleep(0)
            turns += 1

    with hostile_server(forever(b"HTTP/1.1 100 Continue\r\n\r\n" * 1000)) as server:
        counting = asyncio.create_task(count())
        await asyncio.sleep(0)
        start = turns
        await react(server)
        counting.cancel()
    assert turns - start >= MAX_HEAD_BYTES // 1024


async def test_answer_of_one_byte_a_second_ends_in_time() -> None:
    with hostile_server(drip(OK * 100, 1.0)) as server:
        timeout_s = 0.5
        while not server.requests:  # a busy machine may take as long to connect
            timeout_s *= 2.0
            assert await react(server, timeout_s) == f"did not answer within {timeout_s:g} s, 1 times"
        assert await asyncio.to_thread(server.closed.wait, 30)


async def test_redirect_to_itself_is_not_followed_nor_its_body_read() -> None:
    def redirect(_over: object) -> list[bytes]:
        location = f"Location: {server.url}\r\n".encode()
        return [b"HTTP/1.1 307 Again\r\n" + location + b"Set-Cookie: a=b\r\n\r\n", *[b"x" * 65536] * 1000]

    with hostile_server(redirect) as server:
        assert await react(server) == "answered 307 Again"
        assert await asyncio.to_thread(server.closed.wait, 30)
    assert len(server.requests) == 1
    assert server.sent < MAX_SENT


async def test_words_of_a_server_are_cut_and_without_controls() -> None:
    with hostile_server(lambda _: [b"HTTP/1.1 404 \tgone\xff" + b"x" * 9000 + b"\r\n\r\n"]) as server:
        problem = await react(server)
    assert problem.startswith("answered 404 ")
    assert len(problem) < 250
    assert problem.isprintable()


async def test_user_and_password_of_a_url_become_basic_authorization() -> None:
    with hostile_server(lambda _: [OK + b"\r\n"]) as server:
        url = server.url.replace("//", "//me:a%2Fb@")
        assert await failure_of(Webhook.parse(url), ACT) == ("", "")
    assert b"authorization: basic bwu6ys9i\r\n" in server.requests[0].lower()
