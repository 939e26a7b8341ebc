"""The baseline: a chain of Zenoh hops and nothing else, driven at the same rate as ours.

Each hop forwards 200 bytes; the payload carries the time of the first put. `direct` runs the callback on
Zenoh's own thread (the minimum), `default` as in Zenoh's documentation, with a thread per subscriber.
"""

import asyncio
import json
import os
import struct
import sys
import time
from collections.abc import Callable
from typing import Any, Literal

import zenoh
from zenoh.handlers import Callback

PAYLOAD_BYTES = 200
KEY = "bare/{}"
CallbackKind = Literal["direct", "default"]
ENVIRONMENT = dict(os.environ)
"""The environment before our bus chooses Zenoh's threads in it: bare processes have those of the user."""


def opened(*, listen: str = "", connect: str = "", mode: str = "") -> zenoh.Session:
    """Open a session with the settings of our own ones, without a namespace."""
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": mode or ("client" if connect else "peer"),
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
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
    subscribe(session, hop, lambda sample: publisher.put(sample.payload.to_bytes()), kind)


def subscribe(
    session: zenoh.Session, hop: int, callback: Callable[[zenoh.Sample], None], kind: CallbackKind
) -> None:
    """Call `callback` with samples of `hop`."""
    session.declare_subscriber(KEY.format(hop), Callback(callback, indirect=kind == "default"))


async def one_process(hops: int, rate_hz: float, duration_s: float, kind: CallbackKind) -> list[float]:
    """Return the times through `hops` hops in one session, seconds."""
    with opened() as session:
        return await _drive(session, hops, rate_hz, duration_s, kind)


async def processes(hops: int, rate_hz: float, duration_s: float, endpoint: str) -> list[float]:
    """Return the times when each hop is a process, all connected to this one, seconds."""
    with opened(listen=endpoint) as session:
        children = [
            await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "pointit_lab.benchmarks.bare_chain", endpoint, str(hop)),
                stdin=asyncio.subprocess.PIPE,
                env=ENVIRONMENT,
            )
            for hop in range(hops - 1)
        ]
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
        times_s.append((time.perf_counter_ns() - sent_ns) / 1e9)

    if forwards:
        for hop in range(hops - 1):
            forward(session, hop, kind)
    subscribe(session, hops - 1, arrive, kind)
    publisher = session.declare_publisher(KEY.format(0))
    await asyncio.sleep(0.3)
    loop = asyncio.get_running_loop()
    due_s = loop.time()
    end_s = due_s + duration_s
    while due_s < end_s:
        publisher.put(struct.pack("<q", time.perf_counter_ns()).ljust(PAYLOAD_BYTES, b"\0"))
        due_s += 1.0 / rate_hz
        await asyncio.sleep(max(0.0, due_s - loop.time()))
    await asyncio.sleep(0.1)
    return times_s


if __name__ == "__main__":
    with opened(connect=sys.argv[1]) as child_session:
        forward(child_session, int(sys.argv[2]), "direct")
        sys.stdin.read()
