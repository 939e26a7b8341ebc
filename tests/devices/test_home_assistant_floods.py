"""A server in place of Home Assistant that floods the bridge, in a thread of its own."""

import asyncio
import contextlib
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection, serve

from pointit.runtime.clock import WallClock
from tests.support.bench import memory_bench
from tests.support.buses import free_port
from tests.support.home_assistant import HomeSite, config_of, start, thing

LAMP = "light.desk"


def frame(payload: bytes, opcode: int = 1) -> bytes:
    """Return a frame of a websocket from a server."""
    return bytes([0x80 | opcode, 127]) + len(payload).to_bytes(8) + payload


def change(entity: str, state: str, **attributes: Any) -> bytes:
    new = {"entity_id": entity, "state": state, "attributes": attributes}
    event = {"event_type": "state_changed", "data": {"entity_id": entity, "new_state": new}}
    return frame(json.dumps({"id": 1, "type": "event", "event": event}).encode())


FLOODS: dict[str, Callable[[int], bytes]] = {
    "a lamp that flaps": lambda n: change(LAMP, ("on", "off", "unavailable")[n % 3], brightness=n % 255 + 1),
    "new entities": lambda n: change(f"media_player.m{n}", "on", text="x" * 700),
    "tiny messages": lambda _: b"\x81\x02[]" * 1000,
    "pings": lambda _: b"\x89\x00" * 1000,
    "lists of nothing": lambda _: frame(b"[" + b"{}," * 1_000_000 + b"{}]"),
    "one deep state": lambda _: frame(
        b'{"id":3,"type":"result","success":true,"result":[[' + b"{}," * 1_000_000 + b"{}]]}"
    ),
}


async def send_flood(websocket: ServerConnection, message: Callable[[int], bytes]) -> None:
    with contextlib.suppress(RuntimeError):  # the bridge has gone
        for number in itertools.count():
            if websocket.transport.is_closing():  # what is written then is dropped without an error
                return
            websocket.transport.write(message(number))
            while websocket.transport.get_write_buffer_size() > 2**20:  # noqa: ASYNC110 - no event
                await asyncio.sleep(0.01)


@pytest.mark.parametrize("flood", FLOODS)
async def test_server_that_floods_the_bridge_leaves_the_loop_to_others(flood: str, tmp_path: Path) -> None:
    headers: list[Any] = []

    async def answer(websocket: ServerConnection) -> None:
        headers.append(websocket.request and websocket.request.headers.get("Sec-WebSocket-Extensions"))
        await websocket.send('{"type": "auth_required"}')
        await websocket.recv()
        await websocket.send('{"type": "auth_ok"}')
        async with asyncio.TaskGroup() as tasks:
            async for text in websocket:
                command = json.loads(text)
                names = range(5000 if command["type"] == "get_states" else 0)
                states = [{"entity_id": f"light.l{number}", "state": "off"} for number in names]
                reply = {"id": command["id"], "type": "result", "success": True, "result": states}
                await websocket.send(json.dumps(reply))
                if states:
                    tasks.create_task(send_flood(websocket, FLOODS[flood]))

    port = free_port()

    def run_server() -> None:
        async def run() -> None:
            async with serve(answer, "127.0.0.1", port, ping_interval=None):
                await asyncio.sleep(4.0)

        asyncio.run(run())

    turns_s: list[float] = []
    async with memory_bench(WallClock()) as bench:
        server = asyncio.create_task(asyncio.to_thread(run_server))
        HomeSite(
            bench, thing("desk", LAMP), *(thing(f"t{number}", f"light.x{number}") for number in range(9))
        )
        start(bench, config_of(tmp_path, port))
        while not server.done():
            begin_s = time.thread_time()
            await asyncio.sleep(0.001)
            turns_s.append(time.thread_time() - begin_s)
    assert headers[0] is None, "no compression: some bytes can become many"
    assert max(turns_s) < 0.1
    assert len(turns_s) > 100
