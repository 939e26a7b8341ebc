"""Makes the README's animations, `docs/pictures/hero-*.webp`, from two recordings in the page.

`python -m docs.pictures.hero` needs what `docs.pictures.page` needs. People select packages at the paper's
conveyor, and one lands a quadrotor. Both are simulated in virtual time and drawn position by position: a slow
machine makes the same pictures.
"""

import asyncio
import base64
import io
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.async_api import Browser, Page, expect

from docs.pictures.page import FINE
from tests.e2e.web.window import Window
from tests.support.browser import chromium, installed
from tests.support.commands import Commands
from tests.support.links import link_in
from tests.support.recorded import session, write_recording

HERE = Path(__file__).parent
SIZE = (1600, 1000)
STEP_S = 0.125
"""Time between two pictures."""
SHOWN = (800, 440)
"""Size of the animation, pixels."""
MOST_BYTES = 3_000_000
ONLY_THE_SCENE = """() => document.head.append(Object.assign(document.createElement("style"), {textContent: `
  header, footer, #panel, #timeline, #guide, #chip, #stop, #toasts, .transport { visibility: hidden; }
`}))"""
POSITION_S = "(window.pointit.site.sentNs - window.pointit.site.timeline.began_ns) / 1e9"
SEEK = """(at_s) => {
  const slider = document.querySelector('input[aria-label="Position"]');
  slider.value = String(at_s);
  slider.dispatchEvent(new Event("input"));
}"""

CONVEYOR = (0.05, 0.0, 0.92)
ROBOTS = (0.12, 0.17, 0.54)


@dataclass(frozen=True)
class Take:
    """A part of a recorded session."""

    scenario: str
    users: tuple[str, ...]
    from_s: float
    to_s: float
    part: tuple[float, float, float]
    """Left, top and width of what is seen, as shares of the scene's width."""


TAKES = (
    Take("scenario_4", ("anna", "ben"), 4.25, 8.25, CONVEYOR),
    Take("scenario_4", ("anna", "ben"), 23.0, 26.5, CONVEYOR),
    Take("scenario_5", ("anna",), 2.0, 6.0, ROBOTS),
    Take("scenario_5", ("anna",), 21.5, 26.0, ROBOTS),
)


async def photograph() -> None:
    """Take all pictures and write them."""
    expect.set_options(timeout=60_000)
    path = installed()
    if path is None:
        raise SystemExit("Chromium is not in PATH")
    for theme in ("light", "dark"):
        pictures: list[Image.Image] = []
        async with chromium(path) as browser:
            for take in TAKES:
                pictures += await pictures_of(browser, take, theme)
        save(pictures, f"hero-{theme}.webp")


async def pictures_of(browser: Browser, take: Take, theme: Any) -> list[Image.Image]:
    """Return the pictures of `take`, one every `STEP_S`."""
    with tempfile.TemporaryDirectory() as folder:
        commands = Commands(Path(folder))
        file = Path(folder) / "session.mcap"
        write_recording(file, await asyncio.to_thread(session, take.scenario, take.to_s + 1.0, take.users))
        try:
            command = commands.start("page", str(file), "--port", "0", "--no-browser")
            await command.says("its link is in")
            window = await Window.open(browser, link_in(command.out), size=SIZE, theme=theme, scripts=(FINE,))
            await window.is_shown(60)
            await window.page.keyboard.press("Space")
            await window.page.evaluate(ONLY_THE_SCENE)
            taken: list[Image.Image] = []
            for step in range(round((take.to_s - take.from_s) / STEP_S)):
                at_s = take.from_s + step * STEP_S
                await window.page.evaluate(SEEK, at_s)
                await window.until(f"Math.abs({POSITION_S} - {at_s}) < {STEP_S / 4}", "it seeks")
                await window.page.wait_for_timeout(200)
                taken.append(await picture(window.page, take.part))
            await window.page.context.close()
            return taken
        finally:
            commands.kill_all()


async def picture(page: Page, part: tuple[float, float, float]) -> Image.Image:
    """Return the `part` of the scene."""
    box = await page.locator("#view").bounding_box()
    if box is None:
        raise SystemExit("the page has no scene")
    left, top, width = (box["width"] * each for each in part)
    shape = {"width": width, "height": width * SHOWN[1] / SHOWN[0]}
    clip = {"x": box["x"] + left, "y": box["y"] + top, **shape, "scale": 1}
    cdp: Any = await page.context.new_cdp_session(page)
    shot = await cdp.send("Page.captureScreenshot", {"format": "png", "clip": clip})
    image = Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB")
    return image.resize(SHOWN, Image.Resampling.LANCZOS)


def save(pictures: list[Image.Image], name: str) -> None:
    """Write an animation that repeats."""
    first, *others = pictures
    content = io.BytesIO()
    options = {"duration": round(1000 * STEP_S), "loop": 0, "quality": 60, "method": 6}
    first.save(content, "WEBP", save_all=True, append_images=others, **options)
    if content.tell() > MOST_BYTES:
        raise SystemExit(f"{name} has {content.tell()} bytes, too many for a README")
    (HERE / name).write_bytes(content.getvalue())
    sys.stdout.write(f"{name}: {content.tell() / 1e3:.0f} kB, {len(pictures)} pictures\n")


if __name__ == "__main__":
    asyncio.run(photograph())
