"""Robots in a browser: what is told of them, in the scene and in the plan, and the buttons that stop them."""

from typing import Any

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.robot_room import RobotRoom, robot_room
from tests.e2e.web.window import NO_WEBGL, Window
from tests.integration.web.pages import OPERATOR, VIEWER, serving
from tests.support.bench import until

pytestmark = [pytest.mark.slow, pytest.mark.long]

SEEN = "window.pointit.site.robots.size === 2"
WIDER = "document.documentElement.scrollWidth - innerWidth"


async def opened(browser: Browser, url: str, **options: Any) -> Window:
    window = await Window.open(browser, url, reduced_motion="reduce", **options)
    await window.is_shown()
    await window.until(SEEN, "two robots")
    return window


def asked(room: RobotRoom) -> set[str]:
    return {name for name, _ in room.stopped}


async def test_robots_are_told_and_stopped(browser: Browser) -> None:
    page_is_built()
    async with robot_room() as room, serving(room.bench) as server:
        window = await opened(browser, f"{server.url}/?token={OPERATOR}", scripts=(NO_WEBGL,))
        page = window.page
        plan, panel = page.locator("svg.plan-map"), page.locator("#panel")
        await expect(plan.get_by_text("quad · anna")).to_be_visible()
        await expect(plan.get_by_text("flying · 0.8 m up")).to_be_visible()
        await expect(plan.get_by_text("standing · ben 93 %")).to_be_visible()
        await expect(plan.locator(".plan-fence")).to_have_count(2)
        await expect(plan.locator("path.plan-way:not([display])")).to_have_count(2)
        await expect(plan.locator(".plan-way-point")).to_have_count(2)
        await expect(panel.get_by_text("Steered by anna · flying · to 1.2, 1.2 m")).to_be_visible()
        assert await violations(page) == []
        await panel.get_by_role("button", name="Stop quad").click()
        await expect(panel.get_by_text("from the page: point at it to take it")).to_be_visible()
        assert asked(room) == {"quad"}
        await page.locator("body").press("r")
        await until(lambda: asked(room) == {"quad", "cart"}, what="both robots to be stopped")
        assert await violations(page) == []
        assert window.faults == []


async def test_viewer_sees_robots_and_stops_them_on_a_small_screen(browser: Browser) -> None:
    page_is_built()
    async with robot_room() as room, serving(room.bench) as server:
        window = await opened(browser, f"{server.url}/?token={VIEWER}", size=(320, 640))
        page = window.page
        await expect(page.locator("#view canvas")).to_be_visible()
        stop = page.get_by_role("button", name="Stop all robots")
        await expect(stop).to_be_visible()
        assert await page.evaluate(WIDER) <= 0
        assert await violations(page) == []
        await stop.click()
        await until(lambda: asked(room) == {"quad", "cart"}, what="both robots to be stopped")
        await expect(page.locator("#toasts")).to_contain_text("Stopped: cart, quad.")
        assert window.faults == []
