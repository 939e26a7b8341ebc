"""The page by the keyboard alone: from loading to a selection, a press and an undo; typed values."""

import contextlib
import re

import pytest
from playwright.async_api import Browser, Page, expect

from pointit.schemas import ButtonEvent, SelectionEvent
from pointit.schemas.topics import BUTTON, SELECTION_EVENTS
from pointit.testing.bench import WaitError
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.bench import until
from tests.support.commands import onlooker
from tests.support.pace import Patience

pytestmark = [pytest.mark.slow, pytest.mark.parametrize("shared_site", ["shelf"], indirect=True)]

MAX_TABS = 60


async def tab_to(page: Page, name: str) -> None:
    """Press Tab until a control whose name begins with `name` has the focus."""
    wanted = page.get_by_role("button", name=re.compile(f"^{name}")).or_(
        page.locator("summary", has_text=name)
    )
    for _ in range(MAX_TABS):
        if await wanted.evaluate_all("all => all.includes(document.activeElement)"):
            return
        await page.keyboard.press("Tab")
    pytest.fail(f"Tab does not come to {name!r}")


@pytest.mark.parametrize("scripts", [(), (NO_WEBGL,)], ids=["scene", "plan"])
async def test_keyboard_alone_selects_presses_and_undoes(
    browser: Browser, shared_site: SitePage, scripts: tuple[str, ...]
) -> None:
    window = await Window.open(browser, shared_site.url, scripts=scripts, reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    events: list[SelectionEvent] = []
    presses: list[ButtonEvent] = []
    async with onlooker(shared_site.endpoint) as seen:
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        seen.bus.subscribe(BUTTON, lambda event, _name: presses.append(event))
        await tab_to(page, "Point with the mouse")
        await page.keyboard.press("Enter")
        await expect(page.locator("#guide")).to_contain_text("You are the arm now")

        await tab_to(page, "As a list")
        await page.keyboard.press("Enter")
        await expect(page.get_by_role("button", name="Point at radio", exact=True)).to_be_visible()
        await tab_to(page, "Point at radio")
        await page.keyboard.press("Enter")
        await until(lambda: any((e.event, e.object_id) == ("selected", "radio") for e in events), 60, "on")

        await tab_to(page, "Point at the kettle")
        await page.keyboard.press("Enter")
        await window.until(
            "window.pointit.site.people.get('user1').hover?.object_id === 'kettle'", "the kettle"
        )

        def is_fired() -> bool:
            return any((each.event, each.object_id) == ("selected", "kettle") for each in events)

        # The next press waits for what came of the last: a second one would fire it after the undo
        patience = Patience(30.0)
        while not is_fired():
            assert not patience.is_over(), "the kettle was not fired by a press"
            count = len(presses)
            await tab_to(page, "Confirm")
            await page.keyboard.press("Enter")
            await until(lambda count=count: len(presses) > count, 30, "the press")
            with contextlib.suppress(WaitError):
                await until(is_fired, 3.0)

        await tab_to(page, "Undo")
        events.clear()
        await page.keyboard.press("Enter")
        await until(lambda: any((e.event, e.cause) == ("deselected", "undo") for e in events), 30, "the undo")
        await expect(page.locator("#toasts .toast", has_text="Switched off: radio.")).to_be_visible()
        await page.keyboard.press("Escape")
        await expect(page.get_by_role("radio", name="Demo")).to_be_checked()
    assert window.faults == []


async def test_value_can_be_typed_and_goes_back_to_the_default(
    browser: Browser, shared_site: SitePage
) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(NO_WEBGL,), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    await page.get_by_role("tab", name="Set up").click()
    typed = page.get_by_label("Time on an object in s")
    slider = page.get_by_role("slider", name="Time on an object")
    await expect(typed).to_have_value(re.compile(r"\d"))
    before = await typed.input_value()
    reset = page.get_by_role("button", name=f"Time on an object: back to {before} s")
    await expect(reset).to_be_hidden()
    for text, value in (("1,25", "1.25"), ("1.4 s", "1.4"), ("4", "4")):
        await typed.fill(text)
        await typed.press("Enter")
        await expect(slider).to_have_attribute("aria-valuetext", f"{value} s")
        await expect(typed).to_have_value(value)
    for text in ("soon", "", "1,2,3"):
        await typed.fill(text)
        await typed.press("Enter")
        await expect(page.locator("#toasts")).to_contain_text(f"Time on an object: “{text}” is no number.")
        await expect(typed).to_have_value("4")
    await typed.fill("-1")
    await typed.press("Enter")
    await expect(typed).to_have_value("4")
    await reset.click()
    await expect(typed).to_have_value(before)
    await expect(reset).to_be_hidden()
    assert window.faults == []
