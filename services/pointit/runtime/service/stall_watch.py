"""Watch of an event loop for plug-ins that block it: they are named in the log at once, then in health."""

import asyncio
import contextlib
import logging
import sys
import threading
import time
import weakref
from collections.abc import Container
from pathlib import Path
from types import FrameType

from pointit.runtime.service.surroundings import WarningSink

log = logging.getLogger(__name__)

PERIOD_S = 0.25
"""Period of checks, s."""
STALL_S = 0.5
"""Time for which a plug-in may block the loop, s."""
SHOWN_S = 30.0
"""Time for which health reports it, s."""

_watches: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, "StallWatch"] = weakref.WeakKeyDictionary()


def watch_for_stalls(module: str, label: str, health: WarningSink) -> None:
    """Name the plug-in `label` in `health` from now on if code of the package of `module` blocks the loop.

    Our own code is not watched.
    """
    package = module.partition(".")[0]
    if package != "pointit":
        loop = asyncio.get_running_loop()
        _watches.setdefault(loop, StallWatch(loop)).add(package, label, health)


class StallWatch:
    """Asks a loop for a sign of life from a thread. If it is late, the plug-in that runs is the cause."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Watch `loop`, which runs in this thread, from the first plug-in on until it is closed."""
        self._packages: dict[str, weakref.WeakKeyDictionary[WarningSink, str]] = {}
        self._loop = loop
        self._loop_thread = threading.get_ident()

    def add(self, package: str, label: str, health: WarningSink) -> None:
        """Name the plug-in `label` in `health` if code of `package` blocks the loop."""
        is_first = not self._packages
        sinks = weakref.WeakKeyDictionary({health: label})
        sinks.update(self._packages.get(package, {}))
        self._packages = {**self._packages, package: sinks}  # replaced, not changed: the thread reads it
        if is_first:
            threading.Thread(target=self._run, name="stall watch", daemon=True).start()

    def _run(self) -> None:
        while True:
            sign = threading.Event()
            asked_s = time.monotonic()
            try:
                self._loop.call_soon_threadsafe(sign.set)
            except RuntimeError:  # the loop is closed
                return
            if not sign.wait(STALL_S):
                self._on_stall(sign, asked_s)
            time.sleep(PERIOD_S)

    def _on_stall(self, sign: threading.Event, asked_s: float) -> None:
        frames = sys._current_frames()  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - documented, for this
        found = find_culprit(frames.get(self._loop_thread), self._packages)
        if found is None:
            return
        package, where = found
        sinks = dict(self._packages[package])
        who = " or ".join(sorted(set(sinks.values())))
        log.error("%s blocks the event loop, and all services of this process, at %s", who, where)
        while not sign.wait(PERIOD_S):
            if self._loop.is_closed():
                return
        sentence = (
            f"{who} has blocked the event loop for {time.monotonic() - asked_s:.1f} s at {where}: "
            "it must call what blocks in a thread"
        )
        with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
            for health in sinks:
                self._loop.call_soon_threadsafe(self._report, health, sentence)

    def _report(self, health: WarningSink, sentence: str) -> None:
        health.warn("event loop", sentence)
        self._loop.call_later(SHOWN_S, health.clear, "event loop")


def find_culprit(frame: FrameType | None, packages: Container[str]) -> tuple[str, str] | None:
    """Return that of `packages` whose code runs in `frame` or called it, and the file and line, or None."""
    while frame is not None:
        package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if package in packages:
            code = frame.f_code
            return package, f"{Path(code.co_filename).name}:{frame.f_lineno} in {code.co_name}"
        frame = frame.f_back
    return None
