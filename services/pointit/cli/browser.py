"""Opens the page in the person's browser, once it is there and where there is a desktop."""

import logging
import os
import sys
import threading
import webbrowser
from collections.abc import Mapping

from pointit.runtime import Bus
from pointit.runtime.bus import Closable
from pointit.schemas.topics import SERVICE_ALIVE

log = logging.getLogger(__name__)


def has_desktop(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Return whether a browser can show itself: always on macOS and Windows, elsewhere with a display."""
    if platform in {"darwin", "win32"}:
        return True
    return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def is_wanted() -> bool:
    """Return whether somebody sits there: a terminal, and a desktop beside it."""
    return sys.stderr.isatty() and has_desktop()


def open_when_there(bus: Bus, instance: str, url: str) -> Closable:
    """Open `url` as soon as `instance` is present; once, in a thread that nobody waits for."""
    opened = False

    def look(name: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        nonlocal opened
        if name == instance and present and not opened:
            opened = True
            threading.Thread(target=_open, args=(url,), name="browser", daemon=True).start()

    return bus.watch(SERVICE_ALIVE, look)


def _open(url: str) -> None:
    try:
        is_open = webbrowser.open(url)
    except (OSError, webbrowser.Error):
        is_open = False
    if not is_open:
        log.warning("no browser could be opened: open the address of the page yourself")
