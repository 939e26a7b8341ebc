"""A room that maps itself: from the button in the page to the map, and a cursor on it."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Browser, Page, expect

from pointit.bridges.web.scan.simulated_room import ROOM, pixel_places
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.schemas import Strip
from tests.e2e.web.axe import check_look
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.site import SitePage
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.commands import Commands
from tests.support.links import link_in
from tests.unit.pui.room import pose_at, room

pytestmark = [pytest.mark.slow, pytest.mark.long]

ORIGIN = "shelf_low"
MOST_VIEWS = 6
CAMERA_WIDTH = 800
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "ignore_https_errors": True}
REFUSED = """
navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException("no", "NotAllowedError"));
"""
ANOTHER_VIDEO = """
navigator.mediaDevices.getUserMedia = async () => {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [320, 180];
  const context = canvas.getContext("2d");
  setInterval(() => {
    context.fillStyle = "#333";
    context.fillRect(0, 0, 320, 180);
    context.fillStyle = "#fa3";
    context.fillRect(performance.now() / 9 % 300, 50, 20, 20);
  }, 66);
  return canvas.captureStream(15);
};
"""
INSECURE = "Object.defineProperty(window, 'isSecureContext', { value: false });"


async def scanning(commands: Commands, file: Path) -> str:
    """Start a scan with a simulated camera, and return the link of its page."""
    page_is_built()
    command = commands.start(
        "map", "scan", "-o", str(file), "--simulated", "--", "--web-port", "0", "--no-browser"
    )
    await command.says("map this room: open")
    return link_in("\n".join(command.logged()))


async def take_view(page: Page, number: int) -> None:
    await expect(page.get_by_role("button", name="Take this view")).to_contain_class("primary")
    await page.get_by_role("button", name="Take this view").click()
    await expect(page.locator("#strips")).to_contain_text(f"{number} view", timeout=30_000)
    await expect(page.locator("#trouble")).to_be_hidden()
    await expect(page.locator("#advice")).not_to_have_text("Calculating …", timeout=30_000)


def view_in(post: str | None) -> list[dict[str, tuple[float, float]]]:
    """Return image positions of ends of strips in a view that is posted, if it is one."""
    said = json.loads(post or "{}")
    names = {0: "shelf_low:0", 9: "shelf_low:89", 10: "shelf_high:0"}
    return (
        [{names[i]: (u, v) for i, u, v in said["seen"] if i in names}] if said.get("kind") == "view" else []
    )


async def tap(page: Page, u: float, v: float) -> None:
    """Tap the still at an image position of the simulated camera, whose pictures are larger."""
    still = page.locator("#still")
    assert int(await still.evaluate("still => still.width")) <= 640, "a phone has no room for whole pictures"
    scale = float(await still.evaluate(f"still => still.clientWidth / {CAMERA_WIDTH}"))
    await still.click(position={"x": u * scale, "y": v * scale})


def seen_from_origin(strips: tuple[Strip, ...]) -> dict[str, tuple[Vec3, ...]]:
    """Return the true places of pixels, as the map that begins at `ORIGIN` should have them."""
    base = next(strip for strip in strips if strip.id == ORIGIN)
    (x0, y0, _), (x1, y1, _) = base.line_m[0], base.line_m[-1]
    low = min(z for strip in strips for _, _, z in strip.line_m)
    heading = math.atan2(y1 - y0, x1 - x0)
    return {
        strip.id: tuple(
            vector.rotate_z(vector.subtract(place, (x0, y0, low)), -heading) for place in pixel_places(strip)
        )
        for strip in strips
    }


async def test_scan_on_the_page_gives_a_map_with_true_positions(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    """The lights really blink through led-driver, a rendered camera sees them with noise and tremor."""
    file = tmp_path / "room.yaml"
    url = await scanning(commands, file)
    page = await (await browser.new_context(**PHONE)).new_page()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    views: list[dict[str, tuple[float, float]]] = []
    page.on("request", lambda request: views.extend(view_in(request.post_data)))
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    await page.goto(url)
    await page.get_by_role("button", name="Start the simulated camera").click()
    await take_view(page, 1)
    await page.reload()  # as when the phone has slept
    await page.get_by_role("button", name="Start the simulated camera").click()
    for number in range(2, MOST_VIEWS + 1):
        await take_view(page, number)
        if number > 2 and "All lights are known to 1 cm" in (
            await page.locator("#advice").text_content() or ""
        ):
            break
    await expect(page.locator("#advice")).to_contain_text("All lights are known to 1 cm", timeout=1000)
    save, take = (page.get_by_role("button", name=name) for name in ("Save the map", "Take this view"))
    await expect(save).to_be_in_viewport(ratio=1)
    await expect(save).to_contain_class("primary")
    await expect(take).not_to_contain_class("primary")
    await page.get_by_text("Add a box, a screen or a table").click()
    await page.get_by_label("Name").fill("front")
    await page.get_by_label("It is a").select_option("screen")
    for view in (views[1], views[-1]):  # the still of the first one went when the phone slept
        for corner in ("shelf_low:0", "shelf_low:89", "shelf_high:0"):
            await tap(page, *view[corner])
    await expect(page.get_by_role("row", name="front")).to_contain_text("2 views± ")
    assert await page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    await check_look(page)
    await page.get_by_role("button", name="Save the map").click()
    await expect(page.locator("#saved")).to_contain_text("pointit map check")
    assert faults == []
    before = file.read_bytes()
    await page.get_by_role("button", name="Save the map").click()
    await expect(page.locator("#trouble")).to_contain_text("exists already")
    assert file.read_bytes() == before
    checked = await commands.start("map", "check", str(file)).end(code=0)
    assert "5 strips with 413 pixels, 2 lamps, 1 plane" in checked.out
    found = load_map(str(file), 0)
    assert found.planes[0].size_m == pytest.approx((1.48, 0.8), abs=0.06)
    apart_m = math.dist(*(lamp.position_m for lamp in found.lamps))
    assert apart_m == pytest.approx(math.dist((-0.4, 1.2, 1.1), (1.2, 1.9, 1.9)), abs=0.03)
    true_places = seen_from_origin(load_map(str(ROOM), 0).strips)
    async with room(map=str(file), surfaces=("strip",)) as here:
        await here.pose(pose=pose_at((0.4, -2.5, 0.0), 1.5))
        for name, places in true_places.items():
            for place in places[:: len(places) // 4]:
                cursor = await here.point_at(place)
                assert cursor.surface_id == name
                assert cursor.point_m is not None
                assert math.dist(cursor.point_m, place) < 0.03, (name, place, cursor.point_m)


async def test_the_operators_page_lets_a_phone_map_the_room(browser: Browser, shared_site: SitePage) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(NO_WEBGL,))
    page = window.page
    await page.get_by_role("tab", name="Set up").click()
    await page.get_by_role("button", name="With a phone").click()
    dialog = page.get_by_role("dialog", name="Map this room with a phone")
    await expect(dialog.get_by_role("img", name="QR code")).to_be_visible()
    url = await dialog.locator("a").get_attribute("href")
    assert url is not None
    assert window.faults == []
    for script, sentence in ((REFUSED, "The camera was refused"), (INSECURE, "only over https")):
        phone = await (await browser.new_context(**PHONE)).new_page()
        await phone.add_init_script(script)
        await phone.goto(url)
        await check_look(phone)
        await phone.get_by_role("button", name="Start the camera").click()
        await expect(phone.locator("#trouble")).to_contain_text(sentence)
        await expect(phone.get_by_role("button", name="Start the camera")).to_be_enabled()


async def test_a_video_of_something_else_is_no_view(browser: Browser, shared_site: SitePage) -> None:
    page = await (await browser.new_context(**PHONE)).new_page()
    await page.add_init_script(ANOTHER_VIDEO)
    await page.goto(shared_site.url)
    await page.goto(f"{shared_site.origin}/scan")
    await page.get_by_role("button", name="Start the camera").click()
    await page.get_by_role("button", name="Take this view").click()
    await expect(page.locator("#trouble")).to_contain_text("The camera sees no lights that blink")
    await expect(page.get_by_role("button", name="Take this view")).to_be_enabled()
    await expect(page.locator("#finish")).to_be_hidden()
