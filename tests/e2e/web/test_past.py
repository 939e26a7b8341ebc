"""A recording in a browser: played, paused and scrubbed, and seen as it was, also without a server."""

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Browser, Locator, expect

from pointit.runtime.virtual_time import START_NS
from pointit.schemas import NS_PER_S, SelectionEvent
from tests.e2e.web.axe import violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.window import SHOWN, Window
from tests.support.commands import Commands
from tests.support.links import link_in
from tests.support.recorded import session, write_recording

pytestmark = [pytest.mark.slow, pytest.mark.long]

USER = "anna"
LENGTH_S = 10.0
"""The simulated person selects a package within this time."""

PLAYS = "window.pointit.site.playing?.is_playing"
POSITION = "(window.pointit.site.sentNs - window.pointit.site.timeline.began_ns) / 1e9"
SMALL = ((390, 844), (320, 640), (844, 390), (640, 400), (512, 384))
"""CSS pixels of phones, and of windows at 200 % zoom."""
BEYOND = """() => {
  const { scrollWidth, scrollHeight } = document.documentElement, beyond = [];
  if (scrollWidth > innerWidth || scrollHeight > innerHeight) beyond.push([scrollWidth, scrollHeight]);
  const shown = [...document.querySelectorAll("#panel, .transport > *")]
    .map((each) => [each.className, each.getBoundingClientRect(), each]).filter(([, { width }]) => width);
  for (const [name, { left, right, bottom }, each] of shown) {
    const isCut = each.scrollWidth > each.clientWidth + 1;
    if (left < 0 || right > innerWidth || bottom > innerHeight || isCut) beyond.push(name);
  }
  for (const [name, a] of shown) for (const [other, b] of shown) {
    const isBeside = a.left >= b.right - 1 || b.left >= a.right - 1;
    const isUnder = a.top >= b.bottom - 1 || b.top >= a.bottom - 1;
    if (a !== b && !isBeside && !isUnder) beyond.push(`${name} over ${other}`);
  }
  return beyond;
}"""
"""Parts that are cut off or lie over each other, and the size of a page larger than its window."""
SELECTED = "(window.pointit.site.selection?.objects ?? []).map(({ id }) => id)"


@dataclass(frozen=True)
class Recorded:
    path: Path
    event: SelectionEvent
    at_s: float

    @property
    def share(self) -> float:
        return self.at_s / LENGTH_S


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    page_is_built()
    entries = session("scenario_4", LENGTH_S, (USER,))
    path = tmp_path_factory.mktemp("recorded") / "lab.mcap"
    write_recording(path, entries)
    time_ns, event = next(
        (each.time_ns, each.body)
        for each in entries
        if isinstance(each.body, SelectionEvent) and each.body.event == "selected"
    )
    return Recorded(path, event, (time_ns - START_NS) / NS_PER_S)


class _Silent(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the base's name
        """Print nothing."""


@pytest.fixture
def file_server(tmp_path: Path) -> Iterator[str]:
    """Yield the address of a plain server of the test's folder."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Silent, directory=str(tmp_path))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


async def on(lane: Locator, share: float) -> tuple[float, float]:
    box = await lane.bounding_box()
    assert box is not None
    return box["x"] + share * box["width"], box["y"] + box["height"] / 2


async def test_recording_is_played_and_scrubbed(
    browser: Browser, commands: Commands, recorded: Recorded
) -> None:
    command = commands.start("page", str(recorded.path), "--port", "0", "--no-browser")
    await command.says("its link is in")
    url = link_in(command.out)
    window = await Window.open(browser, url, has_touch=True)
    page = window.page
    await window.is_shown()
    await expect(page.locator("#pill-text")).to_have_text("Past")
    await window.until(f"{POSITION} > 0.5", "it plays")
    await page.get_by_role("combobox", name="Speed").select_option("0.25")
    if not await page.evaluate(PLAYS):  # a busy machine has shown the page after the end
        await page.get_by_role("button", name="Play", exact=True).click()
        await window.until(PLAYS, "it plays again")
    await page.keyboard.press("Space")
    await window.until(f"{PLAYS} === false", "it pauses")

    lane = page.get_by_role("img", name=f"{USER}, Selected: 1")
    await page.mouse.move(*await on(lane, 0.95))
    await page.mouse.down()
    await window.until(f"{POSITION} > 0.9 * {LENGTH_S}", "the mouse holds the position")
    await window.until(f"{SELECTED}.length === 1", "what was selected then")
    await expect(page.locator(".state strong")).to_have_text("Pointing")
    assert await page.locator(".state .next").inner_text() == "", "nobody is told to point in the past"
    labels = await page.locator(".axis span").all_inner_texts()
    assert labels[0] == "0:00"
    assert len(labels) >= 3
    await page.mouse.move(*await on(lane, recorded.share - 0.05), steps=5)
    await window.until(f"{SELECTED}.length === 0", "what was selected before")
    await page.mouse.up()
    await page.mouse.move(*await on(lane, recorded.share))
    await expect(page.locator(".tip")).to_contain_text(f"selected {_called(recorded.event)}")

    await page.keyboard.press("e")
    await window.until(f"Math.abs({POSITION} - {recorded.at_s}) < 0.02", "a key leads to the selection")
    await expect(page.locator("#said")).to_contain_text(f"{USER}: selected {_called(recorded.event)}")
    assert await window.until(f"{SELECTED}.length && {SELECTED}") == [recorded.event.object_id]
    await page.keyboard.press("Shift+E")
    await window.until(f"{POSITION} < 1", "to the event before")
    before_s = await page.evaluate(POSITION)
    await page.keyboard.press(".")
    await window.until(f"{POSITION} > {before_s} && {POSITION} < {before_s} + 0.1", "to the next message")

    await page.touchscreen.tap(*await on(lane, 0.5))
    await window.until(f"Math.abs({POSITION} - {0.5 * LENGTH_S}) < 0.2", "a finger sets the position")
    assert await page.evaluate(PLAYS) is False
    slider = page.get_by_role("slider", name="Position")
    await slider.focus()
    await page.keyboard.press("End")
    await window.until(f"{POSITION} > {LENGTH_S} - 0.1", "the slider's own keys")
    await page.get_by_role("button", name="Play", exact=True).click()
    await window.until(f"{PLAYS} && {POSITION} < 0.9 * {LENGTH_S}", "from the beginning again")
    await page.get_by_role("combobox", name="Speed").select_option("8")
    await window.until(f"{PLAYS} === false", "the end")

    assert await violations(page) == []
    for width, height in SMALL:
        await page.set_viewport_size({"width": width, "height": height})
        await expect(lane).to_be_visible()
        assert await page.evaluate(BEYOND) == [], (width, height)
    assert await violations(page) == []
    assert (window.faults, await window.violations()) == ([], [])
    assert (await command.stop()).code == 0


async def test_page_with_its_recording_in_one_file_needs_no_pointit(
    browser: Browser, commands: Commands, recorded: Recorded, tmp_path: Path, file_server: str
) -> None:
    command = commands.start("page", str(recorded.path), "--to", str(tmp_path / "lab.html"))
    await command.end(code=0)

    window = await Window.open(browser, f"{file_server}/lab.html")
    page = window.page
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    await window.is_shown()
    await expect(page.locator("#drawing")).to_be_hidden()
    await window.until(f"{PLAYS} && {POSITION} > 0.5", "it plays")
    await page.keyboard.press("Space")
    await window.until(f"{PLAYS} === false", "it pauses")
    await page.get_by_role("slider", name="Position").focus()
    await page.keyboard.press("End")
    await window.until(f"{POSITION} > {LENGTH_S} - 0.1 && {SELECTED}.length === 1", "what was selected")
    await page.keyboard.press("Home")
    await window.until(f"{POSITION} < 0.1 && {SELECTED}.length === 0", "what was selected before")
    await page.get_by_role("combobox", name="Speed").select_option("8")
    await page.get_by_role("button", name="Play", exact=True).click()
    await window.until(f"{PLAYS} === false && {POSITION} > {LENGTH_S} - 0.1", "the end")
    assert (window.faults, [url for url in asked if not url.startswith("data:")]) == ([], [])

    around = tmp_path / "around.html"
    around.write_text('<!doctype html><iframe src="lab.html" width="820" height="480"></iframe>')
    window = await Window.open(browser, around.as_uri())
    frame = window.page.frames[1]
    await frame.wait_for_function(SHOWN)
    await frame.wait_for_function(f"{POSITION} > 0.5")
    await expect(frame.get_by_role("button", name="Pause")).to_be_visible()
    await expect(frame.locator("#panel")).to_be_hidden()
    assert window.faults == []


def _called(event: SelectionEvent) -> str:
    return f"{event.kind} {event.object_id.rpartition('-')[2]}"
