"""The dashboard in a browser, beside the bridge that it reads."""

import pytest

from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.service import SERVICE
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.schemas import Hover, Selection, StripsFrame
from pointit.schemas.environment import StripFrame
from pointit.schemas.selection import SelectedObject
from pointit.schemas.topics import HOVER, SELECTION, STRIPS_FRAME
from tests.architecture.sources import ROOT
from tests.support.bench import Bench, until
from tests.support.browser import NAMES, chromium, installed
from tests.support.buses import free_port, is_listening

DASHBOARD = ROOT / "examples" / "dashboard"
PATIENCE_MS = 60_000


def test_dashboard_has_forty_lines() -> None:
    lines = (DASHBOARD / "dashboard.js").read_text(encoding="utf-8").splitlines()
    assert len([line for line in lines if line.strip() and not line.strip().startswith("//")]) <= 40


@pytest.mark.slow
async def test_dashboard_shows_light_people_and_selection() -> None:
    path = installed()
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is in PATH")
    bus = MemoryBus(LocalBroker())
    bench = Bench(bus, WallClock())
    port = free_port()
    bench.start(SERVICE, FoxgloveConfig(port=port))
    await until(lambda: is_listening(port), what="the bridge listens")
    bench.put(STRIPS_FRAME, StripsFrame(stamp_ns=1, strips=(StripFrame(id="s", rgb=b"\xff\x00\x00" * 10),)))
    bench.put(HOVER, Hover(stamp_ns=1, object_id="7", progress=0.5, action="select"), "anna")
    selected = SelectedObject(id="3", user="ben", since_ns=1, kind="red")
    bench.put(SELECTION, Selection(stamp_ns=1, objects=(selected,)))
    try:
        async with chromium(path) as browser:
            page = await browser.new_page()
            page.set_default_timeout(PATIENCE_MS)
            await page.goto(f"{(DASHBOARD / 'index.html').as_uri()}?at=ws://127.0.0.1:{port}")
            await page.get_by_text("ben: red 3").wait_for()
            await page.get_by_text("▰▰▰▰▰▱▱▱▱▱ select 7").wait_for()
            await page.locator("canvas").wait_for()
            color = "document.querySelector('canvas').getContext('2d').getImageData(9, 0, 1, 1).data.join()"
            assert await page.evaluate(color) == "255,0,0,255"
            assert await page.get_by_text("anna").get_attribute("title") == Hover.__doc__
    finally:
        await bench.stop()
        await bus.close()
