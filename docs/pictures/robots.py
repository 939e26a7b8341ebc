"""Makes the picture of robots in the page, `docs/pictures/robots.webp`: `python -m docs.pictures.robots`.

It needs what `docs.pictures.page` needs.
"""

import asyncio
import tempfile
from pathlib import Path

from playwright.async_api import expect

from docs.pictures.page import FINE, SPEED, save
from tests.e2e.web.site import running
from tests.e2e.web.window import Window
from tests.support.browser import chromium, installed
from tests.support.commands import Commands

SIZE = (1120, 700)
ARGUMENTS = ("scenario_5", "--users", "1", "--seed", "3", "--speed", SPEED, "--duration", "900")
SHOWS_FLIGHT = """(() => {
  const { phase, user, position_m } = window.pointit.site.robots.get("quad")?.state ?? {};
  return Boolean(user) && phase === "moving" && position_m[2] > 0.15;
})()"""


async def photograph() -> None:
    """Take the picture: a simulated person flies the quadrotor."""
    expect.set_options(timeout=60_000)
    path = installed()
    if path is None:
        raise SystemExit("Chromium is not in PATH")
    with tempfile.TemporaryDirectory() as folder:
        commands = Commands(Path(folder))
        try:
            site = await running(commands, *ARGUMENTS, state=Path(folder) / "state")
            async with chromium(path) as browser:
                window = await Window.open(browser, site.url, size=SIZE, theme="dark", scripts=(FINE,))
                await window.is_shown(60)
                await window.page.get_by_role("button", name="Make it small").click()
                await window.page.wait_for_timeout(3000)
                await window.until(SHOWS_FLIGHT, "a flight", 180)
                await save(window.page, "robots.webp")
        finally:
            commands.kill_all()


if __name__ == "__main__":
    asyncio.run(photograph())
