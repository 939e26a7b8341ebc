"""A UDP port that several programs share."""

import asyncio
import contextlib
import socket
from typing import Any

import pytest

from pointit.services.imu_bridge.network.udp_server import Address, UdpServer
from tests.support.bench import until
from tests.support.buses import free_udp_port
from tests.support.running_source import Health, phone_at

pytestmark = pytest.mark.wall_time


@pytest.mark.skipif(not hasattr(socket, "SO_REUSEPORT"), reason="no port can be shared here")
async def test_datagram_of_another_that_comes_before_a_connection_keeps_its_sender(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard: set[tuple[bytes, Address]] = set()

    def on_datagram(data: bytes, address: Address) -> None:
        heard.add((data, address))

    port, names = free_udp_port(), [b"%d" % number for number in range(32)]
    server = UdpServer("127.0.0.1", port, Health(), on_datagram, remedy="", is_shared=True)
    async with contextlib.AsyncExitStack() as stack:
        strangers = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in names]

        class Slow(socket.socket):
            def connect(self, address: Any, /) -> None:
                for name, stranger in zip(names, strangers, strict=True):
                    stranger.sendto(name, ("127.0.0.1", port))
                super().connect(address)

        task = asyncio.create_task(server.run())
        tracker = await stack.enter_async_context(phone_at(port))
        await until(tracker.saying(b"hello", lambda: bool(heard)))
        ((_, address),) = heard
        monkeypatch.setattr(socket, "socket", Slow)
        server.connect(address)
        await until(lambda: len(heard) == 1 + len(names))
        task.cancel()
        await asyncio.wait({task})
        assert heard == {(b"hello", address)} | {
            (name, ("127.0.0.1", stranger.getsockname()[1]))
            for name, stranger in zip(names, strangers, strict=True)
        }
