"""The browser's window with the page, where an operator has a desktop."""

import contextlib
import logging
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Mapping
from pathlib import Path

from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import write_atomically
from pointit.schemas.topics import SERVICE_ALIVE

log = logging.getLogger(__name__)

SNAPS = Path("/snap")
"""Folder of snap packages. Their browsers cannot read hidden folders in the home folder."""


def has_desktop(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Return True if a browser can open a window: always on macOS and Windows, else with a display."""
    if platform in {"darwin", "win32"}:
        return True
    return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def is_wanted() -> bool:
    """Return True if an operator is present: a terminal, and a desktop."""
    return sys.stderr.isatty() and has_desktop()


class BrowserWindow:
    """Opens `file`, which redirects to the page, at most once, in a daemon thread.

    Not the link itself: every user of the machine can read the arguments of a browser's process.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._copy: Path | None = None
        if SNAPS.is_dir():
            with contextlib.suppress(RuntimeError):  # there is no home directory
                self._copy = Path.home() / f"pointit-{file.name}"
        self._is_open = False
        self._lock = threading.Lock()
        """Held while the copy is written or removed."""
        self._is_closed = False

    def open(self) -> None:
        """Open it, unless it was opened before."""
        if not self._is_open:
            self._is_open = True
            threading.Thread(target=self._open, name="browser", daemon=True).start()

    def close(self) -> None:
        """Do not open it any more; remove the copy made for the browser."""
        with self._lock:
            self._is_closed = True
            if self._copy is not None and self._is_open:
                self._copy.unlink(missing_ok=True)

    def _open(self) -> None:
        try:
            with self._lock:
                if self._is_closed:
                    return
                if self._copy is not None:
                    write_atomically(self._copy, self._file.read_bytes())
            file = self._copy or self._file
            is_open = webbrowser.open(file.absolute().as_uri())
        except (OSError, webbrowser.Error, ConfigError):
            is_open = False
        if not is_open:
            log.warning("no browser could be opened: open the address of the page yourself")


class PagePresence:
    """Calls `action` once, as soon as the page `instance` is present, and so listens."""

    def __init__(self, bus: Bus, instance: str, action: Callable[[], None]) -> None:
        self._instance = instance
        self._action = action
        self._is_done = False
        self._watching = bus.watch(SERVICE_ALIVE, self._on_presence)

    def close(self) -> None:
        """Do not call it any more."""
        self._watching.close()

    def _on_presence(self, name: str, *, present: bool) -> None:
        if name != self._instance or not present or self._is_done:
            return
        self._is_done = True
        self._action()


class PageOpener:
    """Opens `file`, see `BrowserWindow`, as soon as `instance` is present."""

    def __init__(self, bus: Bus, instance: str, file: Path) -> None:
        self._window = BrowserWindow(file)
        self._presence = PagePresence(bus, instance, self._window.open)

    def close(self) -> None:
        """Do not open it any more; remove the copy made for the browser."""
        self._presence.close()
        self._window.close()
