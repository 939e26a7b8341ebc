"""The plan editor: a strip moved by mouse and keys, undo, findings, a save that the running site follows."""

from pathlib import Path

import pytest
import yaml
from playwright.async_api import Browser, Locator, Page, expect

from tests.e2e.web.axe import violations as axe_violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import running
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.commands import Commands

pytestmark = pytest.mark.slow

ROOM = """\
# my room
lamps:
  door: {position: [0.2, 1.5, 2.0]}
  window: {position: [3.8, 1.5, 1.4]}   # west
strips:
  shelf: {line: [[1.0, 2.9, 1.2], [3.0, 2.9, 1.2]], pixels: 120}   # above the books
"""
CURSOR_Y = "window.pointit.site.people.get('user1')?.cursor?.point_m?.[1]"
THEIRS = "# theirs\n"


async def coordinates(side: Locator, end: str) -> list[float]:
    fields = side.get_by_role("group", name=end).get_by_role("textbox")
    return [float(await field.input_value()) for field in await fields.all()]


async def drag(page: Page, strip: Locator, dx: float, dy: float) -> None:
    """Drag `strip` by pixels, at a quarter of its length, without snapping."""
    box = await strip.locator(".edit-reach").bounding_box()
    assert box is not None
    x = box["x"] + box["width"] / 4
    y = box["y"] + box["height"] / 2
    await page.mouse.move(x, y)
    await page.mouse.down()
    await page.keyboard.down("Alt")
    for share in (0.5, 1.0):
        await page.mouse.move(x + share * dx, y + share * dy)
    await page.keyboard.up("Alt")
    await page.mouse.up()


async def press(page: Page, key: str, times: int = 1) -> None:
    for _ in range(times):
        await page.keyboard.press(key)


async def test_strip_is_moved_undone_checked_and_saved_and_the_cursor_follows(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    page_is_built()
    path = tmp_path / "my_room.yaml"
    path.write_text(ROOM)
    site = await running(commands, "scenario_2", "--set", f"pui.map={path}", "--pose", "2,0.8")
    window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
    await window.is_shown()
    page = window.page
    await page.get_by_role("tab", name="Set up").click()
    await page.get_by_role("button", name="Edit the map").click()
    editor = page.locator("dialog.editor")
    side = page.locator(".edit-side")
    strip = page.get_by_role("button", name="Strip shelf")
    status = side.get_by_role("status").first

    await drag(page, strip, 60, 40)
    x, y, z = await coordinates(side, "First end")
    assert (x > 1.1, y < 2.85, z) == (True, True, 1.2)
    assert (await coordinates(side, "Last end"))[:2] == pytest.approx([x + 2, y])
    await expect(strip).to_be_focused()
    await press(page, "Shift+ArrowDown", 3)
    await press(page, "ArrowLeft")
    await press(page, "PageUp", 2)
    assert await coordinates(side, "First end") == pytest.approx([x - 0.01, y - 0.3, 1.22])
    await press(page, "Control+z", 3)
    assert await coordinates(side, "First end") == pytest.approx([x, y - 0.3, 1.2])

    length = side.get_by_role("textbox", name="Length, m")
    await length.fill("nan")
    await expect(side.get_by_role("alert").filter(has_text="Write a number, such as 1.25.")).to_be_visible()
    await length.fill("2")
    await page.get_by_role("button", name="Lamp door").focus()
    await press(page, "Shift+PageDown", 21)
    finding = side.get_by_text("is 0.1 m below the floor; correct its z")
    await expect(finding).to_be_visible()
    assert await axe_violations(page) == []
    await press(page, "Control+z", 21)
    await expect(finding).to_have_count(0)

    assert path.read_text() == ROOM, "nothing is saved yet"
    await editor.get_by_role("button", name="Save", exact=True).click()
    await expect(status).to_contain_text(f"saved as …/{tmp_path.name}/my_room.yaml, and people point at it")
    saved = path.read_text()
    line = f"[[{x:g}, {y - 0.3:g}, 1.2], [{x + 2:g}, {y - 0.3:g}, 1.2]]"
    assert saved == ROOM.replace("[[1.0, 2.9, 1.2], [3.0, 2.9, 1.2]]", line)
    assert yaml.safe_load(saved)["strips"]["shelf"]["pixels"] == 120
    await window.until(f"Math.abs({CURSOR_Y} - {y - 0.3}) < 0.001", "the cursor is where the strip is now")

    path.write_text(saved + THEIRS)
    await strip.focus()
    await press(page, "ArrowUp")
    await page.keyboard.press("Control+s")
    await expect(status).to_contain_text("was changed by somebody else")
    assert path.read_text() == saved + THEIRS
    await editor.get_by_role("button", name="Load again").click()
    await expect(editor.get_by_role("button", name="Undo")).to_be_disabled()
    await strip.focus()
    assert await coordinates(side, "First end") == pytest.approx([x, y - 0.3, 1.2])
    await page.keyboard.press("Escape")
    await expect(editor).to_have_count(0)
    assert window.faults == []
    assert await window.violations() == []


HOME = """# two lights of a home, not placed yet
things:
  sofa: {home_assistant: light.sofa}
  tv: {home_assistant: switch.tv}
planes:
  north: {center: [0, 3, 1.25], normal: [0, -1, 0], size: [4, 2.5]}
"""


async def test_unplaced_things_are_spread_and_saved(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    page_is_built()
    path = tmp_path / "home.yaml"
    path.write_text(HOME)
    site = await running(commands, str(path), "--pose", "0,0")
    window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
    await window.is_shown()
    page = window.page
    await page.get_by_role("tab", name="Set up").click()
    await page.get_by_role("button", name="Edit the map").click()
    side = page.locator(".edit-side")

    spread = side.get_by_role("button", name="Spread 2 things along the walls")
    await spread.click()
    await expect(spread).to_be_hidden()
    await expect(page.get_by_role("button", name="Thing tv")).to_be_visible()
    assert await axe_violations(page) == []

    await page.locator("dialog.editor").get_by_role("button", name="Save", exact=True).click()
    await expect(side.get_by_role("status").first).to_contain_text("saved as")
    things = yaml.safe_load(path.read_text())["things"]
    assert things["sofa"]["center"] == pytest.approx([1, 2.8, 1.2])
    assert things["tv"]["center"] == pytest.approx([-1, 2.8, 1.2])
