"""`pointit home` from the first card to the first lamp that pointing switches, with a phone."""

import asyncio
import json
import math
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Browser, expect

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.maps.file import read_map_file
from pointit.services.supervisor.config import measures
from pointit.sim.aim import Stance
from tests.e2e.web.axe import violations
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.phone import PhonePage
from tests.e2e.web.site import SELDOM, SitePage
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands
from tests.support.home_assistant import TOKEN, MemoryHome
from tests.support.links import link_in

pytestmark = pytest.mark.slow

USER = "user1"
SECOND_M = (0.1, 2.0)
LAMPS: dict[str, Vec3] = {
    "light.desk": (3.0, 0.6, 0.9),
    "light.door": (3.0, -1.6, 1.8),
    "light.shelf": (2.6, 2.4, 1.4),
}
LABELS = {"light.desk": "Desk lamp", "light.door": "Door", "light.shelf": "Shelf"}
SETTLE_S = 0.8
"""Time for which a person holds the phone on a lamp before they press, s: longer than a press averages."""
ARRIVED_RAD = math.radians(2.5)
"""Difference of elevations up to which the arm has arrived: those of two lamps differ by more."""
ELEVATION = f"Math.asin(window.pointit.site.people.get({USER!r})?.cursor?.direction?.[2] ?? NaN)"
CARD = "document.querySelector('.setup').innerText"


@dataclass
class HomeRun:
    """A run of `pointit home`, which can be killed and started again at the same port."""

    commands: Commands
    folder: Path
    state: Path
    port: int
    command: Command | None = None
    site: SitePage | None = None

    async def start(self) -> SitePage:
        arguments = (
            "--folder",
            str(self.folder),
            "--no-view",
            "--no-browser",
            "--web-port",
            str(self.port),
            "--lan",
        )
        command = self.commands.start(
            "home",
            *arguments,
            environment=SELDOM | {"POINTIT_STATE": str(self.state), "POINTIT_WEB__LAN_PORT": "0"},
        )
        self.command = command
        await command.says("its link is in")
        self.site = SitePage(command=command, endpoint="", url=link_in("\n".join(command.logged())))
        return self.site

    async def kill(self, window: Window) -> SitePage:
        """Kill it, start it again, and wait until the page has noticed both."""
        assert self.command is not None
        self.command.kill()
        await window.until("!window.pointit.site.connected", "the page is cut off")
        site = await self.start()
        await window.until("window.pointit.site.connected", "the page is back")
        return site


@asynccontextmanager
async def memory_home() -> AsyncGenerator[tuple[MemoryHome, int]]:
    home = MemoryHome(
        {
            "light.desk": ("on", {"friendly_name": "Desk lamp", "brightness": 100}),
            "light.door": ("off", {"friendly_name": "Door"}),
            "light.shelf": ("off", {"friendly_name": "Shelf"}),
            "light.cellar": ("off", {"friendly_name": "Cellar"}),
        }
    )
    home.registries = {
        "config/area_registry/list": [{"area_id": "a", "name": "Living room"}],
        "config/entity_registry/list": [{"entity_id": "light.desk", "area_id": "a"}],
    }
    async with home.serving() as port:
        yield home, port


@dataclass
class Hand:
    """A person with a phone in their hand, at a place of the room."""

    phone: PhonePage
    place_m: tuple[float, float] = (0.0, 0.0)
    zero_rad: float = 0.4
    """Azimuth in the room of the phone's own zero."""

    async def hold(self, lamp: str, duration_s: float = SETTLE_S) -> None:
        """Point at a lamp for a while, with a hand that trembles."""
        yaw_deg, pitch_deg = self._angles_to(lamp)
        end_s = time.monotonic() + duration_s
        turn = 0
        while time.monotonic() < end_s:
            turn += 1
            await self.phone.turn(yaw_deg + 0.2 * (turn % 2), pitch_deg)
            await asyncio.sleep(0.03)

    @property
    def _stance(self) -> Stance:
        x, y = self.place_m
        return Stance(measures(1.76, {}), "right", (x, y, 0.0))

    def _angles_to(self, lamp: str) -> tuple[float, float]:
        """Return the yaw of the phone on `lamp` and its elevation, in degrees."""
        azimuth_rad, elevation_rad = self._stance.aim_at(LAMPS[lamp])
        return math.degrees(azimuth_rad - self.zero_rad), math.degrees(elevation_rad)

    @asynccontextmanager
    async def held_on(self, lamp: str, window: Window) -> AsyncGenerator[None]:
        """Point at a lamp throughout the block, which begins once the site has known it for `SETTLE_S`."""
        holding = asyncio.create_task(self.hold(lamp, math.inf))
        sight = vector.subtract(LAMPS[lamp], self._stance.eyes_m)
        elevation_rad = vector.elevation(sight)
        try:
            has_arrived = f"Math.abs({ELEVATION} - {elevation_rad}) < {ARRIVED_RAD}"
            await window.until(has_arrived, f"the ray at {lamp}, elevation {elevation_rad:.3f} rad")
            await asyncio.sleep(SETTLE_S)
            yield
        finally:
            holding.cancel()
            await asyncio.wait([holding])

    async def lower(self) -> None:
        """Let the arm hang."""
        await self.phone.turn(0.0, -85.0)


async def paired_phone(browser: Browser, site: SitePage) -> PhonePage:
    async with site.operator() as operator:
        url = await operator.pair(USER)
    phone = await PhonePage.open(browser, site.origin + url[url.index("/phone") :], source="event")
    await phone.start()
    skip = phone.page.locator("#skip")  # of its centre: a step of the set-up may have a choice of this name
    if await skip.is_visible():
        await skip.tap()
    return phone


@pytest.fixture
def run(commands: Commands, tmp_path: Path) -> HomeRun:
    page_is_built()
    return HomeRun(commands, tmp_path / "home", tmp_path / "state", free_port())


async def title(window: Window, text: str) -> None:
    await expect(window.page.locator("#setup-title")).to_have_text(text)
    await expect(window.page.locator("#setup-title")).to_be_focused()  # so that it is read out


async def use(window: Window, name: str) -> None:
    """Use a button of the card by the keyboard."""
    button = window.page.locator(".setup").get_by_role("button", name=name, exact=True)
    await button.focus()
    await button.press("Enter")


async def connect(window: Window, port: int, token: str = TOKEN) -> None:
    await expect(window.page.locator("#setup-title")).to_have_text("Where are your lamps?")
    await window.page.get_by_label("Address of Home Assistant").fill(f"http://127.0.0.1:{port}")
    await window.page.get_by_label("Access token").fill(token)
    await window.page.get_by_label("Access token").press("Enter")


async def choose(window: Window) -> None:
    await title(window, "Which lamps do you want to point at?")
    for label in LABELS.values():
        box = window.page.locator(".setup").get_by_label(label)
        await box.focus()
        if not await box.is_checked():
            await box.press("Space")
    await use(window, "Next")


def in_standing_order() -> list[str]:
    """Return the lamps in the order of the second place: as they stand around the first one."""
    azimuths_rad = {lamp: math.atan2(y, x) for lamp, (x, y, _) in LAMPS.items()}
    return sorted(azimuths_rad, key=azimuths_rad.__getitem__)


async def place(window: Window, hand: Hand, lamps: list[str], *, by_phone: bool = False) -> None:
    """Point at lamps, in the order of the card, and press by Space or by a tap."""
    for lamp in lamps:
        await expect(window.page.locator(".setup-turn")).to_contain_text(f"Point at {LABELS[lamp]}")
        async with hand.held_on(lamp, window):
            before: str = await window.page.evaluate(CARD)
            if by_phone:
                await hand.phone.page.locator("#big").tap()
            else:
                await window.page.locator("#setup-title").focus()
                await window.page.keyboard.press("Space")
            # The card tells whether the press counted
            await window.until(f"{CARD} !== {json.dumps(before)}", f"a press at {lamp} told at the card")
        assert await window.page.locator(".setup .reason").inner_text() == ""


def is_as_before(home: MemoryHome) -> bool:
    desk = home.states["light.desk"]
    off = [home.states[name]["state"] for name in ("light.door", "light.shelf", "light.cellar")]
    return (desk["state"], desk["attributes"]["brightness"], *off) == ("on", 100, "off", "off", "off")


async def test_home_is_set_up_by_cards_and_continues_after_kills(browser: Browser, run: HomeRun) -> None:
    async with memory_home() as (home, port):
        site = await run.start()
        window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
        await title(window, "Where are your lamps?")
        await connect(window, port, "a.wrong.token")
        await expect(window.page.locator(".setup .reason")).to_contain_text("rejects the token")
        await expect(window.page.locator(".setup .reason")).to_contain_text("and paste it here")
        assert await violations(window.page) == []
        await run.kill(window)
        await connect(window, port)
        await title(window, "Which lamps do you want to point at?")
        token_file = run.folder / "home-assistant.token"
        assert (token_file.read_text(), token_file.stat().st_mode & 0o777) == (TOKEN, 0o600)

        await run.kill(window)
        await expect(window.page.locator(".setup")).to_contain_text("Living room")
        assert await violations(window.page) == []
        await choose(window)
        await title(window, "What do you point with?")
        site = await run.kill(window)
        phone = await paired_phone(browser, site)
        await expect(window.page.locator(".setup")).to_contain_text("The phone points")
        assert await violations(window.page) == []
        await use(window, "Next")

        await title(window, "Where is each lamp?")
        hand = Hand(phone)
        await place(window, hand, ["light.desk"])
        await until(lambda: home.states["light.door"]["state"] == "on", 10, "the lamp whose turn it is, lit")
        await place(window, hand, ["light.door"], by_phone=True)
        assert await violations(window.page) == []

        site = await run.kill(window)
        await title(window, "Where do you point now?")
        hand = Hand(await paired_phone(browser, site), zero_rad=-0.3)
        await place(window, hand, ["light.door", "light.shelf"])  # by the press after the shorter way
        await title(window, "Walk to a second place")
        await until(lambda: is_as_before(home), 20, "all lamps as before")
        await use(window, "I am there")
        hand.place_m = SECOND_M
        await place(window, hand, in_standing_order())
        await hand.lower()
        await title(window, "Try it")
        await until(lambda: is_as_before(home), 20, "all lamps as before")
        assert await violations(window.page) == []

        file = read_map_file(run.folder / "home.yaml")
        for entity, lamp in LAMPS.items():
            thing = next(each for each in file.things.values() if each.home_assistant == entity)
            assert thing.center is not None
            azimuths = [math.atan2(each[1], each[0]) for each in (thing.center, lamp)]
            first = next(each for each in file.things.values() if each.home_assistant == "light.desk").center
            assert first is not None
            turn = math.atan2(first[1], first[0]) - math.atan2(LAMPS["light.desk"][1], LAMPS["light.desk"][0])
            assert abs(math.degrees(math.remainder(azimuths[0] - azimuths[1] - turn, math.tau))) < 3.0

        async def point_until(lamp: str, state: str) -> None:
            while home.states[lamp]["state"] != state:
                await hand.hold(lamp, 0.5)

        home.calls.clear()
        async with asyncio.timeout(60):
            await point_until("light.door", "on")
        assert {entity for action, entity, data in home.calls if "brightness" not in data} == {"light.door"}

        await use(window, "Done")
        await expect(window.page.locator(".setup")).to_be_hidden()
        await run.kill(window)
        await title(window, "Where do you point now?")
        texts: list[Any] = [(run.folder / "site.yaml").read_text(), (run.folder / "setup.json").read_text()]
        assert not any(TOKEN in text for text in texts)
        assert run.command is not None
        assert TOKEN not in run.command.err
        await use(window, "Skip")
        await expect(window.page.locator(".setup")).to_be_hidden()
        cut_off = ("WebSocket", "failed:", "ERR_CONNECTION")  # by the kills
        assert [fault for fault in window.faults if not any(word in fault for word in cut_off)] == []


async def test_placing_goes_on_after_kills_at_each_place(browser: Browser, run: HomeRun) -> None:
    async with memory_home() as (home, port):
        site = await run.start()
        window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
        await connect(window, port)
        await choose(window)
        await title(window, "What do you point with?")
        hand = Hand(await paired_phone(browser, site))
        await use(window, "Next")
        await place(window, hand, list(LAMPS))
        await title(window, "Walk to a second place")

        site = await run.kill(window)
        await title(window, "Where do you point now?")
        hand = Hand(await paired_phone(browser, site), zero_rad=-0.3)
        await place(window, hand, ["light.door"])
        await title(window, "Walk to a second place")
        await use(window, "I am there")
        hand.place_m = SECOND_M
        await place(window, hand, in_standing_order()[:1])
        await expect(window.page.locator(".setup-turn")).to_contain_text("Point at Desk lamp")

        site = await run.kill(window)
        await title(window, "Where do you point now?")
        await expect(window.page.locator(".setup-turn")).to_contain_text("Stand at your second place")
        hand = Hand(await paired_phone(browser, site), SECOND_M, zero_rad=0.2)
        await place(window, hand, in_standing_order())
        await title(window, "Try it")

        site = await run.kill(window)
        await title(window, "Where do you point now?")
        await expect(window.page.locator(".setup-turn")).to_contain_text("Stand at your first place")
        hand = Hand(await paired_phone(browser, site), zero_rad=-0.5)
        await place(window, hand, ["light.desk"])
        await title(window, "Try it")
        await until(lambda: is_as_before(home), 20, "all lamps as before")
        async with asyncio.timeout(60):
            while home.states["light.door"]["state"] == "off":
                await hand.hold("light.door", 0.5)
        assert [home.states[lamp]["state"] for lamp in ("light.desk", "light.shelf")] == ["on", "off"]


async def test_mouse_tries_out_a_home(browser: Browser, run: HomeRun) -> None:
    async with memory_home() as (_home, port):
        site = await run.start()
        window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
        await connect(window, port)
        await choose(window)
        await title(window, "What do you point with?")
        await window.page.get_by_label("The mouse, only to try it out").press("Space")
        await use(window, "Next")
        await title(window, "Try it")
        await until(lambda: len(read_map_file(run.folder / "home.yaml").things) == len(LAMPS), 10, "the map")
        await use(window, "Back")
        await title(window, "Where is each lamp?")
