# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)
"""Zenoh's own log, line by line: it writes to standard output, so that is led through a pipe."""

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Generator

import zenoh

CHUNK_BYTES = 256 * 1024
STDOUT = 1


@contextlib.contextmanager
def listening(wanted: str, take: Callable[[str], None]) -> Generator[None]:
    """Give each line of Zenoh's log to `take`, in another thread; what else is printed goes where it did.

    In colours, whatever NO_COLOR says: the rest of a key that holds a line break is told by having none.

    For a process of its own and once in it: Zenoh's log cannot be set up again. Nothing happens where the
    person has set RUST_LOG, who wants to see the log as it is.

    Args:
        wanted: as in RUST_LOG.
        take: called in another thread; must not raise.
    """
    if "RUST_LOG" in os.environ:
        zenoh.try_init_log_from_env()
        yield
        return
    sys.stdout.flush()
    before = os.dup(STDOUT)
    source, sink = os.pipe()
    os.dup2(sink, STDOUT)
    os.close(sink)
    shown, sys.stdout = sys.stdout, os.fdopen(os.dup(before), "w", buffering=1, encoding="utf-8")
    threading.Thread(target=_read, args=(source, take), name="zenoh-log", daemon=True).start()
    os.environ.pop("NO_COLOR", None)
    zenoh.init_log_from_env_or(wanted)
    try:
        yield
    finally:
        os.dup2(before, STDOUT)  # the pipe's last writer is gone with this, and so is its reader
        os.close(before)
        sys.stdout.close()
        sys.stdout = shown


def _read(source: int, take: Callable[[str], None]) -> None:
    rest = b""
    with os.fdopen(source, "rb", buffering=0) as pipe:
        while chunk := pipe.read(CHUNK_BYTES):
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                take(line.decode(errors="replace"))
