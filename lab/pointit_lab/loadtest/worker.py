"""A process of a load test: runs the requested services, and drives wrists on request.

Requests are lines of JSON on standard input, replies lines of JSON. It ends with its input.
"""

import asyncio
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from pointit.runtime.clock import WallClock
from pointit.runtime.config.config import Layers
from pointit.runtime.link.link import VARIABLE, Link, read_credentials
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import run_program, run_until_shutdown
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import IMU
from pointit.services import registry
from pointit_lab.loadtest.sight import DRAIN_S, LoadTestReceiver
from pointit_lab.loadtest.usage import read_usage
from pointit_lab.loadtest.wrist import LoadTestWrist, drive_wrists

TIMEOUT_S = 10.0


def _launch(dumped: Mapping[str, Any]) -> Launch:
    service = registry.process(dumped["service"]).load()
    layers = Layers()
    layers.add(dumped["config"], "load test")
    config = layers.build(service.CONFIG)
    return Launch(service=service, config=config, user=dumped["user"], name=dumped["name"])


def _reply(message: Mapping[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


async def _open_bus(site: str, endpoint: str) -> ZenohBus:
    """Join the site at `endpoint`, with the credentials of the environment if there are any."""
    folder = os.environ.get(VARIABLE)
    credentials = None
    if folder:
        credentials = read_credentials(Path(folder), _now())
    link = Link(site=site, connect=(endpoint,), credentials=credentials)
    return await ZenohBus.open(link, patience_s=TIMEOUT_S)


async def _work() -> int:
    reader = asyncio.StreamReader(limit=64 * 1024 * 1024)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    task = json.loads(await reader.readline())
    bus = await _open_bus(task["site"], task["connect"])

    # If the services end, so does the loop of orders below.
    launches = [_launch(dumped) for dumped in task["launches"]]
    services = asyncio.create_task(run_services(launches, bus, WallClock()))
    if launches:  # else it drives wrists alone
        services.add_done_callback(lambda _: reader.feed_eof())
    try:
        wrists: list[LoadTestWrist] = []
        for index, user in enumerate(task["wrists"]):
            publisher = bus.publisher(IMU, user)
            wrists.append(LoadTestWrist(publisher, index))
        sight = LoadTestReceiver(frozenset(task["watched"]))
        sight.watch(bus, alone=True)
        if task["watches_light"]:
            sight.watch_light(bus)
            sight.watch_arrivals(bus)
        while line := await reader.readline():
            order = json.loads(line)
            if not order:  # it asks for the poses
                await sight.until_poses(services)
                _reply({})
                continue
            sight.clear()
            usage = await _drive(wrists, order["rate_hz"], order["duration_s"])
            # Only an observer waits for what still travels. The usage is without that time.
            is_observer = task["watched"] or task["watches_light"]
            await asyncio.sleep(DRAIN_S if is_observer else 0.0)
            _reply({**usage, "sight": sight.dump()})
        if services.done():
            services.result()
    finally:
        services.cancel()
        await asyncio.wait({services})
        await bus.close()
    return 0


async def _drive(wrists: Sequence[LoadTestWrist], rate_hz: float, duration_s: float) -> dict[str, Any]:
    """Drive the wrists. Return the time that it lasted, the samples, and the usage of this process."""
    before = read_usage()
    sent_before = sum(wrist.sent for wrist in wrists)
    start_s = time.monotonic()
    await drive_wrists(wrists, rate_hz, duration_s)
    lasted_s = time.monotonic() - start_s
    after = read_usage()
    sent = sum(wrist.sent for wrist in wrists) - sent_before
    cpu_s = 0.0
    if before and after:
        cpu_s = after.cpu_s - before.cpu_s
    memory_mb = after.memory_mb if after else 0.0
    return {"lasted_s": lasted_s, "sent": sent, "cpu_s": cpu_s, "memory_mb": memory_mb}


def _now() -> Any:
    import datetime as dt  # noqa: PLC0415 - only where there are credentials

    return dt.datetime.now(dt.UTC)


@click.command()
def command() -> int:
    """Process of a load test. `pointit load` starts it."""
    setup_logging("warning")
    return run_until_shutdown(_work())


if __name__ == "__main__":
    run_program(command)
