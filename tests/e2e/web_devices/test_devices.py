"""Devices in the page: a WLED and a network wrist are found, connected, tested and remembered."""

from pathlib import Path

import pytest
import yaml
from playwright.async_api import Browser, expect

from pointit.geometry.rotation import IDENTITY, Quaternion
from tests.e2e.web.axe import violations as axe_violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import running
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.bench import until
from tests.support.commands import Commands
from tests.support.tracker import MAC, tracker
from tests.support.wled import Wled, wled

pytestmark = [pytest.mark.slow, pytest.mark.long]

ROOM = """\
strips:
  shelf: {line: [[1.0, 2.9, 1.2], [3.0, 2.9, 1.2]], pixels: 120}
"""
RAISED: Quaternion = (0.0, -(0.5**0.5), 0.0, 0.5**0.5)
"""The arm straight up, after `IDENTITY`, level ahead."""
GREEN = b"\0\xff\0"
RED = b"\xff\0\0"


def shows_pattern(light: Wled) -> bool:
    ends = 12  # a tenth of the pixels
    return any(
        frame.startswith(GREEN * ends) and frame.endswith(RED * ends) and frame.count(RED) > ends
        for frame in light.shown
    )


async def test_connected_light_and_wrist_come_back_in_the_next_run(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    page_is_built()
    path = tmp_path / "my_room.yaml"
    state = tmp_path / "state"
    path.write_text(ROOM)
    arguments = ("scenario_2", "--set", f"pui.map={path}", "--pose", "2,0.8", "--duration", "600")
    async with wled() as light, tracker() as wrist:
        site = await running(commands, *arguments, state=state)
        window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
        page = window.page
        await page.get_by_role("tab", name="Set up").click()
        look = page.get_by_role("button", name="Look for devices")
        kitchen = page.get_by_role("listitem").filter(has_text="Kitchen, 120 pixels")
        found = page.get_by_role("listitem").filter(has_text=MAC)
        for _ in range(10):  # a busy machine answers late
            await look.click()
            await expect(look).to_be_enabled()
            if await kitchen.count() and await found.count():
                break
        await kitchen.get_by_label("Shows").select_option("A new strip in the map")
        await kitchen.get_by_role("button", name="Connect").click()
        await expect(page.get_by_text("it is at a default place in the map")).to_be_visible()
        assert yaml.safe_load(path.read_text())["strips"]["Kitchen"]["pixels"] == 120
        await page.get_by_role("button", name="Test pattern on strip Kitchen").click()
        await until(lambda: shows_pattern(light), what="the test pattern")

        await found.get_by_label("Who wears it").fill("anna")
        await found.get_by_role("button", name="Connect").click()
        dialog = page.get_by_role("dialog", name="anna: wear it like this")
        await expect(dialog).to_be_visible()
        assert await axe_violations(page) == []
        await dialog.get_by_role("button", name="Next").click()
        await page.get_by_role("button", name="Begin").click()
        dialog = page.get_by_role("dialog")
        await expect(dialog.get_by_role("status")).to_contain_text("point straight up")
        wrist.orientation = RAISED
        await expect(dialog.get_by_role("status")).to_have_text("It sits as assumed.")
        wrist.orientation = IDENTITY
        raised = wrist.sent
        await until(lambda: wrist.sent > raised + 50, what="a level arm")
        await dialog.get_by_role("button", name="I point there now").click()
        await expect(dialog).to_have_count(0)
        await expect(page.get_by_text("battery 82 %")).to_be_visible()
        await window.until("window.pointit.site.people.get('anna')?.cursor != null", "anna points")
        assert await axe_violations(page) == []
        await site.command.stop(code=0)
        await until(lambda: not any(light.shown[-1]), what="a dark strip at the end")
        light.shown.clear()
        await wrist.unplug()  # as every tracker that has lost its server, it calls again
        await wrist.plug()

        site = await running(commands, *arguments, state=state)
        window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
        page = window.page
        await window.until("window.pointit.site.people.get('anna')?.cursor != null", "anna is back")
        await until(lambda: bool(light.shown), what="frames on the light")
        await page.get_by_role("tab", name="Set up").click()
        for name in ("Kitchen", MAC):
            await page.get_by_role("button", name=f"Forget {name}").click()
        await expect(page.get_by_role("button", name="Forget")).to_have_count(0)
        await window.until("!window.pointit.site.people.has('anna')", "anna has left")
    assert "Kitchen" not in next(state.rglob("devices.json")).read_text()
