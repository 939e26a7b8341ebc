"""Subprotocols that viewers offer: older ones, lists, none, and what the log says of those refused."""

import asyncio
import logging
import ssl
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
import websockets
from websockets.typing import Subprotocol

from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.server import names_of, rename
from pointit.bridges.foxglove.service import SERVICE
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import WallClock
from pointit.schemas import Belt, Environment, topics
from tests.integration.foxglove.viewer import SDK, viewer
from tests.support.bench import Bench, until
from tests.support.buses import free_port

WEBSOCKET = "foxglove.websocket.v1"
MAP = Environment(stamp_ns=1, name="lab", belts=(Belt(id="b", line_m=((0, 0, 1), (4, 0, 1))),))


async def listens(host: str, port: int) -> None:
    """Wait until something listens."""
    while True:
        try:
            _, writer = await asyncio.open_connection(host, port)
        except OSError:
            await asyncio.sleep(0.05)
        else:
            writer.close()
            return


@pytest_asyncio.fixture(params=["127.0.0.1", "::1"])
async def address(request: pytest.FixtureRequest) -> AsyncIterator[str]:
    """A bridge that has a map."""
    host: str = request.param
    port = free_port()
    bus = MemoryBus(LocalBroker())
    bench = Bench(bus, WallClock())
    bench.put(topics.MAP, MAP)
    bench.start(SERVICE, FoxgloveConfig.model_validate({"host": host, "port": port}))
    try:
        async with asyncio.timeout(60.0):
            await listens(host, port)
        yield f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    finally:
        await bench.stop()
        await bus.close()


@pytest.mark.parametrize(
    ("offered", "chosen"),
    [
        ((SDK,), SDK),
        ((WEBSOCKET,), WEBSOCKET),
        ((SDK, WEBSOCKET), SDK),
        ((WEBSOCKET, SDK), SDK),
        (("foxglove.sdk.v9", WEBSOCKET), WEBSOCKET),
    ],
)
async def test_viewer_sees_the_scene_by_the_name_that_it_knows(
    address: str, offered: tuple[str, ...], chosen: str
) -> None:
    async with viewer(f"ws://{address}", "/scene/room", subprotocols=offered) as one:
        assert one.subprotocol == chosen
        await until(lambda: "belt b" in one.entities("room"), what="the room")
        assert one.info["op"] == "serverInfo"


@pytest.mark.parametrize(
    ("offered", "shown"),
    [((), "no subprotocol"), (("rosbridge_v2", "foxglove.websocket.v2"), "rosbridge_v2, foxglove.websocket")],
)
async def test_viewer_with_other_names_is_refused_and_the_log_says_why(
    address: str, caplog: pytest.LogCaptureFixture, offered: tuple[str, ...], shown: str
) -> None:
    names = [Subprotocol(name) for name in offered] or None
    for _ in range(3):  # one line in the log
        with pytest.raises(websockets.InvalidStatus, match="400"):
            await websockets.connect(f"ws://{address}", subprotocols=names)
    (line,) = [each.getMessage() for each in caplog.records if "was refused" in each.getMessage()]
    assert f"it offers {shown}" in line
    assert "choose *Foxglove WebSocket*" in line


async def test_encrypted_connection_is_refused_at_once(
    address: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    with pytest.raises((ssl.SSLError, OSError, EOFError, websockets.InvalidMessage)):
        await websockets.connect(f"wss://{address}", ssl=ssl.create_default_context())
    await until(lambda: "open ws:// in it, not wss://" in caplog.text)


async def test_message_of_many_packets_arrives_whole(address: str) -> None:
    """As the server reads it: what it does not know is answered by a status."""
    async with viewer(f"ws://{address}", "/scene/room", subprotocols=(WEBSOCKET,)) as one:
        await one.send({"op": "subscribe", "subscriptions": [], "padding": "x" * 500_000})
        await until(lambda: "belt b" in one.entities("room"), what="the room")


def test_names_are_found_and_exchanged_in_any_spelling_of_the_header() -> None:
    head = (
        b"GET / HTTP/1.1\r\nHost: x\r\nSEC-WebSocket-protocol:foxglove.websocket.v1 ,other\r\n"
        b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\nX: foxglove.websocket.v1\r\n\r\n"
    )
    assert names_of(head) == [WEBSOCKET, "other", SDK]
    renamed = rename(head, WEBSOCKET, SDK)
    assert names_of(renamed) == [SDK, "other", SDK]
    assert renamed.startswith(b"GET / HTTP/1.1\r\nHost: x\r\n")
    assert renamed.endswith(b"\r\nX: foxglove.websocket.v1\r\n\r\n")
