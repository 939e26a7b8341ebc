"""Every scenario on the page, one after the other as its header offers them: pictures that show something.

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

from tests.e2e.web.site import SitePage
from tests.e2e.web.window import TOLD, Window
from tests.support.pace import Patience

pytestmark = pytest.mark.slow

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
    window = await Window.open(browser, site.url, theme="dark", scripts=(TOLD,))
    page = window.page
    await window.is_shown()
    chooser = page.get_by_role("combobox", name="Scenario")
    for scenario, title in SCENARIOS.items():
        if await chooser.input_value() != scenario:
            await chooser.select_option(scenario)
            for words in (f"Starting “{title}”", f"{title} is running."):
                await window.has_told(words)
            await expect(page.locator("#progress")).to_be_hidden()
        await expect(chooser).to_have_value(scenario)
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
    assert window.faults == []
    assert await window.violations() == []
