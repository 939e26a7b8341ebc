# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (the stubs of zenoh leave return types out)
"""Lower bound of any bridge in Python: forwards bytes from one Zenoh session to another.

As a program: `python -m benchmarks.bare_relay FROM TO` relays both ways until it is ended.
"""

import asyncio
import contextlib
import json
import sys
import time
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Any

import psutil
import zenoh
from zenoh.handlers import Callback

from benchmarks.statistics import Figures
from tests.support.buses import free_port

THERE, BACK = "relayed", "returned"
PAYLOAD = bytes(100)
ATTACHMENT = bytes(33)
READY_S = 20.0
SETTLE_S = 0.5
LOST_S = 1.0


def opened(mode: str, endpoint: str) -> zenoh.Session:
    """Open a session that listens at `endpoint` as a router, or connects there."""
    config = zenoh.Config()
    where = "listen" if mode == "router" else "connect"
    settings = {"mode": mode, f"{where}/endpoints": [endpoint], "scouting/multicast/enabled": False}
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


@dataclass(frozen=True)
class Ends:
    """Both ends of a relay, and its process."""

    source: zenoh.Session
    sink: zenoh.Session
    process: psutil.Process


@contextlib.asynccontextmanager
async def relaying() -> AsyncGenerator[Ends]:
    """Yield the ends of a relay that has started."""
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    source, sink = (opened("router", endpoint) for endpoint in endpoints)
    child = await asyncio.create_subprocess_exec(sys.executable, "-m", "benchmarks.bare_relay", *endpoints)
    arrived: list[zenoh.Sample] = []
    try:
        for near, far, key in ((source, sink, THERE), (sink, source, BACK)):
            reader = far.declare_subscriber(key, Callback(arrived.append, indirect=False))
            async with asyncio.timeout(READY_S):
                while not arrived:
                    near.put(key, PAYLOAD, attachment=ATTACHMENT)
                    await asyncio.sleep(0.1)
            reader.undeclare()
            arrived.clear()
        await asyncio.sleep(SETTLE_S)
        yield Ends(source, sink, psutil.Process(child.pid))
    finally:
        child.kill()
        await child.wait()
        source.close()
        sink.close()


async def cost(rate_hz: float, duration_s: float, at_once: int = 1) -> dict[str, Any]:
    """Return the CPU share and losses of the relay, with bursts of `at_once` messages."""
    arrived: list[zenoh.Sample] = []
    async with relaying() as ends:
        publisher = ends.source.declare_publisher(THERE)
        reader = ends.sink.declare_subscriber(THERE, Callback(arrived.append, indirect=False))
        await asyncio.sleep(SETTLE_S)
        before, began_s = ends.process.cpu_times(), time.perf_counter()
        times = int(rate_hz * duration_s) // at_once
        count = times * at_once
        for _ in range(times):
            for _ in range(at_once):
                publisher.put(PAYLOAD, attachment=ATTACHMENT)
            await asyncio.sleep(at_once / rate_hz)
        after, took_s = ends.process.cpu_times(), time.perf_counter() - began_s
        await asyncio.sleep(0.2)
        cpu_s = after.user + after.system - before.user - before.system
        reader.undeclare()
    return {
        "cpu_share_of_a_core": round(cpu_s / took_s, 4),
        "messages_per_second": round(count / took_s, 1),
        "us_per_message": round(cpu_s / count * 1e6, 1),
        "lost": count - len(arrived),
    }


async def round_trip(rate_hz: float, count: int) -> dict[str, Any]:
    """Return round-trip times of source, relay, sink, relay, source, one message after the other."""
    times_s: list[float] = []
    loop, came = asyncio.get_running_loop(), asyncio.Event()
    async with relaying() as ends:
        there, back = ends.source.declare_publisher(THERE), ends.sink.declare_publisher(BACK)

        def echo(sample: zenoh.Sample) -> None:
            back.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

        def hear(_: zenoh.Sample) -> None:
            times_s.append(time.perf_counter() - began_s)
            loop.call_soon_threadsafe(came.set)

        readers = (
            ends.sink.declare_subscriber(THERE, Callback(echo, indirect=False)),
            ends.source.declare_subscriber(BACK, Callback(hear, indirect=False)),
        )
        await asyncio.sleep(SETTLE_S)
        for _ in range(count):
            came.clear()
            began_s = time.perf_counter()
            there.put(PAYLOAD, attachment=ATTACHMENT)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(came.wait(), LOST_S)
            await asyncio.sleep(1.0 / rate_hz)
        for reader in readers:
            reader.undeclare()
    return {**Figures.of(times_s).as_dict(), "lost": count - len(times_s)}


def main(source: str, sink: str) -> None:
    """Relay until terminated."""
    near, far = opened("client", source), opened("client", sink)
    there, back = far.declare_publisher(THERE), near.declare_publisher(BACK)

    def relay(sample: zenoh.Sample) -> None:
        there.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

    def give_back(sample: zenoh.Sample) -> None:
        back.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

    readers = (
        near.declare_subscriber(THERE, Callback(relay, indirect=False)),
        far.declare_subscriber(BACK, Callback(give_back, indirect=False)),
    )
    while readers:
        time.sleep(3600.0)


if __name__ == "__main__":
    main(*sys.argv[1:])
