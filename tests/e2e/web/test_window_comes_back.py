"""The server dies and comes back, or its router is frozen: the page says so and goes on."""

import re
from collections.abc import AsyncIterator
from urllib.parse import urlsplit

import pytest
import pytest_asyncio
from playwright.async_api import Browser, expect

from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import SitePage, running
from tests.e2e.web.window import Window
from tests.support.bench import until
from tests.support.buses import free_port, is_listening, router_process
from tests.support.commands import Commands
from tests.support.links import link_in

pytestmark = [pytest.mark.slow, pytest.mark.long]

FOLLOWS = re.compile(r"should run|has left|has not reported|router at \S+ lost")
"""Findings that say the same of each service."""


class Restarting:
    """A run at one port that is killed and started again."""

    def __init__(self, commands: Commands) -> None:
        self._commands = commands
        self._port = str(free_port())
        self.site: SitePage | None = None

    async def start(self, token: str) -> SitePage:
        self.site = await running(
            self._commands, *("scenario_4", "--web-port", self._port, "--set", f"web.operator_token={token}")
        )
        return self.site

    def kill(self) -> None:
        assert self.site is not None
        self.site.command.kill()


@pytest_asyncio.fixture
async def server(commands: Commands) -> AsyncIterator[Restarting]:
    yield Restarting(commands)


async def test_page_reconnects_with_the_mouse_and_names_an_outdated_link(
    browser: Browser, server: Restarting
) -> None:
    site = await server.start("the-same-as-before")
    window = await Window.open(browser, site.url)
    page = window.page
    await window.is_shown()
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.get_by_role("radio", name="Mouse")).to_be_checked()
    lost = page.get_by_role("alert")

    server.kill()
    await expect(lost).to_contain_text("The connection is lost. What you see is old; trying again")
    await expect(page.locator("#pill-text")).to_have_text("Lost")
    await expect(page.locator("#panel .press")).to_be_hidden()
    was_ns = await page.evaluate("window.pointit.site.sentNs")

    await server.start("the-same-as-before")
    await expect(lost).to_be_hidden(timeout=60_000)
    await expect(page.locator("#pill-text")).to_have_text("Live")
    await window.is_shown()
    assert await page.evaluate("window.pointit.site.sentNs") > was_ns
    await window.until("window.pointit.site.objects.size > 0", "the packages")
    await expect(page.get_by_role("radio", name="Mouse")).to_be_checked(timeout=40_000)  # it took it again
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")

    server.kill()
    await expect(lost).to_be_visible()
    await server.start("another-one-than-before")
    await expect(lost).to_contain_text("PointIt was restarted: open the link that it prints", timeout=60_000)
    # a browser reports automatically requests to a server that is gone, or not its own any more
    asked = ("/ws", f"failed: {site.origin}/", "net::ERR_CONNECTION_", "403")
    assert [fault for fault in window.faults if not any(each in fault for each in asked)] == []


async def test_a_frozen_router_is_one_sentence_with_its_address(browser: Browser, commands: Commands) -> None:
    page_is_built()
    async with router_process() as router:
        at = ("--connect", router.endpoint)
        run = commands.start("run", "scenario_1", *at, "--no-view", "--no-web", "--duration", "600")
        await run.says("pointing. Your place")
        dashboard = commands.start("dashboard", *at, "--port", "0", "--no-browser")
        await dashboard.says("its link is in")
        link = link_in(dashboard.out)
        port = urlsplit(link).port or 0
        await until(lambda: is_listening(port), what="the page to be served, after its link is said")
        window = await Window.open(browser, link)
        await window.is_shown()
        page = window.page
        await expect(page.locator("#pill-text")).to_have_text("Live")

        router.freeze()
        sentence = f"the router at {router.endpoint} does not answer"
        await expect(page.locator("#pill-text")).to_have_text("Cut off")
        await expect(page.locator("#outage-text")).to_contain_text(f"T{sentence[1:]}: ")
        await page.locator("#pill").click()
        findings = page.get_by_role("region", name="Warnings").get_by_role("listitem")
        await expect(findings.filter(has_text="services are out of reach")).to_have_count(1)
        # besides, the page's own service may say that this machine is slow
        await expect(findings.filter(has_text=FOLLOWS)).to_have_count(0)
        await page.get_by_text("What follows from it").click()
        await expect(findings.get_by_text("should run and does not").first).to_be_visible()

        await run.says(f"{sentence}: nothing arrives from other machines; is its process stopped")
        ended = await commands.pointit("doctor", *at, "--timeout", "0.5")
        assert ended.code == 1
        said, remedy, *_ = ended.out.splitlines()
        assert said == f"error: {sentence} [unreachable]"
        assert remedy.startswith("    -> is its process stopped (`kill -CONT PID`)")
