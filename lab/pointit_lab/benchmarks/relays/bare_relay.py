"""Lower bound of any bridge in Python: forwards bytes from one Zenoh session to another.

As a program: `python -m pointit_lab.benchmarks.relays.bare_relay FROM TO` relays both ways until it is ended.
"""

import asyncio
import contextlib
import sys
import time
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Any

import psutil
import zenoh
from zenoh.handlers import Callback

from pointit_lab.benchmarks.bare_chain import opened
from pointit_lab.benchmarks.relays.relay_cost import RoundTrips, relay_cost
from tests.support.buses import free_port

THERE, BACK = "relayed", "returned"
PAYLOAD = bytes(100)
ATTACHMENT = bytes(33)
READY_S = 20.0
SETTLE_S = 0.5


@dataclass(frozen=True)
class RelayEnds:
    """Both ends of a relay, and its process."""

    source: zenoh.Session
    sink: zenoh.Session
    process: psutil.Process


@contextlib.asynccontextmanager
async def relaying() -> AsyncGenerator[RelayEnds]:
    """Yield the ends of a relay that has started."""
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    source, session = (opened(listen=endpoint, mode="router") for endpoint in endpoints)
    child = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "pointit_lab.benchmarks.relays.bare_relay", *endpoints
    )
    samples: list[zenoh.Sample] = []
    try:
        for near, far, key in ((source, session, THERE), (session, source, BACK)):
            reader = far.declare_subscriber(key, Callback(samples.append, indirect=False))
            async with asyncio.timeout(READY_S):
                while not samples:
                    near.put(key, PAYLOAD, attachment=ATTACHMENT)
                    await asyncio.sleep(0.1)
            reader.undeclare()
            samples.clear()
        await asyncio.sleep(SETTLE_S)
        yield RelayEnds(source, session, psutil.Process(child.pid))
    finally:
        child.kill()
        await child.wait()
        source.close()
        session.close()


async def cost(rate_hz: float, duration_s: float, at_once: int = 1) -> dict[str, Any]:
    """Return the CPU share and losses of the relay, with bursts of `at_once` messages."""
    samples: list[zenoh.Sample] = []
    async with relaying() as ends:
        publisher = ends.source.declare_publisher(THERE)
        reader = ends.sink.declare_subscriber(THERE, Callback(samples.append, indirect=False))
        await asyncio.sleep(SETTLE_S)

        def put(_turn: int) -> None:
            publisher.put(PAYLOAD, attachment=ATTACHMENT)

        count, figures = await relay_cost(ends.process, put, rate_hz, duration_s, at_once=at_once)
        reader.undeclare()
    return {**figures, "lost": count - len(samples)}


async def round_trip(rate_hz: float, count: int) -> dict[str, Any]:
    """Return round-trip times of source, relay, sink, relay, source, one message after the other."""
    trips = RoundTrips()
    async with relaying() as ends:
        there, back = ends.source.declare_publisher(THERE), ends.sink.declare_publisher(BACK)

        def echo(sample: zenoh.Sample) -> None:
            back.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

        readers = (
            ends.sink.declare_subscriber(THERE, Callback(echo, indirect=False)),
            ends.source.declare_subscriber(BACK, Callback(trips.on_return, indirect=False)),
        )

        def send() -> None:
            there.put(PAYLOAD, attachment=ATTACHMENT)

        await asyncio.sleep(SETTLE_S)
        result = await trips.measure(send, rate_hz, count)
        for reader in readers:
            reader.undeclare()
    return result


def main(source: str, session: str) -> None:
    """Relay until terminated."""
    near, far = opened(connect=source), opened(connect=session)
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
