"""Makes the README's pictures of the page, `docs/window-*.webp`, from a run: `python -m docs.picture_page`.

It needs what the tests need (`scripts/test` once) and Chromium. A machine without a graphics processor draws
as slowly as it must, in the quality of one that has it.
"""

import asyncio
import base64
import json
import sys
import tempfile
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from playwright.async_api import Browser, Page, expect

from pointit.schemas import Hover
from pointit.schemas.topics import HOVER
from tests.e2e.web.phone import PhonePage
from tests.e2e.web.site import SitePage, running
from tests.e2e.web.window import Window
from tests.support.bench import until
from tests.support.browser import chromium, installed
from tests.support.commands import Commands, Onlooker, onlooker

HERE = Path(__file__).parent
SIZE = (1280, 800)
QUALITY = 88
MOST_BYTES = 250_000
SPEED = "0.25"
"""Of the site: a picture takes its time here, and what it shows should still be so when it is done."""
ARGUMENTS = ("scenario_4", "--seed", "3", "--speed", SPEED, "--duration", "900", "--lan")
FINE = """
for (const kind of [WebGL2RenderingContext]) {
  const asked = kind.prototype.getParameter;
  kind.prototype.getParameter = function (name) {
    return name === 0x9246 || name === 0x1f01 ? "of a picture" : asked.call(this, name);
  };
}
const Socket = window.WebSocket;
window.WebSocket = class extends Socket { constructor(...all) { super(...all); window.socket = this; } };
Object.defineProperty(document, "hidden", { get: () => true });  // who is not seen may be slow
"""
"""Has the page draw with shadows and all pixels, slow as it is; where its mouse points it is told, then."""


async def photograph() -> None:
    """Take all pictures."""
    expect.set_options(timeout=60_000)
    path = installed()
    if path is None:
        raise SystemExit("there is no Chromium in PATH")
    async with chromium(path) as browser:
        async with run("--users", "1") as site, onlooker(site.endpoint) as seen:
            await by_mouse(browser, site, seen)
            await by_phone(browser, site)
        async with run("--users", "2") as site, onlooker(site.endpoint) as seen:
            await two_people(browser, site, seen)


@asynccontextmanager
async def run(*arguments: str) -> AsyncGenerator[SitePage]:
    """Yield a running site."""
    with tempfile.TemporaryDirectory() as folder:
        commands, state = Commands(Path(folder)), Path(folder) / "state"
        try:
            yield await running(commands, *ARGUMENTS, *arguments, "--set", "web.lan_port=0", state=state)
        finally:
            commands.kill_all()


async def by_mouse(browser: Browser, site: SitePage, seen: Onlooker) -> None:
    """Light: the mouse selects a red package."""
    window = await Window.open(browser, site.url, size=SIZE, theme="light", scripts=(FINE,))
    await window.is_shown(60)
    await window.page.get_by_role("button", name="Point with the mouse").click()
    await expect(window.page.locator("#guide")).to_contain_text("You are the arm now")
    is_time = half_way(seen, "user1")
    async with asyncio.timeout(180):
        while not is_time():
            if red := [each for each in seen.objects[-1].objects if each.kind == "red"]:
                aim = {"kind": "aim", "user": "user1", "at_m": red[0].position_m}
                await window.page.evaluate(f"window.socket.send({json.dumps(json.dumps(aim))})")
            await asyncio.sleep(0.05)
    await save(window.page, "window-light.webp")
    await window.page.context.close()


async def two_people(browser: Browser, site: SitePage, seen: Onlooker) -> None:
    """Dark: two simulated people, one of them half-way through a selection."""
    window = await Window.open(browser, site.url, size=SIZE, theme="dark", scripts=(FINE,))
    await window.is_shown(60)
    await window.page.wait_for_timeout(3000)
    await until(half_way(seen, "user1", "user2"), 180, "a selection")
    await save(window.page, "window-dark.webp")
    await window.page.context.close()


async def by_phone(browser: Browser, site: SitePage) -> None:
    """The phone's page while somebody points with it."""
    async with site.operator() as operator:
        secure = await operator.pair("user1")
    url = site.origin + secure[secure.index("/phone") :]
    phone = await PhonePage.open(browser, url, color_scheme="dark")
    await phone.start(yaw_deg=10.0)
    await phone.page.get_by_role("button", name="Skip").tap()
    await expect(phone.page.locator("#state")).to_have_text("Pointing", timeout=60_000)
    await phone.page.wait_for_timeout(1500)
    await save(phone.page, "window-phone.webp", scale=2)
    await phone.page.context.close()


def half_way(seen: Onlooker, *users: str) -> Callable[[], bool]:
    """Return what tells whether one of `users` is in the midst of selecting something red."""
    newest: dict[str, Hover] = {}
    seen.bus.subscribe(HOVER, lambda hover, user: newest.__setitem__(user, hover))

    def is_half_way(hover: Hover) -> bool:
        kinds = {thing.id: thing.kind for thing in seen.objects[-1].objects}
        return kinds.get(hover.object_id) == "red" and hover.action == "select" and 0.3 < hover.progress < 0.6

    return lambda: (
        bool(seen.objects) and any(is_half_way(hover) for user, hover in newest.items() if user in users)
    )


async def save(page: Page, name: str, scale: int = 1) -> None:
    """Write what the page shows now, with so many pixels for one of the page's."""
    clip = {"x": 0, "y": 0, **(page.viewport_size or {}), "scale": scale}
    cdp: Any = await page.context.new_cdp_session(page)
    shot = await cdp.send("Page.captureScreenshot", {"format": "webp", "quality": QUALITY, "clip": clip})
    content = base64.b64decode(shot["data"])
    if len(content) > MOST_BYTES:
        raise SystemExit(f"{name} has {len(content)} bytes, which is too much for a README")
    (HERE / name).write_bytes(content)
    sys.stdout.write(f"{name}: {len(content) / 1e3:.0f} kB\n")


if __name__ == "__main__":
    asyncio.run(photograph())
