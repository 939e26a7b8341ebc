"""The browser that a run opens: once the page is there, and not after its end."""

import threading
from pathlib import Path

import pytest

from pointit.bridges.web.server.link_file import keep_link
from pointit.cli.page import browser
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.bench import until

pytestmark = pytest.mark.wall_time

PATIENCE_S = 20.0
LINK = "http://127.0.0.1:8090/?token=of-the-operator"


def left_in(home: Path) -> list[Path]:
    return list(home.glob("pointit-page-*"))


async def test_run_that_ends_sooner_leaves_no_copy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    opened: list[str] = []
    begun, ended, done = threading.Event(), threading.Event(), threading.Event()
    opens = browser.BrowserWindow._open

    def open_late(opening: browser.BrowserWindow) -> None:
        begun.set()
        assert ended.wait(PATIENCE_S)
        opens(opening)
        done.set()

    monkeypatch.setattr(browser.BrowserWindow, "_open", open_late)
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr(browser, "SNAPS", tmp_path)
    bus = MemoryBus(LocalBroker())
    opening = browser.PageOpener(bus, "web", keep_link("lab", LINK))
    bus.announce(SERVICE_ALIVE, "web")
    await until(begun.is_set, what="the thread")
    opening.close()
    ended.set()
    await until(done.is_set, what="its end")
    assert not left_in(tmp_path)
    assert not opened
    await bus.close()


@pytest.mark.parametrize(
    ("environment", "platform", "desktop"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ""}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({}, "darwin", True),
        ({}, "win32", True),
    ],
)
def test_a_browser_needs_a_desktop(environment: dict[str, str], platform: str, *, desktop: bool) -> None:
    assert browser.has_desktop(environment, platform) is desktop
