"""Search for WLED: a controller announced by mDNS, with a web interface, is found and described."""

import asyncio
import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from zeroconf.asyncio import AsyncServiceInfo, AsyncZeroconf

from pointit.services.led_driver.output.ddp import SERVICE, find_wled

INFO = {"leds": {"count": 120}, "ver": "0.15.1", "name": "Kitchen"}


class Info(BaseHTTPRequestHandler):
    """The answer of WLED to `/json/info`."""

    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/json/info" else 404)
        self.end_headers()
        self.wfile.write(json.dumps(INFO).encode())

    def log_request(self, code: object = "-", size: object = "-") -> None:
        """Log nothing."""


@pytest.fixture
def web_port() -> Iterator[int]:
    server = HTTPServer(("127.0.0.1", 0), Info)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    yield server.server_port
    server.shutdown()
    thread.join()
    server.server_close()


async def write_garbage(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    del reader
    writer.write(b"garbage\r\n\r\n")
    writer.close()


async def write_for_ever(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while not reader.at_eof():
        writer.write(b"H")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(0.1):
                await reader.read()
    writer.close()


def announcement(name: str, port: int) -> AsyncServiceInfo:
    kind = f"{SERVICE}.local."
    address = socket.inet_aton("127.0.0.1")
    return AsyncServiceInfo(kind, f"{name}.{kind}", port=port, addresses=[address], server=f"{name}.local.")


async def test_controller_in_the_network_is_found_beside_others_that_answer_nonsense(web_port: int) -> None:
    async with (
        await asyncio.start_server(write_garbage, "127.0.0.1") as garbage,
        await asyncio.start_server(write_for_ever, "127.0.0.1") as slow,
        AsyncZeroconf() as announcer,
    ):
        ports = {"wled-test": web_port} | {
            f"wled-{name}": server.sockets[0].getsockname()[1]
            for name, server in (("garbage", garbage), ("slow", slow))
        }
        for name, port in ports.items():
            await (await announcer.async_register_service(announcement(name, port)))  # pyright: ignore[reportUnknownMemberType]
        found = {each.label: each for each in await find_wled(3.0)}
    kitchen = found["Kitchen, 120 pixels, WLED 0.15.1"]
    assert kitchen.address in ("127.0.0.1", "wled-test.local")
    assert kitchen.details == {"pixels": 120, "version": "0.15.1"}
    assert {"wled-garbage", "wled-slow"} <= found.keys()
