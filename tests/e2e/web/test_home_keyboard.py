"""The cards of `pointit home` by the keyboard alone, and as a screen reader has them."""

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Browser, Page, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.test_home import LABELS, Hand, HomeRun, memory_home, paired_phone
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.buses import free_port
from tests.support.commands import Commands
from tests.support.home_assistant import TOKEN

pytestmark = pytest.mark.slow

MAX_TABS = 60
NARROW = {"width": 390, "height": 844}
IS_SEEN = """() => {
  const element = document.activeElement;
  const { left, top, right, bottom } = element.getBoundingClientRect();
  const topmost = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
  const isTopmost = element.contains(topmost) || (topmost?.contains(element) ?? false);
  return isTopmost && element.matches(":focus-visible") && getComputedStyle(element).outlineStyle !== "none";
}"""
"""Whether the control with the focus is seen, with its ring."""
SAID = """
window.said = [];
document.addEventListener("DOMContentLoaded", () => new MutationObserver((changes) => {
  for (const { target } of changes) {
    const element = target instanceof Element ? target : target.parentElement;
    const region = element?.closest("[role=alert], [role=status], [aria-live]");
    if (region?.isConnected && region.textContent.trim()) window.said.push(region.textContent.trim());
  }
}).observe(document.body, { childList: true, subtree: true, characterData: true }));
"""
"""Keeps what live regions say."""


@pytest.fixture
def run(commands: Commands, tmp_path: Path) -> HomeRun:
    page_is_built()
    return HomeRun(commands, tmp_path / "home", tmp_path / "state", free_port())


@dataclass(frozen=True)
class Focused:
    """The control with the focus, as a screen reader has it."""

    role: str
    name: str
    description: str


class Keyboard:
    """A person with a keyboard, who hears the page."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.page: Page = window.page

    async def focused(self) -> Focused:
        cdp: Any = await self.page.context.new_cdp_session(self.page)
        handle = await cdp.send("Runtime.evaluate", {"expression": "document.activeElement"})
        options = {"objectId": handle["result"]["objectId"], "fetchRelatives": False}
        node = (await cdp.send("Accessibility.getPartialAXTree", options))["nodes"][0]
        await cdp.detach()
        values = {key: str(node.get(key, {}).get("value", "")) for key in ("role", "name", "description")}
        return Focused(**values)

    async def is_at(self, title: str) -> None:
        """Wait until the card's title has the focus. It is seen, and nothing of the card is wrong."""
        heading = self.page.locator("#setup-title")
        await expect(heading).to_have_text(title)
        await expect(heading).to_be_focused()
        assert await self.page.evaluate(IS_SEEN), title
        assert await violations(self.page) == []

    async def tab_to(self, name: str, *, key: str = "Tab") -> list[str]:
        """Press Tab until the control `name` of the card has the focus. Return the names on the way."""
        passed: list[str] = []
        for _ in range(MAX_TABS):
            await self.page.keyboard.press(key)
            focused = await self.focused()
            assert await self.page.evaluate(IS_SEEN), focused
            passed.append(focused.name)
            if focused.name == name:
                return passed
        pytest.fail(f"{key} does not come to {name!r}, only to {passed}")

    async def use(self, name: str, *, key: str = "Tab") -> None:
        await self.tab_to(name, key=key)
        await self.page.keyboard.press("Enter")

    async def has_heard(self, words: str, count: int = 1) -> None:
        """Wait until live regions have said `words` so often since the last call, and forget it."""
        said = f"window.said.filter((text) => text.includes({words!r})).length >= {count}"
        await self.window.until(said, f"{words!r} is read out")
        await self.page.evaluate("window.said.length = 0")


async def opened(browser: Browser, url: str) -> Keyboard:
    return Keyboard(await Window.open(browser, url, scripts=(NO_WEBGL, SAID), reduced_motion="reduce"))


async def connect(keyboard: Keyboard, port: int, token: str = TOKEN) -> None:
    """Type the address and the token at the first card."""
    await keyboard.tab_to("Address of Home Assistant")
    await keyboard.page.keyboard.press("Control+a")
    await keyboard.page.keyboard.type(f"http://127.0.0.1:{port}")
    await keyboard.tab_to("Access token")
    await keyboard.page.keyboard.type(token)
    await keyboard.page.keyboard.press("Enter")


async def choose(keyboard: Keyboard) -> None:
    """Tick the lamps at the second card."""
    for label in LABELS.values():
        await keyboard.tab_to(label)
        await keyboard.page.keyboard.press("Space")
    await keyboard.use("Next")


async def press_at(keyboard: Keyboard, hand: Hand, lamp: str) -> None:
    """Point at the lamp of the turn and press by Space, without a control that has the focus."""
    await keyboard.has_heard(f"Point at {LABELS[lamp]}")
    await hand.hold(lamp)
    await keyboard.page.keyboard.press("Space")
    await hand.hold(lamp, 0.6)


async def test_keyboard_alone_sets_up_a_home(browser: Browser, run: HomeRun) -> None:
    async with memory_home() as (home, port):
        site = await run.start()
        keyboard = await opened(browser, site.url)
        page = keyboard.page

        await keyboard.is_at("Where are your lamps?")
        passed = await keyboard.tab_to("Connect")
        assert passed[0] == "Later"
        assert passed[-4:-1] == [
            "Address of Home Assistant",
            "Access token",
            "Make a token in your profile there, under Security",
        ]
        for _ in range(2):  # the same reason again is said again
            await page.keyboard.press("Enter")
            await keyboard.has_heard("Paste the token first")
        await keyboard.tab_to("Later", key="Shift+Tab")
        await connect(keyboard, port, "a.wrong.token")
        await keyboard.has_heard("rejects the token")
        assert (await keyboard.focused()).name == "Access token"
        await page.keyboard.type(TOKEN)
        await page.keyboard.press("Enter")

        await keyboard.is_at("Which lamps do you want to point at?")
        heading = await keyboard.focused()
        assert heading.description == "Step 2 of 5 Rest on a row, and its lamp shows which one it is."
        await keyboard.tab_to("Next")
        await page.keyboard.press("Enter")
        await keyboard.has_heard("Choose at least one lamp")
        await keyboard.tab_to("Desk lamp", key="Shift+Tab")
        assert await keyboard.focused() == Focused("checkbox", "Desk lamp", "on")
        await page.keyboard.press("Space")
        home.set("light.new", "off", friendly_name="Attic")
        await expect(page.locator(".setup")).to_contain_text("Attic")
        assert (await keyboard.focused()).name == "Desk lamp", "a lamp that comes takes no focus"
        await expect(page.get_by_role("checkbox", name="Desk lamp", exact=True)).to_be_checked()
        for label in ("Door", "Shelf"):
            await keyboard.tab_to(label)
            await page.keyboard.press("Space")
        await keyboard.use("Next")

        await keyboard.is_at("What do you point with?")
        await keyboard.use("Pair a phone")
        await expect(page.get_by_role("dialog", name="Point with your phone")).to_be_visible()
        await page.keyboard.press("Escape")
        assert (await keyboard.focused()).name == "Pair a phone", "the dialog returns the focus"
        hand = Hand(await paired_phone(browser, site))
        await keyboard.has_heard("The phone points")
        await keyboard.use("Back", key="Shift+Tab")
        await keyboard.is_at("Which lamps do you want to point at?")
        await keyboard.use("Next")
        await keyboard.is_at("What do you point with?")
        await page.evaluate("window.said.length = 0")
        await keyboard.use("Next")

        await keyboard.is_at("Where is each lamp?")
        assert "Point at Desk lamp" in (await keyboard.focused()).description
        await press_at(keyboard, hand, "light.desk")
        await keyboard.has_heard("Point at Door")
        await keyboard.use("Take back")
        await keyboard.has_heard("Point at Desk lamp")
        await keyboard.is_at("Where is each lamp?")  # it had nothing to do any more, and has gone
        await hand.hold("light.desk")
        await keyboard.use("Press")
        for lamp in ("light.door", "light.shelf"):
            await keyboard.has_heard(f"Point at {LABELS[lamp]}")
            await hand.hold(lamp)
            await page.keyboard.press("Enter")
            await hand.hold(lamp, 0.6)

        await keyboard.is_at("Walk to a second place")
        assert "two metres to your left" in (await keyboard.focused()).description
        await page.evaluate("window.said.length = 0")
        await keyboard.use("I stay here")
        await keyboard.is_at("Try it")
        is_refused = "window.said.some((text) => text.includes('point elsewhere first'))"
        async with asyncio.timeout(120):
            while not await page.evaluate(is_refused):
                await hand.hold("light.shelf", 0.5)
        await expect(page.locator(".setup .reason")).to_have_text(
            "You still point where you pressed: point elsewhere first, and then at it."
        )
        assert home.states["light.shelf"]["state"] == "off"
        await hand.lower()
        await expect(page.locator(".setup .reason")).to_be_empty()

        await keyboard.use("All lamps", key="Shift+Tab")
        await keyboard.use("Find my direction again")
        await keyboard.is_at("Where do you point now?")
        await keyboard.use("Skip")
        await keyboard.is_at("Try it")
        await keyboard.use("Done")
        await keyboard.has_heard("Your home is set up")
        await expect(page.locator("#home-title")).to_be_focused()
        assert await violations(page) == []
        await keyboard.use("Advanced")
        await expect(page.locator("#panel")).to_be_focused()
        assert keyboard.window.faults == []


async def test_card_that_was_put_aside_is_opened_again_from_the_panel(browser: Browser, run: HomeRun) -> None:
    async with memory_home() as (_home, port):
        site = await run.start()
        keyboard = await opened(browser, site.url)
        page = keyboard.page
        await keyboard.is_at("Where are your lamps?")
        await connect(keyboard, port)
        await keyboard.is_at("Which lamps do you want to point at?")
        await keyboard.use("Later")
        await keyboard.has_heard("Home in Set up opens each card again")
        await expect(page.locator("#panel")).to_be_focused()

        await keyboard.tab_to("Control")
        await page.keyboard.press("ArrowRight")
        await keyboard.use("Choose lamps")
        await keyboard.is_at("Which lamps do you want to point at?")
        await keyboard.use("Later")
        assert (await keyboard.focused()).name == "Choose lamps"

        await page.keyboard.press("Enter")
        await keyboard.is_at("Which lamps do you want to point at?")
        await choose(keyboard)
        await keyboard.is_at("What do you point with?")
        await page.set_viewport_size(NARROW)
        await keyboard.tab_to("A phone")
        await page.keyboard.press("ArrowDown")
        await keyboard.use("Look for wristbands")
        assert (await keyboard.focused()).name == "Look for devices"
        assert await page.evaluate(IS_SEEN), "the card is out of its way"
