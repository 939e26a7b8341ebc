"""People who see no lights: page or phone speaks names, they step and confirm, and the thing reacts."""

import asyncio
import contextlib
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from playwright.async_api import Browser, Page, expect
from playwright.async_api import TimeoutError as PlaywrightTimeoutError

from tests.e2e.web.phone import PhonePage
from tests.e2e.web.site import SitePage, running
from tests.e2e.web.window import Window
from tests.support.commands import Commands
from tests.support.pace import Patience

pytestmark = pytest.mark.slow

CAN_STEP = "() => [...window.pointit.site.people.values()].some(({ announced }) => announced)"
IS_MORE = "count => window.spoken.length > count"
LABELS = {"a": "Radio", "b": "Kettle", "c": "Toaster", "d": "Window", "e": "Heater"}
"""Things from left to right."""
SPOKEN = """
window.spoken = [];
Object.defineProperty(window, "speechSynthesis", { value: {
  speak(each) {
    if (each.text) window.spoken.push(each.text);
    window.last = [each.lang, each.rate];
    each.onstart?.();
  },
  cancel() { window.cuts = (window.cuts ?? 0) + 1; },
  getVoices() { return [{ lang: "en-GB" }, { lang: "it-IT" }]; },
} });
"""


def room(folder: Path) -> Path:
    """Write a map with five things 0.4 m apart and no light."""
    things = "".join(
        f"  {name}: {{label: {label}, center: [2.5, {0.8 - 0.4 * index:.1f}, 1.3], size: [0.2, 0.2, 0.2]}}\n"
        for index, (name, label) in enumerate(LABELS.items())
    )
    path = folder / "room.yaml"
    path.write_text(f"things:\n{things}", encoding="utf-8")
    return path


async def site_with(commands: Commands, folder: Path, announce: str) -> tuple[SitePage, Path]:
    """Run the room. Return it and the file that the function of the thing d writes."""
    done = folder / "done"
    program = folder / "react.py"
    source = "import pathlib, sys\npathlib.Path(sys.argv[1]).write_text(sys.argv[2])\n"
    program.write_text(source, encoding="utf-8")
    reaction = f"d={sys.executable} {program} {done} {{thing}}"
    site = await running(
        commands,
        *(str(room(folder)), "--announce", announce, "--on", reaction, "--imu", "page"),
        *("--lan", "--set", "web.lan_port=0"),
        state=folder / "state",
    )
    return site, done


async def spoken(page: Page) -> list[str]:
    return list(await page.evaluate("window.spoken"))


async def find(page: Page, wanted: str, step: Callable[[int], Awaitable[None]]) -> None:
    """Step, as a listener does, until `wanted` was the last name that the page was asked to say.

    The first step goes to the thing nearest to where the arm points.
    """
    names = list(LABELS.values())
    patience = Patience(120.0)
    while (heard := [each for each in await spoken(page) if each in names])[-1:] != [wanted]:
        assert not patience.is_over(), f"{wanted} is not found: {heard}"
        count = len(await spoken(page))
        await step(1 if not heard or names.index(heard[-1]) < names.index(wanted) else -1)
        with contextlib.suppress(PlaywrightTimeoutError):
            await page.wait_for_function(IS_MORE, arg=count, timeout=10_000)


async def confirm(page: Page, done: Path, wanted: str, press: Callable[[], Awaitable[None]]) -> None:
    """Press once the name could be understood, until the thing's function has run."""
    patience = Patience(120.0)
    while not done.exists():  # noqa: ASYNC240 - a file of a few bytes
        assert not patience.is_over(), f"{wanted} did not react: {await spoken(page)}"
        count = len(await spoken(page))
        await asyncio.sleep(0.8)
        await press()
        waiting = Patience(5.0)
        # a press that came late has the name spoken again, and the next one confirms
        while not (done.exists() or waiting.is_over() or len(await spoken(page)) > count):  # noqa: ASYNC110, ASYNC240
            await asyncio.sleep(0.05)
    assert (await spoken(page))[-1] == wanted
    assert done.read_text(encoding="utf-8") == "d"  # noqa: ASYNC240 - as above


async def test_keyboard_alone_finds_a_thing_by_name_and_confirms_it(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    site, done = await site_with(commands, tmp_path, "page")
    window = await Window.open(browser, site.url, scripts=(SPOKEN,), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    await page.keyboard.press("ArrowUp")
    assert (await spoken(page))[-1].startswith("M takes the arm.")
    await page.keyboard.press("m")
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    await page.wait_for_function(CAN_STEP)

    async def step(by: int) -> None:
        await page.keyboard.press("ArrowRight" if by > 0 else "ArrowLeft")

    await find(page, "Window", step)
    await expect(page.locator("#name")).to_contain_text("Window")
    await confirm(page, done, "Window", lambda: page.keyboard.press(" "))
    assert await page.evaluate("window.cuts") >= 1
    await page.keyboard.press("Home")
    await expect(page.locator("#name")).to_contain_text("Window, 4 of 5")
    assert window.faults == []


async def test_by_the_phone_swipes_step_and_a_tap_confirms(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    site, done = await site_with(commands, tmp_path, "phone")
    async with site.operator() as operator:
        secure = await operator.pair("user1")
    phone = await PhonePage.open(browser, site.origin + secure[secure.index("/phone") :], scripts=(SPOKEN,))
    page = phone.page
    await page.locator("#speaker select").first.select_option("it-IT")
    await phone.start(pitch_deg=-40.0)
    await page.locator("#big").tap()  # this is straight ahead, below the things
    await expect(page.locator("#big-name")).to_have_text("Press")
    assert all(
        text.startswith("Point with your arm") for text in await spoken(page)
    )  # the next step, no name
    big = await page.locator("#big").bounding_box()
    assert big is not None
    x = big["x"] + big["width"] / 2
    y = big["y"] + big["height"] / 2

    async def swipe(by: int) -> None:
        await page.mouse.move(x, y)
        await page.mouse.down()
        await page.mouse.move(x + 60 * by, y, steps=3)
        await page.mouse.up()

    await find(page, "Window", swipe)
    assert await page.evaluate("window.last") == ["it-IT", 1]
    await confirm(page, done, "Window", lambda: page.locator("#big").tap())
    names = len(await spoken(page))
    patience = Patience(120.0)
    index = 0
    while len(await spoken(page)) == names:
        assert not patience.is_over(), "no name was spoken"
        index += 1
        await phone.turn(0.3 * (index % 2), -14.0 + index // 20 % 24)  # slowly up, as a person searches
        await asyncio.sleep(0.05)
    assert phone.faults == []
