"""Every scenario on the page, one after the other as its menu offers them: pictures that show something.

No alarm is raised meanwhile, nothing restarts by accident, and the end of the run is no lost connection.

`POINTIT_SHOTS=FOLDER` keeps the pictures, to be looked at.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.typing import NDArray
from playwright.async_api import Browser, Page, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import TOLD, Window
from tests.support.pace import Patience

pytestmark = [pytest.mark.slow, pytest.mark.long]

SCENARIOS = {
    "scenario_4": "Conveyor: select the red packages",
    "scenario_1": "Lamps: point at them",
    "scenario_2": "Strips: move the cursor",
    "scenario_3": "Strips: select the red segments",
}
"""In the order of execution, with the page's titles."""

WAY_MS = 1000
"""The camera's way to the new room."""
LOOK_S = 10.0
LOOK_EVERY_MS = 400
SCENE_ONLY = """hidden => {
  for (const each of document.querySelector("#view canvas").parentElement.children) {
    if (each.tagName !== "CANVAS") each.style.visibility = hidden ? "hidden" : "";
  }
}"""
"""Hides overlays of the scene, such as names: their text is white, whatever the scene shows."""
LIT = """() => {
  const { site } = window.pointit;
  const strips = site.strips?.strips ?? [];
  const lit = strips.reduce((sum, { rgb }) => sum + rgb.reduce((n, v) => n + (v > 60), 0), 0);
  const lamps = [...site.lamps.values()].filter(({ color }) => Math.max(...color) > 60).length;
  const objects = [...site.objects.values()].flatMap((each) => each.objects).length;
  return { lit, lamps, objects, people: site.people.size };
}"""


ALARMS = """
window.alarms = [];
document.addEventListener("DOMContentLoaded", () => new MutationObserver(() => {
  const bad = /gone together|Nobody is here|do not move|lost/;
  const all = [...document.querySelectorAll("[role=alert], #panel p")].filter((each) => each.offsetHeight);
  const shown = all.map((each) => each.textContent).filter((text) => bad.test(text));
  for (const text of shown) if (!window.alarms.includes(text)) window.alarms.push(text);
}).observe(document.body, { childList: true, subtree: true, attributeFilter: ["hidden"] }));
"""
"""Keeps alarms that the page has ever shown."""


@dataclass(frozen=True)
class Picture:
    colors: int
    """Different ones, of 4096."""
    contrast: float
    """Standard deviation of luminance, 0 to 1."""
    strong: int
    """Pixels of a strong colour: lamps, packages, segments."""
    white: int
    """Pixels of a white light, or of a person's shirt; not full white: on a slow machine the page draws fewer
    pixels, which the browser enlarges and so blurs."""

    @classmethod
    def of(cls, path: Path, box: tuple[float, float, float, float]) -> "Picture":
        whole: NDArray[np.float32] = imread(path)[:, :, :3]
        x, y, width, height = (round(value) for value in box)
        region = whole[y : y + height, x : x + width].reshape(-1, 3)
        steps = (region * 15).astype(np.int64)
        spread = region.max(axis=1) - region.min(axis=1)
        return cls(
            colors=len(np.unique(steps @ np.array([256, 16, 1]))),
            contrast=float((region @ np.array([0.21, 0.72, 0.07])).std()),
            strong=int((spread > 0.35).sum()),
            white=int((region.min(axis=1) > 0.75).sum()),
        )

    def shows(self, scenario: str) -> bool:
        is_lit = self.white > 100 if scenario == "scenario_2" else self.strong > 60
        return self.colors > 60 and self.contrast > 0.04 and is_lit


def folder(tmp_path: Path) -> Path:
    """Return where the pictures go."""
    wanted = os.environ.get("POINTIT_SHOTS")
    chosen = Path(wanted) if wanted else tmp_path
    chosen.mkdir(parents=True, exist_ok=True)
    return chosen


async def picture(page: Page, path: Path) -> Picture:
    """Return the page's scene. The whole page is stored at `path`."""
    await page.evaluate(SCENE_ONLY, arg=True)
    await page.screenshot(path=path)
    await page.evaluate(SCENE_ONLY, arg=False)
    box = await page.locator("#view canvas").bounding_box()
    assert box is not None
    # without overlays: the card at the top, cameras and toasts at the bottom
    return Picture.of(path, (box["x"], box["y"] + 95, box["width"], box["height"] - 175))


async def test_each_scenario_is_run_from_the_page(browser: Browser, site: SitePage, tmp_path: Path) -> None:
    window = await Window.open(browser, site.url, theme="dark", scripts=(TOLD, ALARMS))
    page = window.page
    await window.is_shown()
    menu = page.get_by_role("button", name="Choose what to run")
    first, *_, last = SCENARIOS.values()
    await menu.focus()
    for name in ("ArrowDown", "ArrowUp"):
        await page.keyboard.press(name)
    await expect(menu).to_have_accessible_name(f"{first}. Choose what to run")
    for scenario, title in SCENARIOS.items():
        if title != first:
            await menu.click()
            assert await violations(page) == []
            await page.get_by_role("button", name=f"Run: {title}").click()  # a simulation loses nothing
            for words in (f"Starting “{title}”", f"{title} is running."):
                await window.has_told(words)
            await expect(page.locator("#progress")).to_be_hidden()
        await expect(menu).to_contain_text(title)
        await window.is_shown()
        is_lit = "lamps > 0" if scenario == "scenario_1" else "lit > 5"
        lit = await window.until(
            f"(() => {{ const seen = ({LIT})(); const {{ lit, lamps, people }} = seen;"
            f"return people === 1 && {is_lit} && seen; }})()",
            f"{scenario} is lit",
            25,
        )
        if scenario in ("scenario_3", "scenario_4"):
            await window.until(f"({LIT})().objects > 0", f"something moves in {scenario}", 25)
        path = folder(tmp_path) / f"{scenario}.png"
        await page.wait_for_timeout(WAY_MS)
        patience = Patience(LOOK_S)
        while not (seen := await picture(page, path)).shows(scenario):
            assert not patience.is_over(), f"{scenario}: there is too little to see: {seen}, {lit}"
            await page.wait_for_timeout(LOOK_EVERY_MS)
    # who points is asked first, and what is lost is said; afterwards there is a way back
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    await menu.click()
    await page.get_by_role("button", name=f"Run: {first}").click()
    await expect(page.get_by_role("dialog")).to_contain_text("You point as user1")
    await expect(page.get_by_role("button", name="Go on as it is")).to_be_focused()
    await page.keyboard.press("Enter")
    await expect(page.get_by_role("dialog")).to_be_hidden()
    await expect(menu).to_contain_text(last)
    await menu.click()
    await page.get_by_role("button", name=f"Run: {first}").click()
    await page.get_by_role("button", name="Run", exact=True).click()
    await window.has_told(f"{first} is running.")
    await expect(page.get_by_role("button", name="Back to the last one")).to_be_visible()
    await window.is_shown()
    await window.until("window.pointit.site.conveyor?.left > 0", "a package has come out", 60)
    assert await page.evaluate("window.alarms") == []
    assert window.faults == []
    assert await window.violations() == []
    await site.command.stop()
    ended = page.locator("#ended")
    await expect(ended).to_contain_text("The run has ended")
    await expect(ended).to_contain_text("pointit run scenario_4")
    await expect(page.locator("#pill-text")).to_have_text("Ended")
    assert await page.evaluate("window.alarms") == []
