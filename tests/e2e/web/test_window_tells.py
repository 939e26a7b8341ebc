"""Messages of the page: a wrong package, a service that hangs, past events; the plan; at 200 % zoom."""

import os
import re
import signal
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.async_api import Browser, expect

from pointit.schemas import SelectionEvent, SetSpeed
from pointit.schemas.topics import SELECTION_EVENTS, SET_SPEED
from tests.e2e.web.axe import violations
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import NO_WEBGL, TOLD, USUAL_MPS, Theme, Window
from tests.support.bench import until
from tests.support.buses import is_listening
from tests.support.commands import onlooker

pytestmark = pytest.mark.slow

ZOOMED = (720, 450)
"""CSS pixels of a 1440 x 900 window at 200 % zoom."""
SOUNDS = """
window.sounds = [];
const start = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (...when) {
  window.sounds.push(this.type);
  return start.apply(this, when);
};
document.addEventListener("DOMContentLoaded", () => new MutationObserver(() => {
  window.wrong ??= document.querySelector(".toast[data-kind=wrong]")?.cloneNode(true);
}).observe(document.body, { childList: true, subtree: true }));
"""
"""Keeps sounds, and the first toast of something wrong, which is there for seconds only."""
BAD_AND_BORDER = """() => {
  const toast = window.wrong;
  document.getElementById("toasts").append(toast);
  const border = getComputedStyle(toast).borderTopColor;
  toast.style.color = "var(--bad)";
  return [getComputedStyle(toast).color, border];
}"""
FREE_HEIGHT = """() => {
  const view = document.getElementById("view").getBoundingClientRect(), middle = view.top + view.height / 2;
  const cards = [...document.querySelectorAll("#guide, #cameras")]
    .map((card) => card.getBoundingClientRect()).filter(({ height }) => height > 0);
  const above = cards.filter(({ top }) => top < middle).map(({ bottom }) => bottom);
  const below = cards.filter(({ top }) => top >= middle).map(({ top }) => top);
  return Math.min(view.bottom, ...below) - Math.max(view.top, ...above);
}"""
"""Height of the scene that no card covers, px."""
LEAST_FREE_PX = 160.0
LEAST_PANEL_PX = 380.0


PLAN_COLORS = """() => {
  const of = (selector, property) => {
    const found = document.querySelector(selector);
    return found ? getComputedStyle(found)[property] : "none";
  };
  return {
    paper: of(".plan", "backgroundColor"), belt: of(".plan-belt", "fill"), strip: of(".plan-strip", "stroke"),
    ray: of(".plan-ray", "stroke"), ray_edge: of(".plan-ray-edge", "stroke"),
    ring: of(".plan-cursor", "stroke"), ring_edge: of(".plan-cursor-edge", "stroke"),
  };
}"""
VITAL = {"pui": "Cursors and lights do not move", "selector": "Nothing can be selected"}
"""Text over the scene, by the service that hangs."""
THEMES: tuple[Theme, ...] = ("light", "dark")
LEAST_CONTRAST = 3.0
"""WCAG 2.2, 1.4.11: of graphics."""


def contrast(one: str, other: str) -> float:
    def luminance(color: str) -> float:
        assert color.startswith("rgb("), color
        parts = [int(part) / 255 for part in re.findall(r"\d+", color)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


async def test_a_wrong_package_is_not_praised(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(SOUNDS, TOLD), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    events: list[SelectionEvent] = []
    async with onlooker(shared_site.endpoint) as seen:
        await page.get_by_role("button", name="Point with the mouse").click()
        guide = page.locator("#guide")
        await expect(guide).to_contain_text("You are the arm now")
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        await window.selects(
            seen.bus, "blue", lambda: any((each.event, each.kind) == ("selected", "blue") for each in events)
        )
        await window.has_told("You selected a blue package, which should not be selected.")
        await window.has_told("Not wanted: blue")
        await window.until("window.sounds.at(-1) === 'sawtooth'")
        bad, border = await page.evaluate(BAD_AND_BORDER)
        assert border == bad
        await seen.bus.call(SET_SPEED, SetSpeed(speed_mps=USUAL_MPS))
        await window.has_told("Not wanted, and left at bay")
    assert window.faults == []


@pytest.mark.parametrize("site", [("scenario_4", "--processes")], indirect=True)
async def test_vital_service_that_hangs_is_told_over_the_scene(browser: Browser, site: SitePage) -> None:
    port = urlsplit(site.origin).port or 0
    await until(lambda: is_listening(port), what="the page's own process to listen")
    window = await Window.open(browser, site.url)
    await window.is_shown()
    outage = window.page.locator("#outage")
    await expect(outage).to_be_hidden()
    for service, effect in VITAL.items():
        pid: int = await window.until(f"window.pointit.site.health.get({service!r})?.pid ?? 0")
        os.kill(pid, signal.SIGSTOP)
        try:
            cause = re.compile(
                f"{effect}: {service} (is present but has not reported for|should run and does not)"
            )
            await expect(outage).to_contain_text(cause, timeout=60_000)
            assert await outage.get_attribute("role") == "alert"
        finally:
            os.kill(pid, signal.SIGCONT)
        await expect(outage).to_be_hidden(timeout=60_000)


async def test_page_opened_late_has_the_messages_of_before(browser: Browser, shared_site: SitePage) -> None:
    events: list[SelectionEvent] = []
    async with onlooker(shared_site.endpoint) as seen:
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        await until(lambda: any(each.event == "selected" for each in events), 60, "a selection")
    number = next(each for each in events if each.event == "selected").object_id.rpartition("-")[2]
    window = await Window.open(browser, shared_site.url)
    await window.is_shown()
    log: list[dict[str, Any]] = await window.until(
        "(() => { const { log } = window.pointit.site; return log.length ? log : null; })()"
    )
    (line,) = [each for each in log if each["text"].endswith(f" {number}") and "selected" in each["text"]]
    assert line["who"] == "user1"
    assert line["at"] < await window.page.evaluate("Date.now()")
    praised = window.page.locator(".toast[data-kind=done], .toast[data-kind=wrong]")
    assert await praised.all_text_contents() == [], "what is past does not happen again"
    await window.page.get_by_role("tab", name="Health").click()
    await expect(window.page.get_by_label("Messages, newest first")).to_contain_text(line["text"])


async def test_plan_shows_an_unlit_strip_edged_rays_and_rings(
    browser: Browser, shared_site: SitePage
) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(NO_WEBGL,), reduced_motion="reduce")
    await expect(window.page.locator("svg.plan-map")).to_be_visible()
    await window.is_shown()
    paper = ""
    for theme in THEMES:
        await window.page.emulate_media(color_scheme=theme)
        color: dict[str, str] = await window.until(
            f"(() => {{ const seen = ({PLAN_COLORS})();"
            f"return seen.paper !== '{paper}' && !Object.values(seen).includes('none') && seen; }})()",
            f"a ray and its ring, {theme}",
        )
        paper = color["paper"]
        assert contrast(color["strip"], color["paper"]) >= LEAST_CONTRAST, theme
        assert contrast(color["strip"], color["belt"]) >= LEAST_CONTRAST, theme
        for edge, inner in (("ray_edge", "ray"), ("ring_edge", "ring")):
            seen = max(contrast(color[edge], color["paper"]), contrast(color[inner], color["paper"]))
            assert seen >= LEAST_CONTRAST, (edge, theme)
            assert contrast(color[edge], color[inner]) >= LEAST_CONTRAST, (edge, theme)


async def test_scene_and_controls_fit_side_by_side_at_200_percent(
    browser: Browser, shared_site: SitePage
) -> None:
    window = await Window.open(browser, shared_site.url, size=ZOOMED)
    page = window.page
    await window.is_shown()
    await expect(page.locator("#guide")).to_be_visible()
    assert await page.evaluate(FREE_HEIGHT) >= LEAST_FREE_PX
    for tab in ("Control", "Health"):
        await page.get_by_role("tab", name=tab).click()
        assert await page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        panel = await page.locator("#panel").bounding_box()
        assert panel is not None
        assert panel["height"] >= LEAST_PANEL_PX
    await page.get_by_role("tab", name="Control").click()
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    assert await page.evaluate(FREE_HEIGHT) >= LEAST_FREE_PX
    await page.get_by_role("button", name="Give back").click()
    await expect(page.get_by_role("radio", name="Demo")).to_be_checked()
    assert window.faults == []


async def test_without_webgl_the_plan_shows_the_conveyor(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(NO_WEBGL,))
    page = window.page
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
    assert window.faults == []
