"""Accessibility and look of a page: findings of axe-core, width and colours."""

from importlib.resources import files
from typing import Any

from playwright.async_api import Page

SIZES = ((1440, 900), (768, 1024), (390, 844), (844, 390))
PAPER = {"light": "rgb(238, 241, 244)", "dark": "rgb(13, 18, 22)"}
"""`--back` of `styles/base.css`."""
WIDER = "document.documentElement.scrollWidth - innerWidth"
BACKGROUND = "getComputedStyle(document.body).backgroundColor"


async def violations(page: Page) -> list[str]:
    source = next(path for path in files("axe_playwright_python").iterdir() if path.name == "axe.min.js")
    await page.evaluate(source.read_text(encoding="utf-8"))
    found: dict[str, Any] = await page.evaluate(
        "axe.run({ rules: { 'label-content-name-mismatch': { enabled: true } } })"
    )
    return [
        f"{rule['id']}: {rule['help']}: {[node['html'] for node in rule['nodes']]}"
        for rule in found["violations"]
    ]


async def check_look(page: Page, *what: object) -> None:
    """Check by axe, width and colours at four sizes in both themes; `what` is in the message of a failure."""
    before = page.viewport_size
    for width, height in SIZES:
        await page.set_viewport_size({"width": width, "height": height})
        for theme, paper in PAPER.items():
            await page.emulate_media(color_scheme=theme, reduced_motion="reduce")  # pyrefly: ignore[bad-argument-type]
            where = (*what, width, height, theme)
            assert await page.evaluate(WIDER) <= 0, where
            assert await page.evaluate(BACKGROUND) == paper, where
            assert await violations(page) == [], where
    if before is not None:
        await page.set_viewport_size(before)
