"""The scene in the viewer's own room, with the headset emulator of others (`iwer`) in Chromium."""

import math
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytest_asyncio
from numpy.typing import NDArray
from playwright.async_api import Browser, expect

from pointit.maps.file import load_map
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import LENS, PATIENCE_S, Window
from tests.support.environments import fetched
from tests.support.pace import Patience

pytestmark = [pytest.mark.slow, pytest.mark.parametrize("shared_site", ["shelf"], indirect=True)]

PEER = Path(__file__).parent / "headset"
SHELF = load_map("shelf", 0)
POSITIONS = {f"the middle of the top of {thing.label or thing.id}": thing for thing in SHELF.things}
YAW_RAD, ORIGIN_M = 2.1, np.array([1.5, -0.7, 0.04])
"""The headset's space in {W}: azimuth of its x axis, and its origin."""
INSTALL = """
window.headset = new IWER.XRDevice(IWER.metaQuest3, { ipd: 0 });
headset.installRuntime({ forceInstall: true }); // headless Chromium has a navigator.xr that supports nothing
const draws = window.requestAnimationFrame;
window.refused = 0;
window.requestAnimationFrame = (draw) => {
  const [, , caller] = new Error().stack.split("\\n");
  if (headset.activeSession && caller.includes("/static/")) return ++window.refused; // as headsets do
  return draws(draw);
};
"""
REFUSE = """() => {
  navigator.xr.requestSession = () => Promise.reject(new DOMException("", "NotAllowedError"));
}"""
FRAMES = """() => new Promise((done) => {
  let left = 4;
  const frame = () => (left-- ? requestAnimationFrame(frame) : done());
  frame();
})"""
TIP = """async () => {
  const session = headset.activeSession, space = await session.requestReferenceSpace("local-floor");
  const { x, y, z } = await new Promise((done) => session.requestAnimationFrame((_, frame) => {
    const { hand } = [...session.inputSources].find(({ handedness }) => handedness === "right");
    done(frame.getJointPose(hand.get("index-finger-tip"), space).transform.position);
  }));
  const { position } = headset.hands.right;
  return [x - position.x, y - position.y, z - position.z];
}"""
"""The tip of the right index finger relative to the position of its hand."""
NOTE = "window.pointit.stats.note"
CURSOR = "Math.max(0, ...[...window.pointit.site.people.values()].map(({ cursorAt }) => cursorAt))"
TO_SESSION = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""From z up to y up."""


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("headset")
    fetched(PEER, folder)
    return (folder / "node_modules/iwer/build/iwer.min.js").read_text(encoding="utf-8")


@pytest_asyncio.fixture
async def headset(browser: Browser, shared_site: SitePage, emulator: str) -> AsyncIterator[Window]:
    """Open the page of the shelf in a browser with an emulated headset."""
    window = await Window.open(browser, shared_site.url, scripts=(emulator, INSTALL))
    await window.is_shown()
    yield window
    assert window.faults == []
    assert await window.violations() == []


def in_session(at_m: NDArray[np.float64]) -> list[float]:
    """Return a point of {W} in the headset's space."""
    cosine, sine = math.cos(YAW_RAD), math.sin(YAW_RAD)
    x, y, z = at_m - ORIGIN_M
    return [float(part) for part in TO_SESSION @ (cosine * x + sine * y, cosine * y - sine * x, z)]


async def enter(window: Window) -> None:
    await window.page.get_by_role("button", name="In your room").click()
    await expect(window.page.get_by_role("button", name="Leave your room")).to_be_visible()
    await window.page.evaluate(FRAMES)


async def put(window: Window, device: str, at_m: list[float]) -> None:
    await window.page.evaluate(f"at => {device}.position.set(...at)", at_m)
    await window.page.evaluate(FRAMES)


async def press(window: Window, device: str, value: str) -> None:
    """Press and release as fast as the frames allow."""
    await window.page.evaluate(f"""() => new Promise((done) => {{
      {device}.{value.format(1)};
      requestAnimationFrame(() => requestAnimationFrame(() => {{
        {device}.{value.format(0)};
        done();
      }}));
    }})""")
    await window.page.evaluate(FRAMES)


async def wanted(window: Window) -> NDArray[np.float64]:
    """Return the position, {W}, that the note asks for."""
    note: str = await window.page.evaluate(NOTE)
    found = re.search(r"Touch (.+) \(\d of 3\)", note)
    assert found, note
    if found[1] in POSITIONS:
        x, y, z = POSITIONS[found[1]].center_m
        return np.array((x, y, z + POSITIONS[found[1]].size_m[2] / 2))
    return np.array(next(lamp.position_m for lamp in SHELF.lamps if lamp.id == found[1]))


async def touch(
    window: Window, device: str, press_value: str, tip_m: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> None:
    """Touch what the note asks for until the scene is aligned. Long presses of a slow machine skip."""
    patience = Patience(4 * PATIENCE_S)
    while not (await window.page.evaluate(NOTE)).startswith("Aligned"):
        assert not patience.is_over(), await window.page.evaluate(NOTE)
        at_m = in_session(await wanted(window))
        await put(window, device, [part - offset for part, offset in zip(at_m, tip_m, strict=True)])
        await window.page.evaluate(FRAMES)  # the position before a pinch counts
        await press(window, device, press_value)


async def is_aligned(window: Window) -> bool:
    """Look from somewhere, and return True if all things are drawn in their true directions (< .01°)."""
    eye_m, turned = np.array([0.4, -0.9, 1.62]), 0.7
    quaternion = [0.0, math.sin(turned / 2), 0.0, math.cos(turned / 2)]
    await window.page.evaluate("([x, y, z, w]) => headset.quaternion.set(x, y, z, w)", quaternion)
    await put(window, "headset", in_session(eye_m))
    lens: Any = np.array(await window.page.evaluate("[...window.pointit.stats.lens]")).reshape(4, 4).T
    axes = [row / np.linalg.norm(row[:3]) for row in (lens[0], lens[1], -lens[3])]
    ahead = YAW_RAD + turned  # azimuth of the eye's x axis
    true_axes = [[math.cos(ahead), math.sin(ahead), 0], [0, 0, 1], [math.sin(ahead), -math.cos(ahead), 0]]
    for thing in SHELF.things:
        drawn = np.array([axis[:3] @ thing.center_m + axis[3] for axis in axes])
        true = np.array(true_axes) @ (np.array(thing.center_m) - eye_m)
        sine = float(np.linalg.norm(np.cross(drawn, true)) / np.linalg.norm(drawn) / np.linalg.norm(true))
        if drawn @ true <= 0 or math.degrees(math.asin(min(sine, 1))) >= 0.01:
            return False
    return True


async def canvas(window: Window) -> str:
    return str(
        await window.page.evaluate("""() => {
      const { style } = document.querySelector("#view canvas");
      return JSON.stringify([style.width, style.height]);
    }""")
    )


async def test_the_scene_stands_in_the_room_where_three_things_were_touched(headset: Window) -> None:
    page, trigger = headset.page, "headset.controllers.right"
    await page.mouse.move(500, 450)
    await page.mouse.wheel(0, 240)  # a camera that somebody has moved stays where it is when cards change
    await headset.is_still()
    before = await page.evaluate(LENS), await canvas(headset)
    await enter(headset)
    await touch(headset, trigger, "updateButtonValue('trigger', {})")
    assert "Aligned: your touches agree with the map within 0.1 cm." in await page.evaluate(NOTE)
    assert await is_aligned(headset)
    cursor = await page.evaluate(CURSOR)
    await headset.until(f"window.refused > 0 && {CURSOR} > {cursor}", "cursors without frames of the page")
    await page.emulate_media(color_scheme="dark")  # the scene is built again
    assert await is_aligned(headset)
    await page.emulate_media(color_scheme="light")
    await page.evaluate("headset.activeSession.end()")  # the home button
    await expect(page.get_by_role("button", name="In your room")).to_be_visible()
    await headset.is_still()
    assert (await page.evaluate(LENS), await canvas(headset)) == before


async def test_hands_align_and_the_next_visit_uses_it_after_the_graphics_were_lost(headset: Window) -> None:
    page = headset.page
    await page.evaluate(REFUSE)
    await page.get_by_role("button", name="In your room").click()
    await expect(page.locator("#toasts")).to_contain_text("did not allow this page to show your room")
    await page.evaluate("delete navigator.xr.requestSession")
    await enter(headset)
    await page.evaluate("headset.primaryInputMode = 'hand'")
    await page.evaluate(FRAMES)
    await touch(headset, "headset.hands.right", "updatePinchValue({})", tuple(await page.evaluate(TIP)))
    await headset.until("localStorage.getItem('pointit-anchor')", "the anchor is stored")
    context = "document.querySelector('canvas').getContext('webgl2').getExtension('WEBGL_lose_context')"
    await page.evaluate(f"window.lost = {context}; lost.loseContext()")
    await expect(page.get_by_role("button", name="In your room")).to_be_visible()
    await page.evaluate("lost.restoreContext()")
    await headset.until("window.pointit.stats.fps > 0", "the page draws again")
    await enter(headset)
    await headset.until(f"{NOTE}.startsWith('The alignment of your last visit is used.')")
    assert await is_aligned(headset)
