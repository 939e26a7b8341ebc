"""The plan: the view of browsers without WebGL, and selection without a mouse and without sight."""

import asyncio
import re

import pytest
from playwright.async_api import Browser, Page, expect

from pointit.schemas import SelectionEvent
from pointit.schemas.topics import SELECTION_EVENTS
from tests.e2e.web.axe import violations
from tests.e2e.web.site import SitePage
from tests.support.commands import onlooker
from tests.support.pace import Patience

pytestmark = pytest.mark.slow

NO_WEBGL = """
const context = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : context.call(this, kind, ...more);
};
"""


async def opened(browser: Browser, url: str) -> tuple[Page, list[str]]:
    """Return the page without WebGL, and the errors of its console."""
    page = await (await browser.new_context(viewport={"width": 1280, "height": 800})).new_page()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    await page.add_init_script(NO_WEBGL)
    await page.goto(url)
    return page, faults


async def test_without_webgl_the_plan_shows_the_conveyor(browser: Browser, shared_site: SitePage) -> None:
    page, faults = await opened(browser, shared_site.url)
    plan = page.locator("svg.plan-map")
    await expect(plan).to_be_visible(timeout=60_000)
    await expect(plan.locator(".plan-belt")).to_have_count(8)
    await expect(plan.locator(".plan-strip")).to_have_count(22)
    await expect(plan.get_by_text("Bay 1", exact=True)).to_be_visible()
    await expect(plan.get_by_text("user1", exact=False).first).to_be_visible()
    await expect(plan.locator(".plan-box").first).to_be_visible(timeout=60_000)
    await expect(plan.locator("path.plan-lit").first).to_be_attached(timeout=60_000)
    summary = page.locator(".plan-list summary")
    await expect(summary).to_have_text(re.compile(r"As a list: 1 person, \d+ objects?, 3 lamps"))
    await summary.click()
    assert await violations(page) == []
    assert faults == []


async def test_a_package_is_selected_by_the_keyboard_alone(browser: Browser, shared_site: SitePage) -> None:
    page, faults = await opened(browser, shared_site.url)
    await expect(page.locator("svg.plan-map")).to_be_visible(timeout=60_000)
    # the plan is there before anything is known of the site, even the people
    await expect(page.get_by_role("button", name="Point with the mouse")).to_be_visible(timeout=60_000)
    events: list[SelectionEvent] = []
    async with onlooker(shared_site.endpoint) as seen:
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        await page.keyboard.press("m")
        await expect(page.get_by_role("radio", name="Mouse")).to_be_checked()
        await page.locator(".plan-list summary").focus()
        await page.keyboard.press("Enter")
        blue = page.get_by_role("button", name=re.compile("^Point at blue package"))
        chosen = page.get_by_role("button", name=re.compile("^Point at blue package"), pressed=True)
        await expect(blue.first).to_be_visible(timeout=60_000)
        events.clear()
        patience = Patience(30.0)
        # only a person who chose it from the list wants a blue one; one that leaves is followed by the next
        while not any(event.event == "selected" and event.kind == "blue" for event in events):
            assert not patience.is_over(), "no blue package was selected"
            if not await chosen.count():
                await blue.first.focus()
                await page.keyboard.press("Enter")
            await asyncio.sleep(0.5)
    assert faults == []
