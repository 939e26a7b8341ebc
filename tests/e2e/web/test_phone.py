"""The phone's page moves a person's arm in a running site, and is their button."""

import asyncio
import math

import pytest
from playwright.async_api import Browser, expect

from pointit.schemas import ButtonEvent, Cursor
from pointit.schemas.topics import BUTTON
from tests.e2e.web.axe import check_look
from tests.e2e.web.phone import CUES, NO_SOCKET, PhonePage, Source
from tests.e2e.web.site import SitePage
from tests.support.bench import until
from tests.support.commands import Onlooker, onlooker
from tests.support.pace import Patience

pytestmark = pytest.mark.slow

USER = "user1"


async def address(site: SitePage) -> str:
    """Return the address on this machine that pairs a phone, without encryption."""
    async with site.operator() as operator:
        secure = await operator.pair(USER)
    return site.origin + secure[secure.index("/phone") :]


def azimuth(cursor: Cursor) -> float:
    assert cursor.direction is not None
    return math.degrees(math.atan2(cursor.direction[1], cursor.direction[0]))


async def sweeps_the_ray(phone: PhonePage, seen: Onlooker, patience_s: float = 30.0) -> None:
    """Turn the phone left and right, and wait until the ray does the same."""
    begin = 0.0
    for yaw in (0.0, 30.0):
        patience = Patience(patience_s)
        while True:
            seen.cursors[USER].clear()
            for i in range(8):
                await phone.turn(yaw + 0.3 * (i % 2), -15)
                await asyncio.sleep(0.03)
            rays = [azimuth(cursor) for cursor in seen.cursors[USER] if cursor.direction is not None]
            last = rays[-5:]
            if len(last) == 5 and max(last) - min(last) < 1.5:
                turned = (last[-1] - begin + 180) % 360 - 180
                if yaw == 0 or abs(turned - 30) < 4:
                    begin = last[-1]
                    break
            assert not patience.is_over(), f"at yaw {yaw} the ray is at {last}"


@pytest.mark.parametrize(("source", "scheme"), [("event", "http"), ("sensor", "https")])
async def test_emulated_phone_moves_the_ray_by_its_own_turn(
    browser: Browser, shared_site: SitePage, source: Source, scheme: str
) -> None:
    async with shared_site.operator() as operator:
        url = await operator.pair(USER) if scheme == "https" else await address(shared_site)
    assert url.startswith(f"{scheme}://")
    phone = await PhonePage.open(browser, url, source=source)
    async with onlooker(shared_site.endpoint) as seen:
        await phone.start()
        await sweeps_the_ray(phone, seen)
    assert phone.faults == []


async def test_a_browser_that_refuses_the_socket_posts(browser: Browser, site: SitePage) -> None:
    phone = await PhonePage.open(browser, await address(site), scripts=(NO_SOCKET,))
    async with onlooker(site.endpoint) as seen:
        await phone.start()
        await expect(phone.page.locator("#figures")).to_contain_text("by posts")
        await sweeps_the_ray(phone, seen)
        await phone.page.get_by_role("button", name="Skip").tap()
        presses = await presses_of(phone, seen)
    assert [press.gesture for press in presses] == ["press"]
    assert await phone.page.evaluate("window.sockets") == 2
    assert phone.faults == []


async def presses_of(phone: PhonePage, seen: Onlooker) -> list[ButtonEvent]:
    """Tap the big button once and return the bus messages of it."""
    heard: list[ButtonEvent] = []
    seen.bus.subscribe(BUTTON, lambda event, user: heard.append(event) if user == USER else None)
    await phone.page.locator("#big").tap()
    await until(lambda: bool(heard), 10, "a press")
    return heard


async def test_it_is_the_persons_button_and_tells_them_what_happens(browser: Browser, site: SitePage) -> None:
    phone = await PhonePage.open(browser, await address(site), scripts=(CUES,))
    page = phone.page
    async with onlooker(site.endpoint) as seen:
        await phone.start()
        await page.get_by_role("button", name="Skip").tap()
        await expect(page.locator("#state")).to_have_text("Pointing", timeout=60_000)
        await expect(page.locator("#next")).to_contain_text("arm straight")
        before = await page.evaluate("window.tones")
        presses = await presses_of(phone, seen)
        await expect(page.locator("#state")).to_have_text("Resting")
        assert [(press.gesture, press.source) for press in presses] == [("press", "page")]
        # a sign of "stopped": one long buzz, and tones that go down
        await until_evaluated(phone, "window.vibrations.some((each) => String(each) === '250')")
        assert await page.evaluate("window.tones") > before
        big = await page.locator("#big").bounding_box()
        assert big is not None
        await page.mouse.move(big["x"] + 50, big["y"] + 50)
        await page.mouse.down()
        await until(lambda: presses[-1].gesture == "hold", 5, "a hold")
        await page.mouse.up()
    assert [press.gesture for press in presses] == ["press", "hold"]
    assert phone.faults == []


async def until_evaluated(phone: PhonePage, condition: str) -> None:
    """Wait for a condition of the page, without `eval`, which its policy forbids to functions that wait."""
    patience = Patience(30.0)
    while not await phone.page.evaluate(condition):
        assert not patience.is_over(), f"never: {condition}"
        await asyncio.sleep(0.05)


async def test_hidden_phone_page_stops_and_a_tap_restarts_it(browser: Browser, shared_site: SitePage) -> None:
    phone = await PhonePage.open(browser, await address(shared_site))
    page = phone.page
    await phone.start()
    await page.evaluate(
        "Object.defineProperty(document, 'visibilityState', {value: 'hidden', configurable: true});"
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
    await expect(page.locator("#trouble")).to_contain_text("out of sight")
    await expect(page.locator("#running")).to_be_hidden()
    await page.evaluate("delete document.visibilityState")
    await phone.start()
    await expect(page.locator("#trouble")).to_be_hidden()
    assert phone.faults == []


async def test_without_a_sensor_it_says_what_to_do(browser: Browser, shared_site: SitePage) -> None:
    nothing = "delete window.RelativeOrientationSensor; delete window.DeviceOrientationEvent"
    phone = await PhonePage.open(browser, await address(shared_site), source="event", scripts=(nothing,))
    await expect(phone.page.locator("#trouble")).to_contain_text("Chrome on Android")
    await expect(phone.page.get_by_role("button", name="Start")).to_be_disabled()


async def test_the_server_comes_back_and_so_does_the_phone(browser: Browser, shared_site: SitePage) -> None:
    phone = await PhonePage.open(browser, await address(shared_site))
    await phone.start()
    await phone.page.context.set_offline(True)
    await expect(phone.page.locator("#link")).to_have_text("Connecting …", timeout=60_000)
    await phone.page.context.set_offline(False)
    await expect(phone.page.locator("#link")).to_have_text("Connected", timeout=60_000)


@pytest.mark.parametrize("path", ["/phone", "/nowhere"])
async def test_a_page_that_lets_nobody_in_looks_like_the_others(
    browser: Browser, shared_site: SitePage, path: str
) -> None:
    page = await (await browser.new_context()).new_page()
    response = await page.goto(shared_site.origin + path)
    assert response is not None
    assert response.status == (404 if path == "/nowhere" else 403)
    await expect(page.get_by_role("heading", level=1)).to_be_visible()
    await check_look(page, path)


async def test_page_fits_every_phone_without_scrolling_once_it_runs(
    browser: Browser, shared_site: SitePage
) -> None:
    phone = await PhonePage.open(browser, await address(shared_site))
    page = phone.page
    sizes = ((320, 568), (390, 780), (780, 390), (568, 320))
    sideways = "document.documentElement.scrollWidth - innerWidth"
    for width, height in sizes:
        await page.set_viewport_size({"width": width, "height": height})
        assert await page.evaluate(sideways) <= 0
    for details in await page.locator("summary").all():
        await details.tap()
    await check_look(page, "before")
    await phone.start()
    await check_look(page, "running")
    await page.get_by_role("button", name="Skip").tap()
    await check_look(page, "button")
    await expect(page.locator("#state")).to_have_text("Pointing", timeout=60_000)
    for width, height in sizes:
        await page.set_viewport_size({"width": width, "height": height})
        assert await page.evaluate(sideways) <= 0
        assert await page.evaluate("document.documentElement.scrollHeight - innerHeight") <= 1
        big = await page.locator("#big").bounding_box()
        assert big is not None
        assert big["width"] >= 150
        assert big["height"] >= 120
