"""A browser, and a running site with its page, for tests of the window."""

import asyncio
import time
from collections.abc import AsyncIterator, Generator, Iterator

import pytest
import pytest_asyncio
from playwright.async_api import Browser

from pointit.bridges.web.server.bundle import STATIC
from tests.e2e.web.page_record import PageRecord
from tests.e2e.web.site import SitePage, running
from tests.support.browser import NAMES, installed, joined, shared_chromium
from tests.support.commands import Commands
from tests.support.forked import run


def pytest_runtest_setup() -> None:
    """Begin with no pages."""
    PageRecord.current.clear()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add to the report of a test that failed what its pages and its site said, and how the site is."""
    report = yield
    if report.failed:
        now_s = time.monotonic()
        for record in PageRecord.current:
            report.sections.append((f"page {record.name}", "\n".join(record.lines(now_s))))
    known = getattr(item, "funcargs", {})
    site = known.get("shared_site") or known.get("site")
    commands = known.get("commands")
    if report.failed and isinstance(commands, Commands):
        for number, said in enumerate(commands.said()):
            report.sections.append((f"command {number}", said))
    if report.failed and isinstance(site, SitePage):
        code, doctor, _ = run(["doctor", "--connect", site.endpoint], 60.0)
        if site is not known.get("site"):  # it is none of the test's own commands
            report.sections.append(("site", site.command.err))
        report.sections.append((f"doctor ended with {code}", doctor))
    return report


@pytest.fixture(scope="session")
def browser_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run one browser for all tests here: a start takes a second of a core."""
    path = installed()
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is in PATH")
    with shared_chromium(path, tmp_path_factory.mktemp("browser")) as address:
        yield address


@pytest_asyncio.fixture
async def browser(browser_address: str) -> AsyncIterator[Browser]:
    async with joined(browser_address) as opened:
        yield opened


def page_is_built() -> None:
    if not (STATIC / "phone.html").is_file():
        pytest.skip(f"the page is not built: run `npm run build` in {STATIC.parent / 'client'}")


@pytest_asyncio.fixture
async def site(commands: Commands, request: pytest.FixtureRequest) -> SitePage:
    """Run a scenario with its page, open to the local network too.

    `@pytest.mark.parametrize("site", [("scenario_3", "--users", "2")], indirect=True)` runs another than
    `scenario_4`.
    """
    page_is_built()
    arguments: tuple[str, ...] = getattr(request, "param", ("scenario_4",))
    return await running(commands, *arguments, "--lan", "--set", "web.lan_port=0")


@pytest.fixture(scope="module")
def shared_site(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[SitePage]:
    """Run `scenario_4`, or the parameter, for all tests of a file; each leaves it as it was."""
    page_is_built()
    folder = tmp_path_factory.mktemp("printed")
    started = Commands(folder)
    try:
        lan = ("--lan", "--set", "web.lan_port=0")
        scenario: str = getattr(request, "param", "scenario_4")
        yield asyncio.run(running(started, scenario, *lan, state=folder / "state"))
    finally:
        started.kill_all()
