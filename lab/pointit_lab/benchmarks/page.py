"""The page: latency, CPU cost for the run, and network traffic per client."""

import asyncio
import json
import statistics
import tempfile
import time
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import psutil
from playwright.async_api import Page

from pointit.launch.run.monitor import Latency
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import CURSOR, STRIPS_FRAME
from pointit_lab.benchmarks.statistics import machine
from tests.e2e.web.site import SitePage, running
from tests.support.bare_pages import elsewhere
from tests.support.browser import chromium, installed
from tests.support.buses import free_port
from tests.support.commands import Commands

SCENARIO = "scenario_4"
CLIENTS = (1, 10, 50)
WARM_S = 8.0
"""Warm-up of a page, which compiles its shaders and loads everything."""
SETTLE_S = 2.0
MIN_S = 10.0
"""Minimum duration: people point with pauses, so a shorter one has too few captures."""
NO_LIMIT_S = "3600"


async def measure(duration_s: float) -> dict[str, Any]:
    """Return latency, cost and traffic of the page of a running scenario, alternating with the baselines."""
    with tempfile.TemporaryDirectory() as folder, started(Path(folder)) as commands:
        alone = await without_page(commands, duration_s)
        site = await running(commands, SCENARIO, "--duration", NO_LIMIT_S)
        await asyncio.sleep(WARM_S)
        result: dict[str, Any] = {
            "scenario": SCENARIO,
            "duration_s": duration_s,
            "without_page": alone,
            "nobody_looks_on": await watched(site, duration_s),
            "clients": [await clients(site, count, duration_s) for count in CLIENTS],
            "nobody_looks_on_again": await watched(site, duration_s),
        }
        if (path := installed()) is not None:
            result["browser"] = [
                await browser(site, path, duration_s, view=view) for view in ("scene", "plan")
            ]
    idle = statistics.fmean(
        result[name]["cpu_share_of_a_core"] for name in ("nobody_looks_on", "nobody_looks_on_again")
    )
    without = result["without_page"]["cpu_share_of_a_core"]
    for row in (*result["clients"], *result.get("browser", [])):
        row["cost_of_page"] = round(row["cpu_share_of_a_core"] - without, 4)
        row["cost_of_clients"] = round(row["cpu_share_of_a_core"] - idle, 4)
    return result


@contextmanager
def started(folder: Path) -> Generator[Commands]:
    """Yield a starter of commands, which end on exit."""
    commands = Commands(folder)
    try:
        yield commands
    finally:
        commands.kill_all()


async def without_page(commands: Commands, duration_s: float) -> dict[str, Any]:
    """Measure the run without a page."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = commands.start(
        "run", SCENARIO, "--no-web", "--no-view", "--listen", endpoint, "--duration", NO_LIMIT_S
    )
    site = SitePage(command=command, endpoint=endpoint, url="")
    await asyncio.sleep(WARM_S)
    result = await watched(site, duration_s)
    await command.stop()
    return result


async def watched(site: SitePage, duration_s: float) -> dict[str, Any]:
    """Return the CPU share of the run during `duration_s`, and the latency from wrist to light."""
    process = psutil.Process(site.command.process.pid)
    async with light(site.endpoint) as latency:
        cpu_s, wall_s = sum(process.cpu_times()[:2]), time.monotonic()
        await asyncio.sleep(duration_s)
        cpu_s, wall_s = sum(process.cpu_times()[:2]) - cpu_s, time.monotonic() - wall_s
    return {
        "cpu_share_of_a_core": round(cpu_s / wall_s, 4),
        "wrist_to_light_ms": {**latency.quantiles_ms(), "count": latency.count},
        "load_average": machine()["load_average"][0],
    }


@asynccontextmanager
async def light(endpoint: str) -> AsyncGenerator[Latency]:
    """Yield the times from wrist to light, updated by an observer on the bus."""
    bus = await ZenohBus.open(Link(connect=(endpoint,)))
    latency = Latency()
    try:
        bus.subscribe(CURSOR, lambda cursor, _user: latency.on_cursor(cursor))
        bus.subscribe(STRIPS_FRAME, lambda frame, _name: latency.on_frame(frame, time.time_ns(), 1.0))
        yield latency
    finally:
        await bus.close()


async def clients(site: SitePage, count: int, duration_s: float) -> dict[str, Any]:
    """Measure with `count` bare websocket clients that acknowledge at once, in a separate process."""
    looking = asyncio.create_task(elsewhere(site.url, count, duration_s + 2 * SETTLE_S))
    await asyncio.sleep(SETTLE_S)
    result = await watched(site, duration_s)
    pages = await looking
    seconds = duration_s + 2 * SETTLE_S
    return {
        "clients": count,
        **result,
        "capture_to_client_ms": quantiles([value for page in pages for value in page["latencies_ms"]]),
        "batches_per_s": round(statistics.fmean(page["batches"] for page in pages) / seconds, 1),
        "kbytes_per_s_each": round(statistics.fmean(page["bytes"] for page in pages) / seconds / 1e3, 1),
        "wire_kbytes_per_s_each": round(
            statistics.fmean(page["wire_bytes"] for page in pages) / seconds / 1e3, 1
        ),
        "longest_gap_s": round(max(page["longest_gap_s"] for page in pages), 3),
    }


async def browser(site: SitePage, path: str, duration_s: float, *, view: str) -> dict[str, Any]:
    """Measure with one page in this machine's browser, with the latency that the page itself finds."""
    async with chromium(path) as opened:
        page = await (await opened.new_context(viewport={"width": 1280, "height": 800})).new_page()
        await page.add_init_script(f"localStorage.setItem('pointit', '{{\"view\":\"{view}\"}}')")
        latencies: list[float] = []

        def on_sent(payload: str | bytes) -> None:
            message = json.loads(payload)
            if message["kind"] == "ack" and message["latency_ms"] is not None:
                latencies.append(message["latency_ms"])

        page.on("websocket", lambda socket: socket.on("framesent", on_sent))
        await page.goto(site.url)
        await asyncio.sleep(WARM_S)
        latencies.clear()
        cpu_s, began_s = browser_cpu_s(), time.monotonic()
        frames = asyncio.create_task(frame_rates(page, duration_s))
        result = await watched(site, duration_s)
        cpu_s, wall_s = browser_cpu_s() - cpu_s, time.monotonic() - began_s
        fps = await frames
        stats = await page.evaluate("window.pointit.stats")
        traffic = await page.evaluate("window.pointit.site.traffic")
    return {
        "view": view,
        "renderer": stats["renderer"],
        "software": stats["software"],
        **result,
        "capture_to_frame_ms": quantiles(latencies),
        "fps": round(statistics.fmean(fps), 1),
        "browser_cpu_share_of_a_core": round(cpu_s / wall_s, 3),
        "browser_cpu_ms_per_frame": round(cpu_s / wall_s / max(statistics.fmean(fps), 0.1) * 1e3, 1),
        "kbytes_per_s": round(traffic["bytes"] / 1e3, 1),
    }


async def frame_rates(page: Page, duration_s: float) -> list[float]:
    """Return the page's frames of each second."""
    rates: list[float] = []
    for _ in range(max(1, int(duration_s))):
        await asyncio.sleep(1.0)
        rates.append(float(await page.evaluate("window.pointit.stats.fps")))
    return rates


def browser_cpu_s() -> float:
    """Return the CPU time of all processes of the browser that this process has started, s."""
    total_s = 0.0
    for child in psutil.Process().children(recursive=True):
        try:
            if "chrom" in child.name():
                total_s += sum(child.cpu_times()[:2])
        except psutil.Error:
            continue
    return total_s


def quantiles(values_ms: list[float]) -> dict[str, float | int] | None:
    """Return median, 95th and 99th percentile and the number of values, or None without values."""
    if not values_ms:
        return None
    values = sorted(values_ms)
    last = len(values) - 1
    return {
        "p50": round(values[int(last * 0.50)], 2),
        "p95": round(values[int(last * 0.95)], 2),
        "p99": round(values[int(last * 0.99)], 2),
        "count": len(values),
    }
