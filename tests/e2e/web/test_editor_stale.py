"""The editor's list of findings of other items says what the check says now."""

from pathlib import Path

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import running
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.commands import Commands

pytestmark = pytest.mark.slow

ROOM = """\
strips:
  a: {line: [[0, 2.9, 1.2], [2, 2.9, 1.2]], pixels: 60}
  b: {line: [[0, 2.0, 1.2], [2, 2.0, 1.2]], pixels: 62}
  c: {line: [[0, 1.0, 1.2], [2, 1.0, 1.2]], pixels: 20}
"""


async def test_finding_of_another_item_follows_an_edit(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    page_is_built()
    path = tmp_path / "my_room.yaml"
    path.write_text(ROOM)
    site = await running(commands, "scenario_2", "--set", f"pui.map={path}", "--pose", "2,0.8")
    window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
    await window.is_shown()
    page = window.page
    await page.get_by_role("tab", name="Set up").click()
    await page.get_by_role("button", name="Edit the map").click()
    side = page.locator(".edit-side")
    await page.get_by_role("button", name="Strip a").focus()
    await expect(side.locator(".edit-leads")).to_contain_text("the strips' median is 30.0")
    pixels = side.get_by_role("textbox", name="Pixels")
    await pixels.fill("61")
    await pixels.press("Enter")
    # the median of 30.5, 31 and 10 is 30.5
    await expect(side.locator(".edit-leads")).to_contain_text("the strips' median is 30.5", timeout=20_000)
