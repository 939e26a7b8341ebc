"""Makes the pictures of the page, `docs/pictures/window-*.webp` and `plan-editor.webp`, from runs.

`python -m docs.pictures.page` needs the tests' dependencies (`scripts/test` once) and Chromium. Without a
graphics processor it is slow, but the quality is the same.
"""

import asyncio
import base64
import json
import sys
import tempfile
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from playwright.async_api import Browser, Page, expect

from tests.e2e.web.phone import PhonePage
from tests.e2e.web.site import SitePage, running
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.browser import chromium, installed
from tests.support.commands import Commands, Onlooker, onlooker

HERE = Path(__file__).parent
SIZE = (1280, 800)
QUALITY = 88
MOST_BYTES = 250_000
SPEED = "0.25"
"""Speed of the site: slow, because the scene must not change while a picture is rendered."""
DWELL_S = 3.0
"""Dwell time, long enough for a slow picture."""
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
"""Makes the page draw with shadows and all pixels despite a slow renderer, and exposes its socket."""
ROOM = """\
lamps:
  door: {position: [0.2, 1.5, 2.0]}
  window: {position: [3.8, 0.6, 1.4]}
  desk: {position: [2.0, 2.4, 0.9]}
strips:
  shelf: {line: [[1.0, 3.0, 1.2], [3.0, 3.0, 1.2]], pixels: 120}
  side: {line: [[4.0, 1.0, 1.0], [4.0, 2.5, 1.0]], pixels: 90, direction: -1}
boxes: {table: {center: [1.0, 1.0, 0.4], size: [1.2, 0.7, 0.8], yaw_deg: 20}}
planes:
  back: {center: [2, 3, 1.25], normal: [0, -1, 0], size: [4, 2.5]}
  right: {center: [4, 1.5, 1.25], normal: [-1, 0, 0], size: [3, 2.5]}
things: {radio: {center: [2.8, 2.6, 1.4], size: [0.4, 0.3, 0.2], mode: switch}}
"""
SHOWS_GAUGE = """(() => {
  const value = document.querySelector("#guide progress[data-shown]")?.value ?? 0;
  const text = document.querySelector("#guide").textContent;
  return text.includes("Red package: stay on it") && value > 0.15 && value < 0.6;
})()"""
SHOWS_SELECTING = """[...window.pointit.site.people.values()].some(
  ({ hover }) => hover?.action === "select" && hover.progress > 0.25 && hover.progress < 0.6)"""


async def photograph() -> None:
    """Take all pictures."""
    expect.set_options(timeout=60_000)
    path = installed()
    if path is None:
        raise SystemExit("Chromium is not in PATH")
    async with chromium(path) as browser:
        async with run("--users", "1") as site, onlooker(site.endpoint) as seen:
            await by_mouse(browser, site, seen)
            await by_phone(browser, site)
        async with run("--users", "2") as site:
            await two_people(browser, site)
        await plan_editor(browser)


@asynccontextmanager
async def run(*arguments: str) -> AsyncGenerator[SitePage]:
    """Yield a running site."""
    with tempfile.TemporaryDirectory() as folder:
        commands = Commands(Path(folder))
        state = Path(folder) / "state"
        try:
            site = await running(commands, *ARGUMENTS, *arguments, "--set", "web.lan_port=0", state=state)
            async with onlooker(site.endpoint) as seen, site.operator() as operator:
                await seen.hears("selector")
                await operator.ask(key="selector/method", query={"dwell_s": DWELL_S})
            yield site
        finally:
            commands.kill_all()


async def plan_editor(browser: Browser) -> None:
    """Take the plan editor's picture: a strip on its wall, and a lamp that was moved below the floor."""
    with tempfile.TemporaryDirectory() as folder:
        commands = Commands(Path(folder))
        path = Path(folder) / "my_room.yaml"
        path.write_text(ROOM, encoding="utf-8")
        try:
            arguments = ("scenario_2", "--set", f"pui.map={path}", "--pose", "2,0.8")
            site = await running(commands, *arguments, state=Path(folder) / "state")
            window = await Window.open(browser, site.url, size=SIZE, theme="light", scripts=(NO_WEBGL,))
            await window.page.get_by_role("tab", name="Set up").click()
            await window.page.get_by_role("button", name="Edit the map").click()
            await window.page.get_by_role("button", name="Lamp desk").focus()
            for _ in range(10):
                await window.page.keyboard.press("Shift+PageDown")
            await expect(window.page.get_by_text("below the floor")).to_be_visible()
            await window.page.get_by_role("button", name="Strip shelf").focus()
            await save(window.page, "plan-editor.webp")
            await window.page.context.close()
        finally:
            commands.kill_all()


async def by_mouse(browser: Browser, site: SitePage, seen: Onlooker) -> None:
    """Take the light picture: the mouse selects a red package."""
    window = await Window.open(browser, site.url, size=SIZE, theme="light", scripts=(FINE,))
    await window.is_shown(60)
    await window.page.get_by_role("button", name="Point with the mouse").click()
    await expect(window.page.locator("#guide")).to_contain_text("You are the arm now")
    await window.page.wait_for_timeout(3000)  # no traces of the simulated person are left
    async with asyncio.timeout(180):
        while not await window.page.evaluate(SHOWS_GAUGE):
            if red := [each for each in seen.objects[-1].objects if each.kind == "red"]:
                aim = {"kind": "aim", "user": "user1", "at_m": red[0].position_m}
                await window.page.evaluate(f"window.socket.send({json.dumps(json.dumps(aim))})")
            await asyncio.sleep(0.02)
    await save(window.page, "window-light.webp")
    await window.page.context.close()


async def two_people(browser: Browser, site: SitePage) -> None:
    """Take the dark picture: two simulated people, one of them half-way through a selection."""
    window = await Window.open(browser, site.url, size=SIZE, theme="dark", scripts=(FINE,))
    await window.is_shown(60)
    await window.page.wait_for_timeout(3000)
    await window.until(SHOWS_SELECTING, "a selection", 180)
    await save(window.page, "window-dark.webp")
    await window.page.context.close()


async def by_phone(browser: Browser, site: SitePage) -> None:
    """Take the phone's picture while a person points with it."""
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


async def save(page: Page, name: str, scale: int = 1) -> None:
    """Write a screenshot of the page, with `scale` pixels per CSS pixel."""
    clip = {"x": 0, "y": 0, **(page.viewport_size or {}), "scale": scale}
    cdp: Any = await page.context.new_cdp_session(page)
    shot = await cdp.send("Page.captureScreenshot", {"format": "webp", "quality": QUALITY, "clip": clip})
    content = base64.b64decode(shot["data"])
    if len(content) > MOST_BYTES:
        raise SystemExit(f"{name} has {len(content)} bytes, too many for a README")
    (HERE / name).write_bytes(content)
    sys.stdout.write(f"{name}: {len(content) / 1e3:.0f} kB\n")


if __name__ == "__main__":
    asyncio.run(photograph())
