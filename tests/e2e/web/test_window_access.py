"""The page is usable with poor sight, without a mouse, or on a small screen."""

from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
from playwright.async_api import Browser, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import Theme, Window
from tests.support.bench import until

pytestmark = [pytest.mark.slow, pytest.mark.long]

THEMES: tuple[Theme, ...] = ("light", "dark")
SIZES = ((390, 844), (320, 640), (844, 390), (640, 400), (512, 384))
"""CSS pixels of phones, and of windows at 200 % zoom."""
WIDER = "document.documentElement.scrollWidth - innerWidth"
TALLER = """Math.max(document.documentElement.scrollHeight,
  document.getElementById("panel").getBoundingClientRect().bottom) - innerHeight"""
"""Height beyond the window, px, by which Tab or a finger could scroll."""
LEAST_SCENARIO_PX = 40

NUMBER = """(element) => {  // its own, also when the page grows by another meanwhile
  const numbers = window.testNumbers ??= new Map();
  if (!numbers.has(element)) numbers.set(element, numbers.size);
  return numbers.get(element);
}"""
FOCUSED = """() => {
  const number = NUMBER;
  const found = document.activeElement;
  if (!found || found === document.body) return null;
  const face = found.matches("input[type=radio]") ? found.nextElementSibling : found;
  const drawn = (element) => {
    const { outlineStyle, outlineWidth, boxShadow } = getComputedStyle(element);
    return (outlineStyle !== "none" && parseFloat(outlineWidth) >= 1) || boxShadow !== "none";
  };
  const { bottom, top } = face.getBoundingClientRect();
  return { index: number(found), html: found.outerHTML.slice(0, 120),
    isRinged: drawn(face), isOnScreen: bottom > 0 && top < innerHeight };
}""".replace("NUMBER", NUMBER)
REACHABLE = """() => {
  const number = NUMBER;
  const everything = [...document.querySelectorAll("*")];
  const groups = new Set();
  return everything.flatMap((element) => {
    if (!element.matches("a[href], button, input, select, summary, [tabindex]")) return [];
    if (element.tabIndex < 0 || element.disabled) return [];
    if (!element.checkVisibility({ visibilityProperty: true })) return [];
    if (element.type === "radio") {  // one of a group, the chosen one, is reached; arrow keys do the rest
      const all = everything.filter((each) => each.type === "radio" && each.name === element.name);
      if (all.some((each) => each.checked) ? !element.checked : all[0] !== element) return [];
    }
    return [{ index: number(element), html: element.outerHTML.slice(0, 120) }];
  });
}""".replace("NUMBER", NUMBER)

WATCH = """() => {
  const number = NUMBER;
  window.testChanged = new Set();
  new MutationObserver((changes) => changes.forEach(({ target }) => testChanged.add(number(target))))
    .observe(document, { subtree: true, attributeFilter: ["disabled", "hidden"] });
}""".replace("NUMBER", NUMBER)
"""Collects the controls that could not be used meanwhile."""


@pytest_asyncio.fixture
async def window(browser: Browser, shared_site: SitePage) -> AsyncIterator[Window]:
    opened = await Window.open(browser, shared_site.url, reduced_motion="reduce")
    await opened.is_shown()
    yield opened
    assert opened.faults == []


async def test_axe_finds_nothing_wrong_in_any_state(window: Window) -> None:
    page = window.page
    found: dict[str, list[str]] = {}

    async def look(state: str) -> None:
        for theme in THEMES:
            await page.emulate_media(color_scheme=theme)
            if wrong := await violations(page):
                found[f"{state}, {theme}"] = wrong

    await look("scene")
    await page.locator(".plan-list summary").click()
    await expect(page.locator(".plan-list li").first).to_be_visible()
    await look("list")
    await page.locator(".plan-list summary").click()
    for tab in ("Set up", "Health"):
        await page.get_by_role("tab", name=tab).click()
        await page.wait_for_timeout(300)
        await look(tab)
    await page.get_by_role("tab", name="Control").click()
    await page.get_by_role("button", name="Choose what to run").click()
    await look("scenarios")
    await page.keyboard.press("Escape")
    await page.get_by_role("button", name="Help and keys").click()
    await look("help")
    await page.keyboard.press("Escape")
    await page.get_by_role("button", name="Point with your phone").click()
    await expect(page.get_by_role("img", name="QR code")).to_be_visible()
    await look("pairing")
    await page.keyboard.press("Escape")
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    await look("mouse")
    await page.get_by_role("button", name="Settings of this page").click()
    await look("settings")
    await page.get_by_role("radio", name="Plan").check(force=True)
    await page.keyboard.press("Escape")
    await expect(page.locator("svg.plan-map")).to_be_visible()
    await look("plan")
    await page.get_by_role("button", name="Give back").click()
    await page.locator("body").press("w")
    await expect(page.locator(".track").first).to_be_visible()
    await look("past")
    assert found == {}


async def test_tab_reaches_every_control_and_shows_where_it_is(window: Window) -> None:
    page = window.page
    await page.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
    await page.evaluate(WATCH)
    wanted: list[dict[str, Any]] = await page.evaluate(REACHABLE)
    reached: dict[int, dict[str, Any]] = {}
    stayed = {each["index"] for each in wanted}  # the page draws some controls again
    for _ in range(2 * len(wanted) + 10):
        await page.keyboard.press("Tab")
        stayed &= {each["index"] for each in await page.evaluate(REACHABLE)}
        at: dict[str, Any] | None = await page.evaluate(FOCUSED)
        if at is not None:  # between the last and the first nothing has the focus
            reached[at["index"]] = at
    stayed -= set(await page.evaluate("[...testChanged]"))
    assert len(stayed) > 20
    missed = [each["html"] for each in wanted if each["index"] in stayed - reached.keys()]
    assert missed == []
    assert [each["html"] for each in reached.values() if not each["isRinged"]] == []
    assert [each["html"] for each in reached.values() if not each["isOnScreen"]] == []


async def test_keys_open_and_close(window: Window) -> None:
    page = window.page
    await page.locator("body").press("?")
    dialog = page.get_by_role("dialog")
    await expect(dialog).to_be_visible()
    await expect(dialog).to_contain_text("Press the button at the wrist")
    assert await page.evaluate("document.activeElement.closest('dialog') !== null")
    await page.keyboard.press("m")  # nothing behind it is done
    await page.keyboard.press("Escape")
    await expect(dialog).to_be_hidden()
    assert [part for part in window.sent if part.get("deed") == "take"] == []
    await page.locator("body").press("q")
    await expect(page.get_by_role("dialog")).to_be_visible()
    await page.keyboard.press("Escape")
    await expect(page.get_by_role("dialog")).to_be_hidden()
    await page.locator("body").press("m")
    await expect(page.get_by_role("radio", name="Mouse")).to_be_checked()
    window.sent.clear()
    await page.locator("body").press("ArrowLeft")
    await page.locator("body").press("ArrowUp")
    await until(lambda: sum(part["kind"] == "aim" for part in window.sent) >= 2, 5, "two aims")
    await page.locator("body").press("Escape")
    await expect(page.get_by_role("radio", name="Demo")).to_be_checked()


async def test_a_small_screen_shows_all_and_a_finger_aims(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(
        browser, shared_site.url, size=(390, 844), is_mobile=True, has_touch=True, device_scale_factor=2
    )
    page = window.page
    await window.is_shown()
    tag = "document.getElementById('recorded').hidden = false"  # as while it is recorded
    for width, height in SIZES:
        await page.set_viewport_size({"width": width, "height": height})
        for tab in ("Control", "Set up", "Health"):
            await page.get_by_role("tab", name=tab).tap()
            assert await page.evaluate(WIDER) <= 0, (width, tab)
            assert await page.evaluate(TALLER) <= 0, (width, tab)
        assert (
            await page.evaluate(f"{tag}, document.getElementById('scenario').clientWidth") > LEAST_SCENARIO_PX
        )
        canvas = await page.locator("#view canvas").bounding_box()
        assert canvas is not None
        assert canvas["width"] <= width
        assert canvas["height"] > 100, "the scene is still seen"
    await page.set_viewport_size({"width": 390, "height": 844})
    await page.get_by_role("tab", name="Control").tap()
    await page.get_by_role("button", name="Point with your finger").tap()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    canvas = await page.locator("#view canvas").bounding_box()
    assert canvas is not None
    window.sent.clear()
    await page.touchscreen.tap(canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] * 0.55)
    await until(
        lambda: any(part["kind"] == "aim" and part["user"] == "user1" for part in window.sent), 5, "an aim"
    )
    await page.get_by_role("button", name="Give back").tap()
    await expect(page.get_by_role("radio", name="Demo")).to_be_checked()
    assert window.faults == []
