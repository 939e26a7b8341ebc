# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (the stubs of zenoh leave return types out)
"""The floor of any bridge in Python: bytes taken from one Zenoh session and put to another, nothing else.

As a program: `python -m benchmarks.bare_relay FROM TO` relays until it is ended.
"""

import asyncio
import json
import sys
import time
from typing import Any

import psutil
import zenoh
from zenoh.handlers import Callback

from tests.support.buses import free_port

KEY = "relayed"
PAYLOAD = bytes(100)
ATTACHMENT = bytes(33)
READY_S = 20.0


def opened(mode: str, endpoint: str) -> zenoh.Session:
    """Return a session that listens at `endpoint` as a router, or connects there."""
    config = zenoh.Config()
    where = "listen" if mode == "router" else "connect"
    settings = {"mode": mode, f"{where}/endpoints": [endpoint], "scouting/multicast/enabled": False}
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


async def cost(rate_hz: float, duration_s: float) -> dict[str, Any]:
    """Return what the relay takes of a core, and what it loses."""
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    source, sink = (opened("router", endpoint) for endpoint in endpoints)
    child = await asyncio.create_subprocess_exec(sys.executable, "-m", "benchmarks.bare_relay", *endpoints)
    arrived: list[zenoh.Sample] = []
    try:
        publisher = source.declare_publisher(KEY)
        reader = sink.declare_subscriber(KEY, Callback(arrived.append, indirect=False))
        async with asyncio.timeout(READY_S):
            while not arrived:
                publisher.put(PAYLOAD, attachment=ATTACHMENT)
                await asyncio.sleep(0.1)
        await asyncio.sleep(0.5)
        arrived.clear()
        process = psutil.Process(child.pid)
        before, began_s = process.cpu_times(), time.perf_counter()
        count = int(rate_hz * duration_s)
        for _ in range(count):
            publisher.put(PAYLOAD, attachment=ATTACHMENT)
            await asyncio.sleep(1.0 / rate_hz)
        after, took_s = process.cpu_times(), time.perf_counter() - began_s
        await asyncio.sleep(0.2)
        cpu_s = after.user + after.system - before.user - before.system
        reader.undeclare()
    finally:
        child.kill()
        await child.wait()
        source.close()
        sink.close()
    return {
        "cpu_share_of_a_core": round(cpu_s / took_s, 4),
        "messages_per_second": round(count / took_s, 1),
        "us_per_message": round(cpu_s / count * 1e6, 1),
        "lost": count - len(arrived),
    }


def main(source: str, sink: str) -> None:
    """Relay until ended."""
    taken, given = opened("client", source), opened("client", sink)
    publisher = given.declare_publisher(KEY)

    def relay(sample: zenoh.Sample) -> None:
        publisher.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

    reader = taken.declare_subscriber(KEY, Callback(relay, indirect=False))
    while reader:
        time.sleep(3600.0)


if __name__ == "__main__":
    main(*sys.argv[1:])
