"""The baseline: Zenoh and nothing else, as a chain of hops driven at the same rate as ours, and as a relay.

Each hop forwards 200 bytes; the payload carries the time of the first put. `direct` runs the callback on
Zenoh's own thread (the minimum), `default` as in Zenoh's documentation, with a thread per subscriber. A relay
forwards bytes from one session to another: the lower bound of any bridge in Python.

As a program: `bare_zenoh ADDRESS HOP` is a hop of the chain, `bare_zenoh FROM TO` a relay, until it is ended.
"""

import asyncio
import contextlib
import json
import os
import socket
import struct
import sys
import time
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from typing import Any, Literal

import psutil
import zenoh
from zenoh.handlers import Callback

CallbackKind = Literal["direct", "default"]

PAYLOAD_BYTES = 200
KEY = "bare/{}"
ENVIRONMENT = dict(os.environ)
"""The environment before our bus chooses Zenoh's threads in it: bare processes have those of the user."""

TAIL_S = 0.2
"""Time for the last messages to arrive, s."""

THERE = "relayed"
BACK = "returned"
PAYLOAD = bytes(100)
ATTACHMENT = bytes(33)
READY_S = 20.0
SETTLE_S = 0.5


def free_endpoint() -> str:
    """Return a free address of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def opened(*, listen: str = "", connect: str = "", mode: str = "") -> zenoh.Session:
    """Open a session with the settings of our own ones, without a namespace."""
    config = zenoh.Config()
    default_mode = "client" if connect else "peer"
    listen_endpoints = [listen] if listen else []
    connect_endpoints = [connect] if connect else []
    settings: dict[str, Any] = {
        "mode": mode or default_mode,
        "listen/endpoints": listen_endpoints,
        "connect/endpoints": connect_endpoints,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    if not connect:
        settings["scouting/delay"] = 0
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def forward(session: zenoh.Session, hop: int, kind: CallbackKind) -> None:
    """Forward samples of `hop` to the next."""
    publisher = session.declare_publisher(KEY.format(hop + 1))

    def relay(sample: zenoh.Sample) -> None:
        publisher.put(sample.payload.to_bytes())

    subscribe(session, hop, relay, kind)


def subscribe(
    session: zenoh.Session, hop: int, callback: Callable[[zenoh.Sample], None], kind: CallbackKind
) -> None:
    """Call `callback` with samples of `hop`."""
    handler = Callback(callback, indirect=kind == "default")
    session.declare_subscriber(KEY.format(hop), handler)


async def one_process(hops: int, rate_hz: float, duration_s: float, kind: CallbackKind) -> list[float]:
    """Return the times through `hops` hops in one session, seconds."""
    with opened() as session:
        return await _drive(session, hops, rate_hz, duration_s, kind)


async def processes(hops: int, rate_hz: float, duration_s: float, endpoint: str) -> list[float]:
    """Return the times when each hop is a process, all connected to this one, seconds."""
    with opened(listen=endpoint) as session:
        children: list[asyncio.subprocess.Process] = []
        for hop in range(hops - 1):
            command = (sys.executable, "-m", "pointit_lab.benchmarks.bare_zenoh", endpoint, str(hop))
            child = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.PIPE, env=ENVIRONMENT
            )
            children.append(child)
        try:
            await asyncio.sleep(2.0)  # they import and connect
            return await _drive(session, hops, rate_hz, duration_s, "direct", forwards=False)
        finally:
            for child in children:
                child.kill()
                await child.wait()


async def _drive(
    session: zenoh.Session,
    hops: int,
    rate_hz: float,
    duration_s: float,
    kind: CallbackKind,
    *,
    forwards: bool = True,
) -> list[float]:
    times_s: list[float] = []

    def arrive(sample: zenoh.Sample) -> None:
        (sent_ns,) = struct.unpack_from("<q", sample.payload.to_bytes())
        age_ns = time.perf_counter_ns() - sent_ns
        times_s.append(age_ns / 1e9)

    # Hops in this session forward here. Otherwise each is a process that is connected already.
    if forwards:
        for hop in range(hops - 1):
            forward(session, hop, kind)
    subscribe(session, hops - 1, arrive, kind)
    publisher = session.declare_publisher(KEY.format(0))
    await asyncio.sleep(0.3)  # until the session knows who subscribes

    # Samples are due at fixed times: a late one does not delay the ones after it.
    loop = asyncio.get_running_loop()
    due_s = loop.time()
    end_s = due_s + duration_s
    while due_s < end_s:
        stamp = struct.pack("<q", time.perf_counter_ns())
        publisher.put(stamp.ljust(PAYLOAD_BYTES, b"\0"))
        due_s += 1.0 / rate_hz
        wait_s = due_s - loop.time()
        await asyncio.sleep(max(0.0, wait_s))
    await asyncio.sleep(0.1)
    return times_s


async def relay_cost(
    process: psutil.Process,
    put: Callable[[int], object],
    rate_hz: float,
    duration_s: float,
    *,
    per_turn: int = 1,
) -> tuple[int, dict[str, Any]]:
    """Return the number of messages that were put, and what they cost `process`.

    Args:
        process: the relay.
        put: publishes the messages of a turn. It is called with the number of the turn.
        rate_hz: turns per second.
        duration_s: duration of the measurement, s.
        per_turn: messages that `put` publishes.
    """
    before = process.cpu_times()
    start_s = time.perf_counter()
    loop = asyncio.get_running_loop()
    turn = 0
    due_s = loop.time()
    end_s = due_s + duration_s
    while due_s < end_s:
        put(turn)
        turn += 1
        # no larger bursts to catch up, in which only the newest message would be delivered
        due_s = max(due_s + 1.0 / rate_hz, loop.time())
        await asyncio.sleep(due_s - loop.time())
    after = process.cpu_times()
    took_s = time.perf_counter() - start_s
    await asyncio.sleep(TAIL_S)

    # of the relay alone: this process, which puts and reads, is not in it
    cpu_s = after.user + after.system - before.user - before.system
    messages = turn * per_turn
    us_per_message = None
    if messages:
        us_per_message = round(cpu_s / messages * 1e6, 1)
    figures = {
        "cpu_share_of_a_core": round(cpu_s / took_s, 4),
        "messages_per_second": round(messages / took_s, 1),
        "us_per_message": us_per_message,
    }
    return messages, figures


@dataclass(frozen=True)
class RelayEnds:
    """Both ends of a relay, and its process."""

    source: zenoh.Session
    sink: zenoh.Session
    process: psutil.Process


@contextlib.asynccontextmanager
async def relaying() -> AsyncGenerator[RelayEnds]:
    """Yield the ends of a relay that has started."""
    source_endpoint = free_endpoint()
    sink_endpoint = free_endpoint()
    source = opened(listen=source_endpoint, mode="router")
    session = opened(listen=sink_endpoint, mode="router")
    command = (sys.executable, "-m", "pointit_lab.benchmarks.bare_zenoh", source_endpoint, sink_endpoint)
    child = await asyncio.create_subprocess_exec(*command)
    samples: list[zenoh.Sample] = []
    try:
        # It is ready when a sample has come through, there and back.
        for sender, receiver, key in ((source, session, THERE), (session, source, BACK)):
            handler = Callback(samples.append, indirect=False)
            reader = receiver.declare_subscriber(key, handler)
            async with asyncio.timeout(READY_S):
                while not samples:
                    sender.put(key, PAYLOAD, attachment=ATTACHMENT)
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


async def measure_relay(rate_hz: float, duration_s: float) -> dict[str, Any]:
    """Return the CPU share and losses of the relay."""
    samples: list[zenoh.Sample] = []
    async with relaying() as ends:
        publisher = ends.source.declare_publisher(THERE)
        handler = Callback(samples.append, indirect=False)
        reader = ends.sink.declare_subscriber(THERE, handler)
        await asyncio.sleep(SETTLE_S)

        def put(_turn: int) -> None:
            publisher.put(PAYLOAD, attachment=ATTACHMENT)

        count, figures = await relay_cost(ends.process, put, rate_hz, duration_s)
        reader.undeclare()
    return {**figures, "lost": count - len(samples)}


def relay_until_terminated(source: str, session: str) -> None:
    """Forward both ways between the sessions at two addresses."""
    source_session = opened(connect=source)
    sink_session = opened(connect=session)
    forward_publisher = sink_session.declare_publisher(THERE)
    return_publisher = source_session.declare_publisher(BACK)

    def relay_forward(sample: zenoh.Sample) -> None:
        forward_publisher.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

    def relay_back(sample: zenoh.Sample) -> None:
        return_publisher.put(sample.payload.to_bytes(), attachment=ATTACHMENT)

    # the readers end with their references
    reader = source_session.declare_subscriber(THERE, Callback(relay_forward, indirect=False))
    return_reader = sink_session.declare_subscriber(BACK, Callback(relay_back, indirect=False))
    readers = (reader, return_reader)
    while readers:
        time.sleep(3600.0)


if __name__ == "__main__":
    endpoint, hop_or_endpoint = sys.argv[1:]
    if hop_or_endpoint.isdigit():
        with opened(connect=endpoint) as child_session:
            forward(child_session, int(hop_or_endpoint), "direct")
            sys.stdin.read()
    else:
        relay_until_terminated(endpoint, hop_or_endpoint)
