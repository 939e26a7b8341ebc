"""The browser that a run opens: once the page is there, and not after its end."""

import threading
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote, urlsplit

import pytest

from pointit.bridges.web.server.link_file import keep_link
from pointit.cli import browser_window
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.bench import until

pytestmark = pytest.mark.wall_time

PATIENCE_S = 20.0
LINK = "http://127.0.0.1:8090/?token=of-the-operator"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Return the addresses that the browser, a snap, is given; copies for it are below `tmp_path`."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr(browser_window, "SNAPS", tmp_path)
    return opened


def leads_to(uri: str, link: str) -> Path:
    """Fail unless `uri` is a file of its owner alone that leads to `link`; return its folder."""
    file = Path(unquote(urlsplit(uri).path))
    assert urlsplit(uri).scheme == "file"
    assert link.partition("=")[2] not in uri
    assert file.stat().st_mode & 0o077 == 0
    assert f'content="0;url={link}"' in file.read_text(encoding="utf-8")
    return file.parent


def is_littered(home: Path) -> bool:
    return any(home.glob("pointit-page-*"))


@pytest.mark.parametrize("has_snaps", [False, True])
async def test_browser_gets_a_file_instead_of_the_token(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, opened: list[str], bus: MemoryBus, *, has_snaps: bool
) -> None:
    if not has_snaps:
        monkeypatch.setattr(browser_window, "SNAPS", tmp_path / "none")
    opening = browser_window.PageOpener(bus, "web", keep_link("lab", LINK))
    bus.announce(SERVICE_ALIVE, "pui")
    bus.announce(SERVICE_ALIVE, "pui").close()
    there = bus.announce(SERVICE_ALIVE, "web")

    await until(lambda: bool(opened), what="the browser")
    there.close()
    bus.announce(SERVICE_ALIVE, "web")
    seen: list[str] = []
    bus.watch(SERVICE_ALIVE, lambda name, **_: seen.append(name))
    await until(lambda: "web" in seen, what="the page again")

    (uri,) = opened
    folder = leads_to(uri, LINK)
    assert (folder == tmp_path) == has_snaps  # a browser from a snap reads no hidden folder

    opening.close()
    assert not is_littered(tmp_path)


async def test_run_that_ends_sooner_leaves_no_copy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, opened: list[str], bus: MemoryBus
) -> None:
    begun = threading.Event()
    ended = threading.Event()
    done = threading.Event()
    opens = browser_window.BrowserWindow._open

    def open_late(opening: browser_window.BrowserWindow) -> None:
        begun.set()
        assert ended.wait(PATIENCE_S)
        opens(opening)
        done.set()

    monkeypatch.setattr(browser_window.BrowserWindow, "_open", open_late)
    opening = browser_window.PageOpener(bus, "web", keep_link("lab", LINK))
    bus.announce(SERVICE_ALIVE, "web")
    await until(begun.is_set, what="the thread")
    opening.close()
    ended.set()
    await until(done.is_set, what="its end")
    assert not is_littered(tmp_path)
    assert not opened


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
    assert browser_window.has_desktop(environment, platform) is desktop


def test_the_page_is_opened_without_a_home_directory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def unknown() -> NoReturn:
        raise RuntimeError

    monkeypatch.setattr(browser_window, "SNAPS", tmp_path)
    monkeypatch.setattr(Path, "home", unknown)
    assert browser_window.BrowserWindow(tmp_path / "page.html")._copy is None
