"""A browser, and a running site with its page, for tests of the window."""

import asyncio
import re
import shutil
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio
from playwright.async_api import Browser, async_playwright

from pointit.bridges.web.bundle import STATIC
from tests.e2e.web.site import VIEWER_TOKEN, SitePage
from tests.support.buses import free_port
from tests.support.commands import Commands

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
PAGE = re.compile(r"page: (http://\S+)")


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Start `pointit …`; nothing outlives the test."""
    folder = tmp_path / "printed"
    folder.mkdir()
    started = Commands(folder)
    try:
        yield started
    finally:
        started.kill_all()


@pytest_asyncio.fixture
async def browser() -> AsyncIterator[Browser]:
    """Open this machine's Chromium without a window, or skip."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is in PATH")
    async with async_playwright() as playwright:
        opened = await playwright.chromium.launch(executable_path=found, args=FLAGS)
        try:
            yield opened
        finally:
            await opened.close()


async def running(commands: Commands, *arguments: str, state: Path | None = None) -> SitePage:
    """Run a scenario with its page; skip where the page is not built."""
    if not (STATIC / "phone.html").is_file():
        pytest.skip(f"the page is not built: run `npm run build` in {STATIC.parent / 'client'}")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    port = () if "--web-port" in arguments else ("--web-port", "0")
    command = commands.start(
        *("run", *arguments, *port, "--no-view", "--no-browser", "--listen", endpoint),
        *("--set", f"web.viewer_token={VIEWER_TOKEN}"),
        environment={} if state is None else {"POINTIT_STATE": str(state)},
    )
    await command.says("page: http")
    said = PAGE.search("\n".join(command.logged()))
    assert said is not None, command.err
    return SitePage(command=command, endpoint=endpoint, url=said[1])


@pytest_asyncio.fixture
async def site(commands: Commands, request: pytest.FixtureRequest) -> SitePage:
    """Run a scenario with its page, open to the local network too.

    `@pytest.mark.parametrize("site", [("scenario_3", "--users", "2")], indirect=True)` runs another than
    `scenario_4`.
    """
    arguments: tuple[str, ...] = getattr(request, "param", ("scenario_4",))
    return await running(commands, *arguments, "--lan", "--set", "web.lan_port=0")


@pytest.fixture(scope="module")
def shared_site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SitePage]:
    """Run `scenario_4` for all tests of a file; each leaves it as it was."""
    folder = tmp_path_factory.mktemp("printed")
    started = Commands(folder)
    try:
        lan = ("--lan", "--set", "web.lan_port=0")
        # an explicit end, so that it does not end between two tests when no page is open
        yield asyncio.run(running(started, "scenario_4", *lan, "--duration", "900", state=folder / "state"))
    finally:
        started.kill_all()


@pytest.fixture
def site_page(site: SitePage) -> str:
    """Run a scenario with its page, and return where the page is, with the operator's token."""
    return site.url
