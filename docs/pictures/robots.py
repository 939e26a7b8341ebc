"""Makes the pictures of a quadrotor and of an arm in the page, `robots.webp` and `arm.webp`.

`python -m docs.pictures.robots` needs what `docs.pictures.page` needs, and the package of `examples/arm`.
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
ARGUMENTS = ("--users", "1", "--seed", "3", "--speed", SPEED, "--duration", "900")
SHOWS_FLIGHT = """(() => {
  const { phase, user, position_m } = window.pointit.site.robots.get("quad")?.state ?? {};
  return Boolean(user) && phase === "moving" && position_m[2] > 0.15;
})()"""

SHOWS_HOLDING = """(() => {
  const { objects } = window.pointit.site.objects.get("arm") ?? { objects: [] };
  return objects.some(({ press, position_m }) => press && position_m[2] > 0.88);
})()"""


async def photograph(scenario: str, shows: str, picture: str) -> None:
    """Take a picture of a scenario as soon as the page `shows` it."""
    expect.set_options(timeout=60_000)
    path = installed()
    if path is None:
        raise SystemExit("Chromium is not in PATH")
    with tempfile.TemporaryDirectory() as folder:
        commands = Commands(Path(folder))
        try:
            site = await running(commands, scenario, *ARGUMENTS, state=Path(folder) / "state")
            async with chromium(path) as browser:
                window = await Window.open(browser, site.url, size=SIZE, theme="dark", scripts=(FINE,))
                await window.is_shown(60)
                await window.page.wait_for_timeout(3000)
                if await (card := window.page.get_by_role("button", name="Make it small")).is_visible():
                    await card.click()
                await window.until(shows, picture, 180)
                await save(window.page, picture)
        finally:
            commands.kill_all()


async def photograph_all() -> None:
    """Photograph both: one simulated person flies the quadrotor, another one has the arm take a box."""
    await photograph("scenario_5", SHOWS_FLIGHT, "robots.webp")
    await photograph("examples/arm/arm.yaml", SHOWS_HOLDING, "arm.webp")


if __name__ == "__main__":
    asyncio.run(photograph_all())
