"""Input that is waited for without a thread, so that Ctrl-C ends the wait at once."""

import asyncio
import os
from collections.abc import AsyncIterator


async def blocks_of(descriptor: int, size: int) -> AsyncIterator[bytes]:
    """Yield what can be read from a file descriptor, at most `size` bytes at a time, until its end."""
    while True:
        await _readable(descriptor)
        block = os.read(descriptor, size)
        if not block:
            return
        yield block


async def lines_of(descriptor: int) -> AsyncIterator[str]:
    """Yield lines without their ends. What is no UTF-8 is replaced."""
    rest = b""
    async for block in blocks_of(descriptor, 65536):
        *lines, rest = (rest + block).split(b"\n")
        for line in lines:
            yield line.decode(errors="replace")
    if rest:
        yield rest.decode(errors="replace")


async def _readable(descriptor: int) -> None:
    loop, is_ready = asyncio.get_running_loop(), asyncio.Event()
    try:
        loop.add_reader(descriptor, is_ready.set)
    except (PermissionError, NotImplementedError):  # a file, which is always ready, or Windows
        await asyncio.sleep(0)
        return
    try:
        await is_ready.wait()
    finally:
        loop.remove_reader(descriptor)
