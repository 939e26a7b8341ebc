"""The page in a browser: what a newcomer sees first, and how they select a package with the mouse."""

import re

import pytest
from playwright.async_api import Browser, expect

from pointit.schemas import SelectionEvent
from pointit.schemas.topics import SELECTION_EVENTS
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import Window
from tests.support.bench import until
from tests.support.commands import onlooker

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

USER = "user1"
FIRST_SCREEN_S = 3.0


async def test_a_newcomer_selects_a_red_package_with_the_mouse(browser: Browser, site: SitePage) -> None:
    window = await Window.open(browser, site.url)
    page = window.page
    await window.is_shown()
    events: list[SelectionEvent] = []

    def of_user(what: str) -> list[SelectionEvent]:
        return [event for event in events if event.event == what and event.user == USER]

    async with onlooker(site.endpoint) as seen:
        await page.get_by_role("button", name="Point with the mouse").click()
        await expect(page.locator("#guide")).to_contain_text("You are the arm now")
        await expect(page.get_by_role("radio", name="Mouse")).to_be_checked()
        lens = await window.survey()
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        await window.follows(lens, "red", lambda: bool(of_user("selected")), 45)
        assert of_user("selected")[0].kind == "red"
        assert of_user("selected")[0].cause == "dwell"
        await expect(page.locator("#guide")).to_contain_text("You selected a red package!")
        await page.get_by_role("button", name="Give back").click()
        await expect(page.get_by_role("radio", name="Demo")).to_be_checked()
        events.clear()
        await until(lambda: bool(of_user("selected")), 40, "the simulated person goes on selecting")
    assert window.faults == []
    assert await window.violations() == []
    _ = re, FIRST_SCREEN_S
