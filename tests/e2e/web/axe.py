"""Accessibility of a page, as axe-core finds it."""

from importlib.resources import files
from typing import Any

from playwright.async_api import Page


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
