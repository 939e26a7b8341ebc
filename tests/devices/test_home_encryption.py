"""Servers in front of a Home Assistant that refuse by TLS: each is named, none is told to leave it out."""

import asyncio
import ssl
from pathlib import Path

import pytest
from pydantic import ValidationError

from pointit.bridges.home_assistant.connection import connected
from tests.support.buses import free_port
from tests.support.certificates import issue
from tests.support.home_assistant import MemoryHome, config_of, refusal
from tests.support.tls_servers import REFUSALS, refusing


async def test_redirect_of_an_encrypted_address_to_a_plain_one_is_not_offered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def reply(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(1000)
        writer.write(b"HTTP/1.1 301 Moved\r\nLocation: http://ha.example/api/websocket\r\n\r\n")
        writer.close()

    authority, certificate, key = issue(tmp_path, "localhost")
    monkeypatch.setenv("SSL_CERT_FILE", str(authority))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    async with await asyncio.start_server(reply, "127.0.0.1", 0, ssl=context) as server:
        port = server.sockets[0].getsockname()[1]
        problem = await refusal(config_of(tmp_path, 1, url=f"https://localhost:{port}"))
    assert "refers to http://ha.example, which does not encrypt: have the proxy pass" in problem
    assert "write http://" not in problem


@pytest.mark.parametrize("kind", REFUSALS)
async def test_refusal_by_tls_is_named_and_never_answered_by_leaving_encryption_out(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with refusing(tmp_path, kind) as (port, authority):
        monkeypatch.setenv("SSL_CERT_FILE", str(authority))
        problem = await refusal(config_of(tmp_path, 1, url=f"https://localhost:{port}"))
        is_told_to_encrypt = await refusal(config_of(tmp_path, 1, url=f"http://localhost:{port}"))
    assert REFUSALS[kind][1] in problem
    assert "http://" not in problem
    if kind != "version":
        assert f"encrypts: write https://localhost:{port} as `url`" in is_told_to_encrypt


async def test_proxy_that_answers_plain_requests_at_its_tls_port_still_encrypts(tmp_path: Path) -> None:
    """A server that ends every handshake, and answers plain requests with 400 as nginx does."""

    async def reply(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if (await reader.read(1000)).startswith(b"GET"):
            writer.write(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")
        writer.close()

    async with await asyncio.start_server(reply, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        problem = await refusal(config_of(tmp_path, 1, url=f"https://127.0.0.1:{port}"))
    assert "write http://" not in problem


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("http://[fe80::1]:8123", "fe80::1 is in more than one network: add this machine's interface, as in"),
        ("http://[fe80::1%25lo]:8123", ""),
        ("http://[fe80::1%lo]:8123", ""),
    ],
)
def test_link_local_address_needs_its_interface_in_either_form(
    url: str, sentence: str, tmp_path: Path
) -> None:
    if sentence:
        with pytest.raises(ValidationError, match=sentence):
            config_of(tmp_path, 1, url=url)
        return
    assert config_of(tmp_path, 1, url=url).url == "http://[fe80::1%lo]:8123"


async def test_http_and_https_mixed_up_name_the_right_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory_home = MemoryHome({})
    async with memory_home.serving() as port:
        config = config_of(tmp_path, port, url=f"https://127.0.0.1:{port}")
        assert f"does not encrypt: write http://127.0.0.1:{port} as `url`" in await refusal(config)
    authority, certificate, key = issue(tmp_path, "127.0.0.1")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    async with memory_home.serving(ssl=context) as port:
        assert f"encrypts: write https://127.0.0.1:{port} as `url`" in await refusal(
            config_of(tmp_path, port)
        )

        config = config_of(tmp_path, port, url=f"https://127.0.0.1:{port}")
        assert "is not trusted (" in (problem := await refusal(config))
        assert "set the variable SSL_CERT_FILE to a file with its authority's certificate" in problem

        monkeypatch.setenv("SSL_CERT_FILE", str(authority))
        async with connected(config):
            pass

    port = free_port()
    assert f"no Home Assistant answers at http://127.0.0.1:{port}" in await refusal(config_of(tmp_path, port))
