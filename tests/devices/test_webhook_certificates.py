"""A webhook to a genuine HTTPS server with a certificate of its own."""

import asyncio
import ssl
from pathlib import Path

import pytest

from pointit.services.reactions import targets
from pointit.services.reactions.targets import Webhook
from tests.support.acts import act_on, failure_of
from tests.support.certificates import issue

ACT = act_on("screws")


async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    await reader.readuntil(b"\r\n\r\n")
    writer.write(b"HTTP/1.1 204 No Content\r\nConnection: close\r\n\r\n")
    writer.close()


async def test_untrusted_certificate_is_reported_and_can_be_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(targets, "PAUSES_S", ())
    authority, certificate, key = issue(tmp_path, "localhost")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    async with await asyncio.start_server(answer, "127.0.0.1", 0, ssl=context) as server:
        hook = Webhook.parse(f"https://localhost:{server.sockets[0].getsockname()[1]}/secret")
        _code, problem = await failure_of(hook, ACT)
        monkeypatch.setenv("SSL_CERT_FILE", str(authority))
        assert await failure_of(hook, ACT) == ("", "")
    assert "the certificate of the server is not trusted (" in problem
    assert "set the variable SSL_CERT_FILE to a file with its authority's certificate" in problem
    assert "secret" not in problem
