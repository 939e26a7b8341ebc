"""Lines of Zenoh's log, which a router in this process writes to its standard output."""

import contextlib
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Sequence

import zenoh

TakeLine = Callable[[str, int], None]
"""Takes a line, and 0 if it follows the one before, else how often it was among lines that were left out."""

CHUNK_BYTES = 256 * 1024
PIPE_BYTES = 1024 * 1024
"""Size of the pipe, Linux's limit for a user. Zenoh's threads wait when it is full."""
STDOUT = 1
MAX_LINES = 20_000
"""Limit of lines per second that are taken one by one. Of further ones, equal lines are counted and taken
once, at most as many that hold a mark, and as many others. Zenoh waits until its log is read, and with it
everybody whose messages it carries."""
OWN = b"\x1b["
"""First bytes of each line of Zenoh. A line without them is the rest of a key with a line break."""
TIME_BYTES = len("\x1b[2m2026-03-01T00:00:00.000000Z\x1b[0m ")
"""Length of the time at the start of each line of Zenoh."""


@contextlib.contextmanager
def captured_log(
    wanted: str,
    take: TakeLine,
    marks: Sequence[bytes] = (),
    is_ignored: Callable[[bytes], bool] | None = None,
) -> Generator[None]:
    """Pass each line of Zenoh's log to `take`, in another thread. Other output is not changed.

    The log is coloured in spite of NO_COLOR: a line without colours is recognised as the rest of a key with a
    line break.

    Call this once, in a separate process, since Zenoh's log cannot be configured twice. If the user has set
    RUST_LOG, the log is not changed. `wanted` has the syntax of RUST_LOG. `take` must not raise. Lines that
    contain one of `marks` have precedence over others. Those for which `is_ignored` are skipped.
    """
    if "RUST_LOG" in os.environ:
        zenoh.try_init_log_from_env()
        yield
        return
    # Zenoh writes to the descriptor, and other code to `sys.stdout`, which goes to a copy of the descriptor
    sys.stdout.flush()
    original = os.dup(STDOUT)
    source, sink = os.pipe()
    _enlarge_pipe(sink)
    os.dup2(sink, STDOUT)
    os.close(sink)
    shown = sys.stdout
    copy = os.dup(original)
    sys.stdout = os.fdopen(copy, "w", 1, encoding=shown.encoding, errors=shown.errors)
    threading.Thread(
        target=_read, args=(source, take, marks, is_ignored), name="zenoh-log", daemon=True
    ).start()
    os.environ.pop("NO_COLOR", None)
    zenoh.init_log_from_env_or(wanted)
    try:
        yield
    finally:
        os.dup2(original, STDOUT)  # the pipe's last writer is gone with this, and so is its reader
        os.close(original)
        sys.stdout.close()
        sys.stdout = shown


def _enlarge_pipe(sink: int) -> None:
    """Make room for a second of lines. Where that cannot be set, the pipe has 64 kB."""
    if sys.platform == "linux":
        import fcntl  # noqa: PLC0415 - there is none on Windows

        with contextlib.suppress(OSError):
            fcntl.fcntl(sink, fcntl.F_SETPIPE_SZ, PIPE_BYTES)


def _read(
    source: int, take: TakeLine, marks: Sequence[bytes], is_ignored: Callable[[bytes], bool] | None = None
) -> None:
    rest = b""
    began_s = time.monotonic()
    count = 0
    distinct = {True: 0, False: 0}
    with os.fdopen(source, "rb", buffering=0) as pipe:
        while chunk := pipe.read(CHUNK_BYTES):
            *lines, rest = (rest + chunk).split(b"\n")
            if is_ignored is not None:
                lines = [line for line in lines if not is_ignored(line)]
            # A flood must not be handed on: in each second, `MAX_LINES` lines are passed as they are
            if time.monotonic() - began_s >= 1.0:
                began_s = time.monotonic()
                count = 0
                distinct = {True: 0, False: 0}
            full_lines = lines[: max(MAX_LINES - count, 0)]
            count += len(lines)
            for line in full_lines:
                take(line.decode(errors="replace"), 0)

            # Of the rest, equal ones are counted. Those that matter have a limit of their own.
            further = [line for line in lines[len(full_lines) :] if line.startswith(OWN)]
            texts = Counter(line[TIME_BYTES:] for line in further)
            for text, times in texts.items():
                is_marked = any(mark in text for mark in marks)
                if distinct[is_marked] < MAX_LINES:
                    distinct[is_marked] += 1
                    line = further[0][:TIME_BYTES] + text
                    take(line.decode(errors="replace"), times)
