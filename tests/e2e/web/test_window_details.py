"""Details of the page: whole texts, a code that ends, the colour of a start, a toast that undoes, labels."""

from typing import Any

import pytest
from playwright.async_api import Browser, expect

from pointit.schemas import SetThing
from pointit.schemas.topics import SET_THING
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import SitePage, running
from tests.e2e.web.test_window_shown import SEEN, meet
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.commands import Commands, onlooker

pytestmark = [pytest.mark.slow, pytest.mark.long]

PHONE: dict[str, Any] = {"size": (390, 844), "is_mobile": True, "has_touch": True, "reduced_motion": "reduce"}
NO_SOCKET = """
window.WebSocket = class extends EventTarget { close() {} send() {} };
"""
"""A connection that neither opens nor fails, as while a server starts."""
CUT = """() => {
  const view = document.querySelector("svg.plan-map").getBoundingClientRect(), cut = [];
  for (const each of document.querySelectorAll("svg.plan-map text")) {
    if (!each.textContent || each.closest("[display=none]") || !each.checkVisibility()) continue;
    const { left, right, top, bottom } = each.getBoundingClientRect();
    const isBeside = left < view.left - 1 || right > view.right + 1;
    if (isBeside || top < view.top - 1 || bottom > view.bottom + 1) cut.push(each.textContent);
  }
  return cut;
}"""
"""Texts of the plan that go beyond it."""
PHONE_OF = "window.pointit.site.people.get('user1')?.line?.phone"
OWNED = "(window.pointit.site.selection?.objects ?? []).map(({ id }) => id).join()"
SCENARIOS = (
    "scenario_1", "scenario_2", "scenario_3", "scenario_4", "scenario_5", "scenario_6",
    "send_a_robot", "shelf",
)  # fmt: skip
LOOKS = 4
"""Packages, people and robots move: labels are compared as many times."""


async def test_texts_of_the_plan_are_whole_at_each_size(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(NO_WEBGL,), reduced_motion="reduce")
    await window.is_shown()
    await expect(window.page.locator("svg.plan-map").get_by_text("Bay 1", exact=True)).to_be_visible()
    for width, height in ((1440, 900), (768, 1024), (390, 844), (844, 390)):
        await window.page.set_viewport_size({"width": width, "height": height})
        await window.is_drawn_anew()
        assert await window.page.evaluate(CUT) == [], (width, height)
    assert window.faults == []


async def test_closing_the_code_withdraws_the_pairing(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(NO_WEBGL,))
    page = window.page
    await window.is_shown()
    for _ in range(2):
        await page.get_by_role("button", name="Point with your phone").click()
        await expect(page.get_by_role("img", name="QR code")).to_be_visible()
        await window.until(f"{PHONE_OF} === 'waiting for the phone'", "the pairing waits")
        await page.get_by_role("button", name="Close", exact=True).click()
        await window.until(f"{PHONE_OF} === ''", "the pairing is withdrawn")
        await expect(page.get_by_role("button", name="Unpair the phone")).to_be_hidden()
        await expect(page.get_by_text("Phone: waiting")).to_be_hidden()
    assert window.faults == []


async def test_pill_is_not_red_while_the_page_connects(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(
        browser, shared_site.url, scripts=(NO_WEBGL, NO_SOCKET), reduced_motion="reduce"
    )
    pill = window.page.locator("#pill")
    await expect(pill).to_contain_text("Connecting")
    await window.page.wait_for_timeout(1500)  # it looks at its state once a second
    await expect(pill).to_have_attribute("data-state", "loading")
    loading, bad = await pill.evaluate(
        """(pill) => {
          const color = () => getComputedStyle(pill.querySelector("svg")).color;
          const loading = color();
          pill.dataset.state = "lost";
          return [loading, color()];
        }"""
    )
    assert loading != bad
    assert window.faults == []


@pytest.mark.parametrize("site", [("shelf",)], indirect=True)
async def test_clear_is_one_toast_with_names_and_an_undo(browser: Browser, site: SitePage) -> None:
    window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
    page = window.page
    await window.is_shown()
    clear, toasts = page.get_by_role("button", name="Clear"), page.locator("#toasts .toast")
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    async with onlooker(site.endpoint) as seen:
        await seen.bus.call(SET_THING, SetThing(thing="radio"), "user1")
        await window.until(f"{OWNED} === 'radio'", "the radio is on")
        await expect(clear).to_be_enabled()
        await clear.click()
        await window.until(f"{OWNED} === ''", "it is off")
        told = toasts.filter(has_text="Cleared")
        await expect(told).to_have_count(1)
        await expect(told).to_contain_text("Cleared: radio.")
        await expect(clear).to_be_disabled()
        await told.get_by_role("button", name="Undo").click()
        await window.until(f"{OWNED} === 'radio'", "it is on again")
        await expect(told).to_have_count(0)
    assert window.faults == []


@pytest.mark.parametrize("scenario", SCENARIOS)
async def test_no_label_covers_another_or_a_person_on_a_phone(
    browser: Browser, commands: Commands, scenario: str
) -> None:
    page_is_built()
    site = await running(commands, scenario, "--users", "2")
    window = await Window.open(browser, site.url, **PHONE)
    await window.is_shown()
    await window.until("[...window.pointit.site.people.values()].every(({ pose }) => pose)", "the poses")
    await window.is_still()
    labels: set[str] = set()
    for _ in range(LOOKS):
        await window.is_drawn_anew()
        seen: dict[str, Any] = await window.page.evaluate(SEEN)
        labels |= set(seen["labels"])
        for name, its in seen["labels"].items():
            assert [
                text for text, other in seen["labels"].items() if text != name and meet(its, other)
            ] == [], name
            assert not any(meet(its, free) for free in (*seen["heads"], *seen["people"], *seen["cards"])), (
                name
            )
    assert labels
    assert not [name for name in labels if "led_" in name or "_" in name], labels
    assert window.faults == []
