"""A WLED: announced by mDNS, describes itself by HTTP, shows what arrives by DDP."""

import asyncio
import importlib
import json
import socket
import threading
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

from zeroconf.asyncio import AsyncServiceInfo, AsyncZeroconf

from pointit.services.led_driver.output.ddp import PORT, SERVICE

Packet: Any = importlib.import_module("ddp.packet").Packet
"""Packet of python-led-ddp, which is untyped."""
INFO = {"leds": {"count": 120}, "ver": "0.15.1", "name": "Kitchen"}


class Info(BaseHTTPRequestHandler):
    """The answer of WLED to `/json/info`."""

    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/json/info" else 404)
        self.end_headers()
        self.wfile.write(json.dumps(INFO).encode())

    def log_request(self, code: object = "-", size: object = "-") -> None:
        """Log nothing."""


@contextmanager
def served_info() -> Generator[int]:
    """Yield the port at which `INFO` is served."""
    server = HTTPServer(("127.0.0.1", 0), Info)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def announcement(name: str, port: int) -> AsyncServiceInfo:
    kind = f"{SERVICE}.local."
    address = socket.inet_aton("127.0.0.1")
    host = f"{name}.local."
    return AsyncServiceInfo(kind, f"{name}.{kind}", port=port, addresses=[address], server=host)


@dataclass
class Wled(asyncio.DatagramProtocol):
    """Pixels of the controller, and those that it has shown."""

    pixels: bytearray = field(default_factory=lambda: bytearray(3 * INFO["leds"]["count"]))
    shown: list[bytes] = field(default_factory=list[bytes])

    def datagram_received(self, data: bytes, addr: object) -> None:  # noqa: ARG002 - asyncio's
        """Take a packet; its pixels beyond the last of the controller are dropped, as WLED does."""
        packet = Packet.from_bytes(data)
        start = packet.header.offset
        room = max(0, len(self.pixels) - start)
        part = packet.data[:room]
        self.pixels[start : start + len(part)] = part
        if not packet.header.packet_type.push:
            return
        shown = bytes(self.pixels)
        if self.shown[-1:] != [shown]:
            self.shown.append(shown)


@asynccontextmanager
async def wled(name: str = "wled-test") -> AsyncGenerator[Wled]:
    """Run one on this machine, at the port of DDP, of which there is one."""
    with served_info() as port:
        async with AsyncZeroconf() as announcer:
            await (await announcer.async_register_service(announcement(name, port)))
            loop = asyncio.get_running_loop()
            transport, light = await loop.create_datagram_endpoint(Wled, local_addr=("127.0.0.1", PORT))
            try:
                yield light
            finally:
                transport.close()
