"""The card leads every visitor: from every beginning, on any user's map, and after a refused act."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from playwright.async_api import Browser, Page, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.phone import PhonePage
from tests.e2e.web.site import Operator, SitePage, running
from tests.e2e.web.window import NO_WEBGL, TOLD, Window
from tests.support.commands import Commands
from tests.support.home_assistant import MemoryHome, token_file
from tests.support.pace import Patience

pytestmark = pytest.mark.slow

SIZES = ((1440, 900), (390, 844))
THINGS = 30
ROOM = {"yaw_rad": 0.0, "origin_m": [0.0, 0.0, 0.0]}
"""Alignment of a headset: its space is the room."""
EVERY_S = 0.1
PLACE = """(id) => {
  const { site, stats: { lens } } = window.pointit;
  const thing = [...site.objects.values()].flatMap(({ objects }) => objects).find((each) => each.id === id);
  if (!thing) return null;
  const { left, top, width, height } = document.querySelector("#view canvas").getBoundingClientRect();
  const at = [...thing.position_m, 1];
  const row = (i) => [0, 1, 2, 3].reduce((sum, axis) => sum + lens[i + 4 * axis] * at[axis], 0);
  return [left + (1 + row(0) / row(3)) * width / 2, top + (1 - row(1) / row(3)) * height / 2];
}"""
"""Page coordinates of a thing."""
ON_NOTHING = "[...window.pointit.site.people.values()].every(({ hover }) => !hover?.object_id)"
BOTTOM = """() =>
  document.querySelector("section[aria-labelledby=s-who-points]").getBoundingClientRect().bottom"""
DONE_WORDS = (
    "has fired",
    "Fired: {}",
    "Switched on: {}",
    "Switched off: {}",
    "You fired",
    "You switched",
    "{} is on.",
)
"""Messages of the page about an act that was done, with the thing's name."""


UNWANTED = "should not be selected, but staying on it selects it"
BLUE_ONES = """[...window.pointit.site.objects.values()].flatMap(({ objects }) => objects)
  .filter(({ kind }) => kind === "blue").map(({ id }) => id)"""


def thing_map(names: list[str], folder: Path, **fields: str) -> Path:
    """Write a map of things in rows of six, 0.5 m apart, 2.5 m before the person."""
    rows = []
    for index, name in enumerate(names):
        y_m, z_m = 1.25 - 0.5 * (index % 6), 0.5 + 0.4 * (index // 6)
        extra = fields.get(name, "")
        rows.append(
            f"  {name}: {{center: [2.5, {y_m:.2f}, {z_m:.2f}], size: [0.2, 0.2, 0.2], dwell_s: 0.4{extra}}}"
        )
    path = folder / "home.yaml"
    path.write_text("things:\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


async def picture(page: Page, folder: Path, name: str) -> None:
    """Keep a picture, to be looked at."""
    await page.screenshot(path=folder / f"{name}.png")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SitePage]:
    """Run a map of thirty things with a free arm, a simulated arm, and an arm of a device.

    Each test leaves the free arm to nobody. The last one, of the beginnings, fails at once if it is not.
    """
    folder = tmp_path_factory.mktemp("home")
    room = thing_map([f"thing_{index}" for index in range(THINGS)], folder)
    arms = ("--users", "3", "--imu", "page", "--imu", "sim", "--imu", "simulated")
    lan = ("--lan", "--set", "web.lan_port=0")
    started = Commands(folder)
    try:
        yield asyncio.run(running(started, str(room), *arms, *lan, state=folder / "state"))
    finally:
        started.kill_all()


@contextlib.asynccontextmanager
async def headset(operator: Operator, user: str) -> AsyncGenerator[None]:
    """Move the arm of `user` by a headset."""

    async def move() -> None:
        while True:
            body = {"alignment": ROOM, "eyes_m": [0.0, 0.0, 1.6], "tip_m": [0.4, 0.0, 1.5]}
            await operator.say(kind="headset", user=user, **body)
            await asyncio.sleep(EVERY_S)

    await operator.ask(deed="take", name=user, query={"by": "headset"})
    moving = asyncio.create_task(move())
    try:
        yield
    finally:
        moving.cancel()
        await asyncio.wait([moving])
        await operator.ask(deed="give", name=user)


async def test_person_and_list_of_people_are_first_above_the_fold(
    browser: Browser, home: SitePage, tmp_path: Path
) -> None:
    window = await Window.open(browser, home.url, size=SIZES[0], scripts=(NO_WEBGL,), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    await page.get_by_role("radio", name="user1", exact=True).check()
    await expect(page.locator(".things li")).to_have_count(THINGS)
    for width, height in SIZES:
        await page.set_viewport_size({"width": width, "height": height})
        await window.is_drawn_anew()
        heads = page.locator("#page-0 > section:visible")
        assert await heads.nth(0).get_attribute("aria-label") == "Person"
        assert await heads.nth(1).get_attribute("aria-labelledby") == "s-who-points"
        assert await page.evaluate(BOTTOM) <= height, (width, height)
        await picture(page, tmp_path, f"fold-{width}")
        assert await violations(page) == [], (width, height)


async def test_source_is_nobody_at_once_after_give_back(browser: Browser, home: SitePage) -> None:
    window = await Window.open(browser, home.url, scripts=(NO_WEBGL, TOLD), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now.")
    await page.evaluate("window.told = []")
    await page.get_by_role("button", name="Give back").click()
    await window.has_told("Nobody points as user1 yet.")
    assert not await page.evaluate("window.told.some((text) => text.includes('own device'))")


async def test_card_in_each_beginning_of_ones_own_map(
    browser: Browser, home: SitePage, tmp_path: Path
) -> None:
    window = await Window.open(browser, home.url, size=SIZES[0], scripts=(NO_WEBGL,), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    guide = page.locator("#guide")

    for user, said in (
        ("user1", "Nobody points as user1 yet. Do it yourself:"),
        ("user2", "This is a simulation. Take over:"),
        ("user3", "user3 points with their own device."),
    ):
        await page.get_by_role("radio", name=user, exact=True).check()
        await expect(guide).to_contain_text(said)
        await expect(guide.get_by_role("button", name="Point with the mouse")).to_be_visible()
        await picture(page, tmp_path, f"beginning-{user}")
        assert await violations(page) == [], user
    await page.get_by_role("radio", name="user1", exact=True).check()

    async with home.operator() as operator:
        await operator.ask(deed="take", name="user1")
        await expect(guide).to_contain_text("Another page points as user1. Take over:")
        await picture(page, tmp_path, "beginning-another-page")
        await operator.ask(deed="give", name="user1")
        await expect(guide).to_contain_text("Nobody points as user1 yet.")

        async with headset(operator, "user1"):
            await expect(guide).to_contain_text("A headset points.")
            await expect(guide.get_by_role("button", name="Give back")).to_be_visible()
            await picture(page, tmp_path, "beginning-headset")
        await expect(guide).to_contain_text("Nobody points as user1 yet.")

        phone = await PhonePage.open(browser, await operator.pair("user1"))
    await phone.start()
    await phone.turn(0.0, -10.0)
    await expect(guide).to_contain_text("A phone points.")
    await picture(page, tmp_path, "beginning-phone")
    await phone.page.get_by_role("button", name="Skip").tap()
    step = await window.until("window.pointit.site.people.get('user1')?.interaction?.next_step")
    await expect(phone.page.locator("#next")).to_contain_text(step)
    await picture(phone.page, tmp_path, "phone")
    assert window.faults == []


@pytest.mark.parametrize("shared_site", ["scenario_4"], indirect=True)
async def test_page_does_not_invite_to_select_an_unwanted_package(
    browser: Browser, shared_site: SitePage, tmp_path: Path
) -> None:
    window = await Window.open(browser, shared_site.url, scripts=(TOLD,), reduced_motion="reduce")
    page = window.page
    await window.is_shown()
    await expect(page.locator("#guide")).to_contain_text("This is a simulation. Take over:")
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now.")
    patience = Patience(90)
    while not await page.evaluate(f"window.told.some((text) => text.includes({UNWANTED!r}))"):
        assert not patience.is_over(), "no unwanted package was met"
        for name in (await page.evaluate(BLUE_ONES))[:3]:
            if at := await page.evaluate(f"({PLACE})({name!r})"):
                await page.mouse.move(*at)
                await asyncio.sleep(0.3)
    await picture(page, tmp_path, "unwanted")
    assert not await page.evaluate("window.told.some((text) => text.includes('lue package: stay on it'))")
    await page.get_by_role("button", name="Give back").click()


class _Failing(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        self.send_response(500)
        self.end_headers()

    do_GET = do_POST  # noqa: N815 - of the library

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - of the library
        """Say nothing."""


@pytest.fixture
def failing_server() -> Iterator[str]:
    """Run a web server that fails."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Failing) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/do"
        server.shutdown()


class Pointer:
    """Points at things by the mouse of the page, and keeps what the page tells meanwhile."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.acts = 0
        self.lies: list[str] = []
        """Acts that the page reported as done and that were not."""
        self.untold: list[str] = []
        """Acts whose refusal was not told."""

    async def leave(self) -> None:
        """Point at nothing."""
        box = await self.window.page.locator("#view canvas").bounding_box()
        assert box is not None
        patience = Patience(20)
        x, y = box["x"] + 0.06 * box["width"], box["y"] + 0.45 * box["height"]  # no card is there
        while not await self.window.page.evaluate(ON_NOTHING):
            assert not patience.is_over(), "something is pointed at everywhere"
            for by_px in (0, 5):
                await self.window.page.mouse.move(x + by_px, y)
                await asyncio.sleep(0.1)

    async def try_thing(self, name: str, told: str, cause: str) -> None:
        """Stay on a thing whose act fails, until the page says `told`. Keep what it says in between."""
        await self.leave()
        page = self.window.page
        await page.evaluate("window.told = []")
        shown = name.replace("_", " ").capitalize()
        patience = Patience(15)
        is_told = f"window.told.some((text) => text.includes({told.format(shown)!r}))"
        while not await page.evaluate(is_told):
            if patience.is_over():
                self.untold.append(f"{cause}: {await page.evaluate('window.told')}")
                break
            at = await self.window.until(f"({PLACE})({name!r})")
            await page.mouse.move(*at)
            await asyncio.sleep(0.15)
        await asyncio.sleep(0.8)  # a button goes off by itself in this time
        self.acts += 1
        for text in await page.evaluate("window.told"):
            self.lies += [
                f"{cause}: {text}"
                for each in DONE_WORDS
                if each.format(shown) in text or each.format(name) in text
            ]


NOT_CHANGED = "{} did not change: "
UNAVAILABLE = "{} is unavailable: "


async def pointing(browser: Browser, site: SitePage) -> Pointer:
    """Return a pointer of a page that has the arm."""
    window = await Window.open(browser, site.url, size=(1280, 900), scripts=(TOLD,), reduced_motion="reduce")
    await window.is_shown()
    await window.page.get_by_role("button", name="Point with the mouse").click()
    await expect(window.page.locator("#guide")).to_contain_text("You are the arm now.")
    await window.is_still()
    return Pointer(window)


ROUNDS = 2
"""Times that each act is tried: what comes of the order of messages is a property of its own."""


async def test_refused_acts_are_never_told_as_done(
    browser: Browser, commands: Commands, failing_server: str, tmp_path: Path
) -> None:
    home = MemoryHome({"light.lost": ("unavailable", {}), "light.desk": ("off", {})})
    entities = {name: f", home_assistant: light.{name}" for name in ("lost", "gone", "desk")}
    room = thing_map(["program", "hook", "closed", *entities], tmp_path, **entities)
    on = ("--on", "program=false", "--on", f"hook={failing_server}", "--on", "closed=http://127.0.0.1:9/do")
    async with contextlib.AsyncExitStack() as running_home:
        port = await running_home.enter_async_context(home.serving())
        own = token_file(tmp_path)
        bridge = (
            *("--with", "home-assistant", "--set", f"home-assistant.url=http://127.0.0.1:{port}"),
            *("--set", f"home-assistant.token_file={own}"),
        )
        site = await running(commands, str(room), "--imu", "page", *on, *bridge)
        pointer = await pointing(browser, site)
        page = pointer.window.page

        for _ in range(ROUNDS):
            for name, told in (
                ("program", NOT_CHANGED), ("hook", NOT_CHANGED), ("closed", NOT_CHANGED),
                ("lost", UNAVAILABLE), ("gone", UNAVAILABLE),
            ):  # fmt: skip
                await pointer.try_thing(name, told, name)
        await picture(page, tmp_path, "refused")
        assert await violations(page) == []

        home.token = "another"  # noqa: S105 - of a test: the site's token is deleted
    async with home.serving(port):
        for _ in range(ROUNDS):
            await pointer.try_thing("desk", UNAVAILABLE, "token deleted")
        await picture(page, tmp_path, "token")
    await expect(page.locator(".things li", has_text="Desk")).to_contain_text("Unavailable")

    assert pointer.acts == 6 * ROUNDS
    assert pointer.lies == []
    assert pointer.untold == []


async def test_refused_acts_without_their_systems_are_never_told_as_done(
    browser: Browser, commands: Commands, tmp_path: Path
) -> None:
    room = thing_map(["tea", "desk"], tmp_path, desk=", home_assistant: light.desk")
    own = token_file(tmp_path)
    bridge = (
        *("--with", "home-assistant", "--set", "home-assistant.url=http://127.0.0.1:9"),
        *("--set", f"home-assistant.token_file={own}"),
    )
    broker = ("--mqtt", "127.0.0.1:9")
    site = await running(commands, str(room), "--imu", "page", *bridge, *broker)
    pointer = await pointing(browser, site)
    page = pointer.window.page
    problems = page.locator(".problems")
    await expect(problems).to_contain_text("unavailable:")

    for _ in range(ROUNDS):
        await pointer.try_thing("tea", UNAVAILABLE, "no MQTT broker")
        await pointer.try_thing("desk", UNAVAILABLE, "Home Assistant is off")
    await picture(page, tmp_path, "systems-off")
    assert "Errno" not in (await page.locator("body").inner_text())
    assert await violations(page) == []

    assert pointer.acts == 2 * ROUNDS
    assert pointer.lies == []
    assert pointer.untold == []
