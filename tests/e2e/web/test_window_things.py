"""Things of a map in the page: fired by mouse, and the floor coloured by which are told apart from there."""

import re
from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.async_api import Browser, expect

from pointit.bridges.web.model.separability import floor
from pointit.maps.file import load_map
from tests.e2e.web.axe import violations as axe_violations
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.pace import Patience

pytestmark = [pytest.mark.slow, pytest.mark.parametrize("shared_site", ["shelf"], indirect=True)]

SHELF = load_map("shelf", 0)
BELOW_PX = 38
"""From the middle of a box's name down to the box."""
NAME = """name => {
  for (const label of document.querySelectorAll("#view > div > div")) {
    if (label.textContent !== name || label.style.visibility === "hidden") continue;
    const { x, y, width, height } = label.getBoundingClientRect();
    return [x + width / 2, y + height / 2];
  }
  return null;
}"""
WATCH = """
const frame = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (draw) => frame((now) => { draw(now); window.look?.(); });
window.watch = (x, y) => {
  const size = { width: 12, height: 12 }, small = Object.assign(document.createElement("canvas"), size);
  const context = small.getContext("2d", { willReadFrequently: true });
  window.seen = [1, 0];
  window.look = () => {
    const scene = document.querySelector("#view canvas");
    const { left, top, width } = scene.getBoundingClientRect();
    const scale = scene.width / width, at = [(x + 14 - left) * scale, (y - 6 - top) * scale];
    context.clearRect(0, 0, 12, 12);
    context.drawImage(scene, ...at, 12 * scale, 12 * scale, 0, 0, 12, 12);
    const { data } = context.getImageData(0, 0, 12, 12);
    if (data.some((value, index) => index % 4 === 3 && value < 255)) return; // not drawn in this frame
    const mean = data.reduce((sum, value, index) => sum + (index % 4 < 3 ? value : 0), 0) / (144 * 3 * 255);
    window.seen = [Math.min(window.seen[0], mean), Math.max(window.seen[1], mean)];
  };
};
"""
"""Keeps the least and the greatest brightness beside a place, of all frames: pictures miss some."""
SELECTED = "(window.pointit.site.selection?.objects ?? []).map(({ id }) => id)"


async def light(window: Window, x: float, y: float) -> float:
    """Return the mean brightness, 0 to 1, beside a place, where the mouse's own mark does not cover it."""
    clip = {"x": x + 14, "y": y - 6, "width": 12, "height": 12}
    return float(imread(BytesIO(await window.page.screenshot(clip=clip)))[:, :, :3].mean())


async def purple(window: Window) -> float:
    """Return the share of the scene that has the colour of confusion."""
    picture = imread(BytesIO(await window.page.locator("#view canvas").screenshot()))
    red, green, blue = (picture[:, :, band] for band in range(3))
    return float(((red > green + 0.06) & (blue > green + 0.06)).mean())


async def test_boxes_of_a_shelf_fire_and_a_switch_stays_on(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(browser, shared_site.url, size=(1280, 960), scripts=(WATCH,))
    page = window.page
    await window.is_shown()
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    await window.is_still()
    await expect(page.get_by_role("button", name="In your room")).to_be_hidden()  # there is no headset
    for name, told in (
        ("screws", "Fired"),
        ("bolts", "Fired"),
        ("washers", "Fired"),
        ("radio", "Switched on"),
    ):
        x, y = await window.until(f"({NAME})('{name}')", f"the name of {name} is shown")
        y += BELOW_PX
        (thing,) = (each for each in SHELF.things if each.id == name)
        await page.evaluate("([x, y]) => window.watch(x, y)", [x, y])
        at_m = await window.aimed_at(x, y, 10.0, settle_s=0.3)
        assert at_m is not None
        assert at_m[1] == pytest.approx(thing.center_m[1], abs=0.25), f"{name} is not below its name"
        reacted = page.locator("#toasts", has_text=f"{told}: {name}")
        await window.until("window.seen[1] > window.seen[0] + 0.15", f"{name} shows that it is pointed at")
        await expect(reacted).to_have_count(1, timeout=30_000)
    await page.mouse.move(1100, 600)
    await expect(page.locator("#toasts")).to_have_text("")
    assert await page.evaluate(SELECTED) == ["radio"], "buttons are ready again, the switch is on"
    darkest, _ = await page.evaluate("window.seen")
    assert await light(window, x, y) > darkest + 0.15
    await page.locator("body").press("x")
    await window.until(f"{SELECTED}.length === 0", "the switch is off again")
    await page.context.close()
    assert window.faults == []


async def test_tile_tries_its_thing_and_shows_who_fired_it_last(
    browser: Browser, shared_site: SitePage
) -> None:
    window = await Window.open(browser, shared_site.url, reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    tiles = page.get_by_role("listitem").filter(has=page.get_by_role("button", name="Try"))
    await expect(tiles).to_have_count(len(SHELF.things))
    radio = tiles.filter(has_text="Radio")
    await expect(radio).to_contain_text("Off")
    await radio.get_by_role("button", name="Try Radio").click()
    await expect(radio).to_contain_text("Switched on by operator")
    await expect(page.locator("#toasts")).to_contain_text("Switched on: Radio.")
    await expect(radio.get_by_text("On", exact=True)).to_be_visible()
    assert await axe_violations(page) == []
    await page.reload()
    await window.is_shown()
    await expect(radio).to_contain_text("Switched on by operator")  # also to who comes later
    await radio.get_by_role("button", name="Try Radio").press("Enter")
    await expect(radio).to_contain_text("Switched off by operator")
    kettle = tiles.filter(has_text="The kettle")
    await expect(kettle).to_contain_text("Fires on a press while somebody points at it.")
    await kettle.get_by_role("button").click()
    await expect(kettle).to_contain_text(re.compile("Fired by operator (just now|\\d+ s ago)"))
    viewer = await Window.open(browser, shared_site.viewer_url)
    await expect(viewer.page.get_by_text("Fired by operator")).to_be_visible(timeout=60_000)
    await expect(viewer.page.get_by_role("button", name="Try")).to_have_count(0)
    assert window.faults == viewer.faults == []


async def test_viewers_see_the_floor_coloured_by_things_told_apart(
    browser: Browser, shared_site: SitePage
) -> None:
    window = await Window.open(browser, shared_site.viewer_url)
    await window.is_shown()
    button = window.page.get_by_role("button", name="Told apart")
    legend = window.page.locator(".apart")
    await expect(button).to_have_attribute("aria-pressed", "false")
    plain = await purple(window)
    await window.page.locator("body").press("t")
    await expect(legend).to_contain_text("Where user1 stands: 2 of 6 told apart, not screws and nuts")
    patience = Patience(10)
    while await purple(window) < plain + 0.2:
        assert not patience.is_over(), "the scene's floor has no colour"
    plan = await Window.open(browser, shared_site.viewer_url, theme="dark", scripts=(NO_WEBGL,))
    await plan.is_shown()
    await plan.page.get_by_role("button", name="Told apart").click()
    squares = plan.page.locator(".plan-apart")
    told = np.asarray(floor(SHELF)["told_apart"])
    await expect(squares).to_have_count(int((told < 6).sum()))
    for each in (window, plan):
        assert await axe_violations(each.page) == []
    await squares.first.hover(force=True)
    await expect(plan.page.locator(".apart")).to_contain_text("Under the mouse: 2 of 6 told apart")
    await plan.page.locator("body").press("t")
    await expect(squares).to_have_count(0)
    await button.click()
    await expect(legend).to_be_hidden()
    for each in (window, plan):
        assert each.faults == []
        assert await each.violations() == []
