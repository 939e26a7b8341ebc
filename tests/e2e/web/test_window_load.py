"""A page that is stuck, and many pages: neither costs the others anything."""

import asyncio
import time

import msgpack
import psutil
import pytest
from playwright.async_api import Browser

from pointit.bridges.web.wire import IN_FLIGHT
from pointit.launch.run.score import Latency
from pointit.schemas.topics import CURSOR, STRIPS_FRAME
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import Window
from tests.support.bare_pages import elsewhere
from tests.support.bench import until
from tests.support.commands import Onlooker, onlooker
from tests.support.pace import Patience, within

pytestmark = pytest.mark.slow

STUCK_MS = 5000
STUCK = (
    "(() => { const [began, since] = [Date.now(), performance.now()]; "
    f"while (performance.now() - since < {STUCK_MS}); return began; }})()"
)
"""Does nothing for this long. Returns its start, Unix ms."""
MOST_GROWN_BYTES = 12e6
PAGES = 50
LOOK_S = 14.0
LIGHT_S = 8.0
LONGEST_GAP_S = 3.0
"""A page gets something new so often at least, on a machine that does ten other things."""
SAMPLES = 60
MOST_TIMES = 2.0
SLACK_MS = 15.0
"""Variation of the 99th percentile on a busy machine."""


async def test_a_stuck_page_gets_the_newest_at_once_and_nothing_old(browser: Browser, site: SitePage) -> None:
    window = await Window.open(browser, site.url)
    await window.is_shown()
    await window.page.wait_for_timeout(2000)
    server = psutil.Process(site.command.process.pid)
    grown_bytes = -server.memory_info().rss
    window.keeps_batches = True
    stuck_ns = await window.page.evaluate(STUCK) * 1e6
    free_ns = time.time_ns()
    grown_bytes += server.memory_info().rss
    patience = Patience(30)
    while True:
        sent_ns = [msgpack.unpackb(batch)[1] for batch in window.batches]
        if sent_ns and sent_ns[-1] >= free_ns:
            break
        assert not patience.is_over(), "nothing new after it was stuck"
        await asyncio.sleep(0.01)
    came_s = (time.time_ns() - free_ns) / 1e9
    # sent in the midst of it; a batch's own time may pass at either end
    stale = [at_ns for at_ns in sent_ns if stuck_ns <= at_ns < free_ns - 300e6]
    assert len(stale) <= IN_FLIGHT, [(at_ns - free_ns) / 1e9 for at_ns in stale]
    assert within(came_s, 3.0)
    assert grown_bytes < MOST_GROWN_BYTES
    assert await window.page.evaluate("window.pointit.site.traffic.dropped") == 0
    assert window.faults == []


async def light_p99_ms(seen: Onlooker) -> float:
    """Return the delay of the light behind the wrist, as an observer measures it for some seconds."""
    latency = Latency()
    subscriptions = (
        seen.bus.subscribe(CURSOR, lambda cursor, _user: latency.on_cursor(cursor)),
        seen.bus.subscribe(STRIPS_FRAME, lambda frame, _name: latency.on_frame(frame, time.time_ns(), 1.0)),
    )
    await asyncio.sleep(LIGHT_S)
    await until(lambda: latency.count >= SAMPLES, 5, f"{SAMPLES} cursors that are shown as light")
    for subscription in subscriptions:
        subscription.close()
    p99_ms = latency.quantiles_ms()["p99"]
    assert p99_ms is not None
    return p99_ms


@pytest.mark.long
async def test_fifty_pages_all_get_frames_and_the_light_is_as_fast(site: SitePage) -> None:
    async with onlooker(site.endpoint) as seen:
        await seen.sees_more(seen.cursors["user1"], "cursors")
        alone_ms = await light_p99_ms(seen)
        looking = asyncio.create_task(elsewhere(site.url, PAGES, LOOK_S))
        await seen.hears("web")
        while not any(f.name == "viewers" and f.value == PAGES for f in seen.health["web"].figures):
            assert not looking.done(), "all have come at the same time"
            await asyncio.sleep(0.05)
        watched_ms = await light_p99_ms(seen)
        assert not looking.done(), "they still look on"
        pages = await looking
    assert len(pages) == PAGES
    longest_gap_s = max(page["longest_gap_s"] for page in pages)
    assert within(longest_gap_s, LONGEST_GAP_S)
    batches = sorted(page["batches"] for page in pages)
    assert batches[0] > 0.5 * batches[-1], "nobody starves"
    assert all(page["latencies_ms"] for page in pages)
    assert watched_ms < MOST_TIMES * alone_ms + SLACK_MS, (alone_ms, watched_ms)
