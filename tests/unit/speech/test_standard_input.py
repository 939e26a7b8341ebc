"""Input is waited for without a thread, and is whole lines whatever comes."""

import asyncio
import os

import pytest

from pointit.speech.audio import lines_of


async def test_a_silent_pipe_is_left_at_once_and_lines_are_whole() -> None:
    reads, writes = os.pipe()
    lines = lines_of(reads)
    os.write(writes, b"tak\xffe ")
    waiting = asyncio.ensure_future(anext(lines))
    await asyncio.sleep(0.02)
    os.write(writes, b"that\nth")
    assert await waiting == "tak\ufffde that"
    waiting = asyncio.ensure_future(anext(lines))
    await asyncio.sleep(0.02)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    os.close(reads)
    os.close(writes)
