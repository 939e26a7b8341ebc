"""`pointit home` beside a real Home Assistant, at night: the time to the first lamp that pointing switches.

`tests/devices/test_real_home_assistant.py` says how to install one; with Python 3.11 homeassistant==2024.3.3,
"josepy<2" and "setuptools<81". HOME_ASSISTANT_PYTHON=DIR/bin/python scripts/test -m long
tests/e2e/web/test_real_home.py then starts and ends it.
"""

import asyncio
import socket
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest
from playwright.async_api import Browser, expect
from zeroconf.asyncio import AsyncServiceInfo, AsyncZeroconf

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import HomeAssistantConnection, connected
from tests.devices.test_real_home_assistant import PYTHON, config
from tests.e2e.web import test_home
from tests.e2e.web.test_home import (
    LABELS,
    LAMPS,
    Hand,
    HomeRun,
    paired_phone,
    place,
    run,
    title,
    use,
)
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.home_assistant import reading

__all__ = ["config", "run"]
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not PYTHON, reason="HOME_ASSISTANT_PYTHON names no Python with Home Assistant"),
]
MAX_S = 240.0
PAUSE_S = 8.0
"""Time in which a person reads a card, s."""
TICK_S = 1.5
"""Time in which a person finds a lamp in the list, s."""
NAME = "Home of a test"
KIND = "_home-assistant._tcp.local."
ENTITIES = {
    "light.bed_light": "Bed Light",
    "light.ceiling_lights": "Ceiling Lights",
    "light.kitchen_lights": "Kitchen Lights",
}


async def states_of(connection: HomeAssistantConnection) -> dict[str, tuple[str, object]]:
    states = await connection.states()
    return {name: (states[name]["state"], states[name]["attributes"].get("brightness")) for name in ENTITIES}


@asynccontextmanager
async def announced(port: int) -> AsyncGenerator[None]:
    """Announce a Home Assistant of this machine, as its integration `zeroconf` does in a home."""
    info = AsyncServiceInfo(
        KIND,
        f"{NAME}.{KIND}",
        addresses=[socket.inet_aton("127.0.0.1")],
        port=port,
        properties={"location_name": NAME},
        server="home-of-a-test.local.",
    )
    async with AsyncZeroconf() as announcer:
        await (await announcer.async_register_service(info))
        yield


async def connect(window: Window, token: str) -> None:
    """Choose the Home Assistant that was found, and paste the token: nothing else is typed."""
    home = window.page.locator(".setup").get_by_role("button", name=NAME)
    await home.click()
    await asyncio.sleep(PAUSE_S)  # the person makes a token in their profile
    token_field = window.page.get_by_label("Access token")
    await expect(token_field).to_be_focused()
    await window.page.keyboard.insert_text(token)
    await window.page.keyboard.press("Enter")


async def test_first_lamp_is_switched_within_four_minutes(
    browser: Browser, run: HomeRun, config: HomeAssistantConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(test_home, "LAMPS", dict(zip(ENTITIES, LAMPS.values(), strict=True)))
    monkeypatch.setattr(test_home, "LABELS", ENTITIES)
    assert len(LABELS) == len(ENTITIES)
    port = int(config.url.rpartition(":")[2])
    async with announced(port), connected(config) as connection, reading(connection):
        before = await states_of(connection)
        begin_s = time.monotonic()
        site = await run.start()
        window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
        await title(window, "Where are your lamps?")
        await asyncio.sleep(PAUSE_S)
        await connect(window, config.read_token())
        await title(window, "Which lamps do you want to point at?")
        await asyncio.sleep(PAUSE_S)
        for label in ENTITIES.values():
            await asyncio.sleep(TICK_S)
            await window.page.locator(".setup").get_by_label(label, exact=False).first.press("Space")
        await use(window, "Next")
        await title(window, "What do you point with?")
        hand = Hand(await paired_phone(browser, site))
        await asyncio.sleep(PAUSE_S)
        await use(window, "Next")
        await place(window, hand, list(ENTITIES))
        await title(window, "Walk to a second place")
        await asyncio.sleep(PAUSE_S)
        await use(window, "I am there")
        hand.place_m = test_home.SECOND_M
        await place(window, hand, test_home.in_standing_order())
        await hand.lower()
        await title(window, "Try it")
        await asyncio.sleep(PAUSE_S)
        assert await states_of(connection) == before, "all lamps are as before"

        lamp = "light.bed_light"
        is_on = before[lamp][0] == "on"
        async with asyncio.timeout(60):
            while ((await states_of(connection))[lamp][0] == "on") is is_on:
                await hand.hold(lamp, 0.5)
        took_s = time.monotonic() - begin_s
        print(f"\nfrom `pointit home` to the first lamp: {took_s:.0f} s")  # noqa: T201 - the figure
        await expect(window.page.locator(".setup")).to_be_visible()
        assert took_s < MAX_S
