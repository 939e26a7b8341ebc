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
from tests.e2e.web.window import LENS, PATIENCE_S, TOLD, Window
from tests.support.environments import fetched
from tests.support.pace import Patience

pytestmark = [
    pytest.mark.slow,
    pytest.mark.long,
    pytest.mark.index,
    pytest.mark.parametrize("shared_site", ["shelf"], indirect=True),
]

PEER = Path(__file__).parent / "headset"
SHELF = load_map("shelf", 0)
POSITIONS = {lamp.id.replace("_", " "): np.array(lamp.position_m) for lamp in SHELF.lamps} | {
    f"the middle of the top of {thing.label or thing.id}": np.add(thing.center_m, (0, 0, thing.size_m[2] / 2))
    for thing in SHELF.things
}
"""Positions, {W}, that a note may ask for."""
YAW_RAD = 2.1
"""Azimuth of the x axis of the headset's space in {W}."""
ORIGIN_M = np.array([1.5, -0.7, 0.04])
"""Its origin in {W}."""
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
FRAMES = """() => new Promise((done, fail) => {
  const session = headset.activeSession;
  let left = 3;
  const frame = () => (left-- ? session.requestAnimationFrame(frame) : done());
  session.addEventListener("end", () => fail(new Error("the session has ended")));
  frame();
})"""
"""Frames of the session: the page's own may be more."""
PRESS = """() => new Promise((done, fail) => {
  const session = headset.activeSession, began = performance.now();
  const once = (kind, act) => session.addEventListener(kind, act, { once: true });
  once("selectstart", () => {
    while (performance.now() - began < STALL_MS);
    RELEASE;
  });
  once("selectend", done);
  once("end", () => fail(new Error("the session has ended")));
  PULL;
})"""
"""Press and release in two frames, between which `STALL_MS` pass."""
LOSE = """() => new Promise((done) => {
  const canvas = document.querySelector("canvas"), session = headset.activeSession;
  const lost = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
  session.addEventListener("end", () => setTimeout(() => lost.restoreContext()));
  canvas.addEventListener("webglcontextrestored", () => done());
  session.requestAnimationFrame(() => lost.loseContext()); // the emulator can begin no frame without graphics
})"""
"""Lose the graphics, and bring them back when the session has ended: by the page's time, which waits 5 s."""
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
RIGHT_HAND = "[...headset.activeSession.inputSources].some(({ hand }) => hand?.get('index-finger-tip'))"
NOTE = "window.pointit.stats.note"
CURSOR = "Math.max(0, ...[...window.pointit.site.people.values()].map(({ cursorAt }) => cursorAt))"
LINES = "[...window.pointit.site.people.values()].map(({ line }) => line)"
MINE = f"{LINES}.find((line) => line?.is_mine && line.moved_by === 'headset')?.user"
ORIGIN = f"window.pointit.site.people.get({MINE})?.cursor?.origin_m"
ORIGIN_X = f"({ORIGIN}?.[0] ?? 0)"
TRIGGER = "headset.controllers.right"
PULL = "updateButtonValue('trigger', {})"
FIRED = """([id, user, since]) => {
  const event = window.pointit.site.changes.get(id)?.selected;
  return event?.user === user && Number(event.stamp_ns) > since;
}"""
SITE_NS = "Number(window.pointit.site.sentNs)"
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
    window = await Window.open(browser, shared_site.url, scripts=(emulator, INSTALL, TOLD))
    await window.is_shown()
    yield window
    assert window.faults == []
    assert await window.violations() == []


def in_session(at_m: NDArray[np.float64]) -> list[float]:
    """Return a point of {W} in the headset's space."""
    cosine = math.cos(YAW_RAD)
    sine = math.sin(YAW_RAD)
    x, y, z = at_m - ORIGIN_M
    return [float(part) for part in TO_SESSION @ (cosine * x + sine * y, cosine * y - sine * x, z)]


async def enter(window: Window) -> None:
    await window.page.get_by_role("button", name="In your room").click()
    await window.until(f"headset.activeSession && {NOTE}", "a note of the session")
    await expect(window.page.get_by_role("button", name="Leave your room")).to_be_visible()


async def put(window: Window, device: str, at_m: list[float]) -> None:
    await window.page.evaluate(f"at => {device}.position.set(...at)", at_m)
    await window.page.evaluate(FRAMES)


async def press(window: Window, device: str, value: str, stall_ms: int = 0) -> None:
    """Press and release in the next frame, which comes `stall_ms` later at least."""
    script = PRESS.replace("PULL", f"{device}.{value.format(1)}").replace("STALL_MS", f"{stall_ms}")
    await window.page.evaluate(script.replace("RELEASE", f"{device}.{value.format(0)}"))


async def touch(
    window: Window, device: str, press_value: str, tip_m: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> None:
    """Touch what three notes ask for, by presses between which a busy machine draws nothing for long."""
    for count in (1, 2, 3):
        note = await window.until(NOTE)
        asked = re.fullmatch(rf"Touch (.+) \({count} of 3\) with .+", note)
        assert asked, note
        at_m = in_session(POSITIONS[asked[1]])
        await put(window, device, [part - offset for part, offset in zip(at_m, tip_m, strict=True)])
        await window.page.evaluate(FRAMES)  # the position before a pinch counts
        await press(window, device, press_value, stall_ms=1600 if count == 1 else 0)


async def fires(window: Window, name: str, eyes_m: NDArray[np.float64], at_m: NDArray[np.float64]) -> bool:
    """Hold the tip of the controller on the line from the eyes to the thing `name` at `at_m` until it fires.

    Returns False if the arm was lost meanwhile, as after some seconds without a frame.
    """
    evaluate = window.page.evaluate
    line = at_m - eyes_m
    if not await evaluate(MINE):
        await press(window, TRIGGER, PULL)
        await window.until(f"{MINE} && {ORIGIN_X} < -0.8", "the wearer points")
    user = await evaluate(MINE)
    since_ns = await evaluate(SITE_NS)
    await put(window, TRIGGER, in_session(eyes_m + 0.5 * line / np.linalg.norm(line)))
    await window.until(f"!{MINE} || ({FIRED})({[name, user, since_ns]})", f"{name} fires", 2 * PATIENCE_S)
    origin_m = await evaluate(ORIGIN)
    return bool(origin_m) and float(np.linalg.norm(np.array(origin_m) - eyes_m)) < 0.02


async def is_aligned(window: Window) -> bool:
    """Look from somewhere, and return True if all things are drawn in their true directions (< .01°)."""
    eye_m = np.array([0.4, -0.9, 1.62])
    turned = 0.7
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


async def test_scene_in_the_headset_is_aligned_by_three_touched_things(headset: Window) -> None:
    page = headset.page
    await page.mouse.move(500, 450)
    await page.evaluate("addEventListener('wheel', () => (window.wheeled = true), true)")
    await page.mouse.wheel(0, 240)  # a camera that somebody has moved stays where it is when cards change
    await headset.until("window.wheeled", "the page knows of the wheel")
    await headset.is_still()
    before = await page.evaluate(LENS), await canvas(headset)
    await enter(headset)
    await touch(headset, TRIGGER, PULL)
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


async def test_hand_alignment_is_used_by_the_visit_after_lost_graphics(headset: Window) -> None:
    page = headset.page
    await page.evaluate(REFUSE)
    await page.get_by_role("button", name="In your room").click()
    await headset.has_told("did not allow this page to show your room")
    await page.evaluate("delete navigator.xr.requestSession")
    await enter(headset)
    await page.evaluate("headset.primaryInputMode = 'hand'")
    await headset.until(RIGHT_HAND, "the hand is tracked")
    await touch(headset, "headset.hands.right", "updatePinchValue({})", tuple(await page.evaluate(TIP)))
    await headset.until("localStorage.getItem('pointit-anchor')", "the anchor is stored")
    await page.evaluate(LOSE)
    await enter(headset)
    await headset.until(f"{NOTE}.startsWith('The alignment of your last visit is used.')")
    assert await is_aligned(headset)


async def test_headset_fires_three_boxes_and_then_releases_the_arm(headset: Window) -> None:
    """The boxes of the shelf are .7 m apart, and seen from 3.5 m as others .4 m apart are from 2 m.

    Those are in `tests/integration/web/test_headset_selects.py`, with pinches and another person.
    """
    page = headset.page
    await enter(headset)
    await touch(headset, TRIGGER, PULL)
    eyes_m = np.array([-0.9, 0.0, 1.5])
    await put(headset, "headset", in_session(eyes_m))
    for thing in [each for each in SHELF.things if each.id in ("nuts", "bolts", "washers")]:
        patience = Patience(4 * PATIENCE_S)
        while not await fires(headset, thing.id, eyes_m, np.array(thing.center_m)):
            assert not patience.is_over(), f"waited {patience} in vain: {thing.id} does not fire"
    await page.evaluate("headset.activeSession.end()")
    await headset.until(f"!{MINE}", "the arm is their own again")
