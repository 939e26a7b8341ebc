"""The room in the page at four sizes, in two themes: in sight below the banner, people and things free."""

import json
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import running
from tests.e2e.web.window import Theme, Window
from tests.support.commands import Commands
from tests.support.pace import Patience

pytestmark = [pytest.mark.slow, pytest.mark.long]

SIZES = ((1280, 800), (1920, 1080), (720, 450), (390, 844))
THEMES: tuple[Theme, ...] = ("light", "dark")
MAP = """\
lamps:
  door: {position: [0.34, 0.9, 0.86]}
  window: {position: [1.9, 0.75, 0.9]}
  far: {position: [3.0, 3.5, 1.8]}
strips: {sideboard: {line: [[-0.5, 2.5, 1.0], [1.5, 2.5, 1.0]], pixels: 60}}
boxes: {table: {center: [2.6, 1.6, 0.4], size: [1.2, 0.7, 0.8]}}
planes: {wall: {center: [0, 25, 3], normal: [0, -1, 0], size: [50, 6]}}
things:
  radio: {center: [0.2, 1.8, 1.1], size: [0.4, 0.3, 0.2], mode: switch}
  keys: {center: [0.7, 1.8, 1.1], size: [0.2, 0.2, 0.2]}
"""
"""A room of one's own in a large hall; the names of the first two lamps would lie on heads of people."""
NAMES = ["radio", "keys"]
HOVERED = {"door": 0, "window": 1, "far": 2}
"""Lamps, whose names show under the mouse only; by number among the aims."""
POSES = ("0,0", "1.5,-0.1")
HELD = """
const go = window.requestAnimationFrame, held = [];
window.requestAnimationFrame = (callback) => held.push(callback);
window.release = () => { window.requestAnimationFrame = go; held.splice(0).forEach((each) => go(each)); };
window.later_ms = 0;
const now = performance.now.bind(performance);
performance.now = () => now() + window.later_ms;
new MutationObserver((_, watch) => {
  document.querySelector("#guide[data-mode=invite] .does button")?.focus();
  if (document.activeElement?.closest("#guide")) watch.disconnect();
}).observe(document, { subtree: true, attributeFilter: ["data-mode"] });
"""
"""Draws nothing until `release`; lets time pass by `later_ms`; the banner has the focus, so that it stays."""
SEEN = """() => {
  const { site, stats: { lens } } = window.pointit, { lamps, strips, things, boxes } = site.map;
  const rect = (element) => {
    const { left, top, right, bottom } = element.getBoundingClientRect();
    return [left, top, right, bottom];
  };
  const view = rect(document.querySelector("#view canvas"));
  const wide = view[2] - view[0], tall = view[3] - view[1];
  const row = (i) => [lens[i], lens[i + 4], lens[i + 8], lens[i + 12]];
  const dot = (at, i) => row(i).reduce((sum, each, axis) => sum + each * [...at, 1][axis], 0);
  const place = (at) => [
    view[0] + (dot(at, 0) / dot(at, 3) + 1) * wide / 2, view[1] + (1 - dot(at, 1) / dot(at, 3)) * tall / 2,
  ];
  const heads = [...site.people.values()].map(({ pose, profile }) => {
    const { footprint_to_neck_m, neck_to_eyes_m } = profile.body, [x, y, z] = pose.position_m;
    const eyes = [x, y, z + footprint_to_neck_m + neck_to_eyes_m], [left, top] = place(eyes);
    const half = 0.11 * Math.hypot(...row(1).slice(0, 3)) / dot(eyes, 3) * tall / 2;
    return [left - half, top - half, left + half, top + half];
  });
  const people = [...site.people.values()].map(({ pose, profile }) => {
    const { footprint_to_neck_m, neck_to_eyes_m } = profile.body, [x, y, z] = pose.position_m;
    const [left, top] = place([x, y, z + footprint_to_neck_m + neck_to_eyes_m]), bottom = place([x, y, z])[1];
    return [left - 2, top, left + 2, bottom];
  });
  const bodies = [...site.objects.values()].flatMap(({ objects }) => objects).map(({ position_m }) => {
    const [x, y] = place(position_m);
    return [x - 3, y - 3, x + 3, y + 3];
  });
  const aims = lamps.map((each) => each.position_m).concat(strips.flatMap((each) => each.line_m));
  const isShown = (element) => element.offsetHeight > 0 && element.style.visibility !== "hidden";
  const labels = [...document.querySelectorAll("#view > div > div")].filter(isShown);
  const cards = ["guide", "cameras", "chip"].map((id) => document.getElementById(id)).filter(isShown);
  return {
    view, heads, bodies, people, lens: lens.map((each) => each.toFixed(6)), size: [innerWidth, innerHeight],
    cards: cards.map(rect),
    aims: aims.concat([...things, ...boxes].map((each) => each.center_m)).map(place),
    labels: Object.fromEntries(labels.map((each) => [each.textContent, rect(each)])),
    overflow: document.documentElement.scrollWidth - innerWidth,
  };
}"""
COLOR = "(button) => getComputedStyle(button).backgroundColor"
COLORS = f"(buttons) => buttons.map({COLOR})"

Rect = tuple[float, float, float, float]


def meet(one: Rect, other: Rect) -> bool:
    """Return True if they have more in common than the rounding of sizes, px."""
    return all(one[axis] + 1 < other[axis + 2] and other[axis] + 1 < one[axis + 2] for axis in (0, 1))


async def settled(window: Window, size: tuple[int, int]) -> dict[str, Any]:
    """Return the picture's parts, px, as soon as the camera and the cards stand still at this size."""
    patience = Patience(30)
    before: dict[str, Any] = {}
    while True:
        seen: dict[str, Any] = await window.page.evaluate(SEEN)
        if seen["size"] == list(size) and all(before.get(name) == seen[name] for name in ("lens", "cards")):
            return seen
        assert not patience.is_over(), f"the scene goes on moving: {before}, {seen}"
        before = seen
        await window.is_drawn_anew()


def check(seen: dict[str, Any], where: str) -> None:
    assert seen["overflow"] <= 0, where
    left, top, right, bottom = seen["view"]
    middle = (top + bottom) / 2
    free_top = max((card[3] for card in seen["cards"] if card[1] + card[3] < 2 * middle), default=top)
    free_bottom = min((card[1] for card in seen["cards"] if card[1] + card[3] >= 2 * middle), default=bottom)
    assert len(seen["aims"]) == 8
    for x, y in seen["aims"]:
        assert left <= x <= right, where
        assert free_top <= y <= free_bottom, where
    spread = max(x for x, _ in seen["aims"]) - min(x for x, _ in seen["aims"])
    tall = max(y for _, y in seen["aims"]) - min(y for _, y in seen["aims"])
    assert spread > 0.4 * (right - left) or tall > 0.4 * (free_bottom - free_top), f"{where}: far away"
    assert len(seen["heads"]) == len(POSES)
    assert len(seen["bodies"]) == len(NAMES)
    labels: dict[str, Rect] = seen["labels"]
    for head in seen["heads"]:
        assert [name for name, label in labels.items() if meet(label, head)] == [], where
        assert not any(meet(card, head) for card in seen["cards"]), where
    for free in (*seen["bodies"], *seen["people"]):
        assert [name for name, label in labels.items() if meet(label, free)] == [], where
    for name, label in labels.items():
        met = [other for other, its in labels.items() if other != name and meet(label, its)]
        assert met == [], f"{where}: {name}"


async def test_own_room_looks_right_at_four_sizes_in_two_themes(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    page_is_built()
    path = tmp_path / "my_room.yaml"
    path.write_text(MAP, encoding="utf-8")
    poses = [word for pose in POSES for word in ("--pose", pose)]
    site = await running(commands, str(path), "--users", str(len(POSES)), *poses)
    window = await Window.open(browser, site.url, scripts=(HELD,), reduced_motion="reduce")
    page, guide = window.page, window.page.locator("#guide")
    await expect(page.get_by_text("Drawing the room …")).to_be_visible()
    await page.evaluate("window.release()")
    await window.is_shown()
    await expect(page.get_by_text("Drawing the room …")).to_be_hidden()
    await expect(guide).to_be_visible()
    take = page.get_by_role("button", name="Point with the mouse")
    await expect(take).to_be_focused()
    colors: list[str] = await page.locator("button:visible").evaluate_all(COLORS)
    assert colors.count(await take.evaluate(COLOR)) == 1, "there is one primary button"
    for theme in THEMES:
        await page.emulate_media(color_scheme=theme)
        for width, height in SIZES:
            await page.set_viewport_size({"width": width, "height": height})
            seen = await settled(window, (width, height))
            check(seen, f"{width} x {height}, {theme}")
            assert set(NAMES) <= set(seen["labels"]), f"{width} x {height}, {theme}"
            assert not set(HOVERED) & set(seen["labels"])
            if width == SIZES[0][0]:
                for name, number in HOVERED.items():
                    await page.mouse.move(*seen["aims"][number])
                    await window.until(f"{json.dumps(name)} in ({SEEN})().labels", f"the name of {name}")
                await page.mouse.move(5, 5)
            assert await violations(page) == []
        if theme == "light":  # the dark ones are seen with the chip
            banner = await guide.bounding_box()
            await page.evaluate("window.later_ms = 10_000; document.activeElement.blur()")
            await expect(guide).to_have_attribute("data-short", "")
            chip = await guide.bounding_box()
            assert banner is not None
            assert chip is not None
            assert chip["height"] < 0.6 * banner["height"]
            assert "This is a simulation" in await guide.inner_text()
            await take.focus()
            await page.keyboard.press("Tab")
            await expect(page.get_by_role("button", name="Point with your phone")).to_be_focused()
    await page.get_by_role("button", name="Help and keys").click()
    await page.get_by_text("What the words mean").click()
    await expect(page.get_by_role("definition").filter(has_text="a single light of the map")).to_be_visible()
    assert await violations(page) == []
    assert window.faults == []
    assert await window.violations() == []
