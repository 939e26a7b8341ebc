"""A router that is frozen is one sentence with its address and one remedy: page, terminal, doctor."""

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.window import Window
from tests.support.buses import router_process
from tests.support.commands import Commands
from tests.support.links import link_in

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


async def test_a_frozen_router_is_one_sentence_with_its_address(browser: Browser, commands: Commands) -> None:
    page_is_built()
    async with router_process() as router:
        at = ("--connect", router.endpoint)
        run = commands.start("run", "scenario_1", *at, "--no-view", "--no-web", "--duration", "600")
        await run.says("pointing. Your place")
        dashboard = commands.start("dashboard", *at, "--port", "0", "--no-browser")
        await dashboard.says("its link is in")
        window = await Window.open(browser, link_in(dashboard.out))
        await window.is_shown()
        page = window.page
        await expect(page.locator("#pill-text")).to_have_text("Live")

        router.freeze()
        sentence = f"the router at {router.endpoint} does not answer"
        await expect(page.locator("#pill-text")).to_have_text("Cut off")
        await expect(page.locator("#outage-text")).to_contain_text(f"T{sentence[1:]}: ")
        await page.locator("#pill").click()
        findings = page.get_by_role("region", name="Warnings").get_by_role("listitem")
        await expect(findings).to_have_count(1)
        await expect(findings).to_contain_text("services are out of reach")
        await page.get_by_text("What follows from it").click()
        await expect(findings.get_by_text("should run and does not").first).to_be_visible()

        await run.says(f"{sentence}: nothing arrives from other machines; is its process stopped")
        ended = await commands.pointit("doctor", *at, "--timeout", "0.5")
        assert ended.code == 1
        assert ended.out.startswith(f"error: {sentence}\n    -> is its process stopped (`kill -CONT PID`)")
