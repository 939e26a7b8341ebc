"""An event loop in a separate thread with a watchdog that names the code that blocks it."""

import asyncio
import contextlib
import ctypes
import sys
import threading
import time
import traceback
from collections.abc import Callable, Coroutine
from contextvars import ContextVar
from types import FrameType
from typing import Any

from pointit.runtime.virtual_time import VirtualTimeLoop

BEAT_S = 0.01
LOOK_S = 0.02
END_WITHIN_S = 2.0
"""Time for a loop to close after its result is known, s."""


class LoopWatch:
    """Measures how long the event loop of another thread stands still.

    Time in which this machine did not even run the watching thread does not count, so that a busy machine is
    not mistaken for a blocking plug-in.
    """

    longest_s = 0.0
    """Longest time for which the loop has stood still, s."""
    where = ""
    """Location in the code at which it stood still."""

    def __init__(self) -> None:
        self._beat_s = 0.0
        self._excused_s = 0.0
        self._last_wakeup_s = 0.0
        self._thread = 0
        self._handle: asyncio.Handle | None = None

    def start(self) -> None:
        """Watch the running loop from now on."""
        self._thread = threading.get_ident()
        self._beat()

    def stop(self) -> None:
        """Watch no longer."""
        if self._handle is not None:
            self._handle.cancel()
        self._beat_s = 0.0

    def _beat(self) -> None:
        self._excused_s = 0.0
        self._beat_s = time.monotonic()
        self._handle = asyncio.get_running_loop().call_later(BEAT_S, self._beat)

    def look(self) -> None:
        """Update the longest time for which the loop was blocked.

        Called from another thread, every `LOOK_S`.
        """
        now_s = time.monotonic()
        if self._last_wakeup_s:
            self._excused_s += max(0.0, now_s - self._last_wakeup_s - LOOK_S)
        self._last_wakeup_s = now_s
        beat_s = self._beat_s
        blocked_s = now_s - beat_s - self._excused_s - BEAT_S
        if beat_s and blocked_s > self.longest_s:
            self.longest_s, self.where = blocked_s, place(self._thread)


current_watch: ContextVar[LoopWatch] = ContextVar("current_watch")
"""Watch of the running check."""


def place(thread: int) -> str:
    """Return the place in the code where a thread is, without the machinery of asyncio around it."""
    frames: dict[int, FrameType] = getattr(sys, "_current_frames")()  # noqa: B009 - no other way
    frame = frames.get(thread)
    if frame is None:
        return "nowhere"
    lines = [
        line
        for line in traceback.extract_stack(frame)
        if "asyncio" not in line.filename and "/threading.py" not in line.filename
    ]
    line = lines[-1] if lines else traceback.extract_stack(frame)[-1]
    return f"{line.filename}, line {line.lineno}, in {line.name}: `{line.line}`"


def run_in_own_loop(
    main: Callable[[], Coroutine[Any, Any, None]], *, limit_s: float, virtual_time: bool = False
) -> str:
    """Run `main()` in a new loop in a new thread, and raise what it raises.

    Returns:
        Empty, or the place in the code where it hung after `limit_s`. That is counted in looks of the
        watching thread, which a busy machine runs seldom, too.
    """
    outcome: list[BaseException | None] = []
    finished = threading.Event()
    watch = LoopWatch()

    async def watched() -> None:
        current_watch.set(watch)
        try:
            await main()
            outcome.append(None)
        except BaseException as error:  # noqa: BLE001 - raised again by the caller's thread
            outcome.append(error)
        finally:
            watch.stop()
            finished.set()  # before the loop closes, which waits for tasks that cannot be cancelled

    def work() -> None:
        with (
            contextlib.suppress(BaseException),
            asyncio.Runner(loop_factory=VirtualTimeLoop if virtual_time else None) as runner,
        ):
            runner.run(watched())

    thread = threading.Thread(target=work, name="plug-in check", daemon=True)
    thread.start()
    identity = thread.ident or 0
    for _ in range(round(limit_s / LOOK_S)):
        if finished.wait(LOOK_S):
            break
        watch.look()
    hung = "" if outcome else place(identity)
    thread.join(END_WITHIN_S if outcome else 0.0)
    if thread.is_alive():
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(identity), ctypes.py_object(SystemExit))
    if outcome and outcome[0] is not None:
        raise outcome[0]
    return hung
