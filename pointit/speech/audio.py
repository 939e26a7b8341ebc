"""Sound: samples of a file, standard input or a microphone with their times."""

import asyncio
import logging
import os
import shutil
import sys
import wave
from collections.abc import AsyncIterator
from pathlib import Path

from pointit.errors import ConfigError
from pointit.runtime.clock import Clock
from pointit.schemas import NS_PER_S
from pointit.speech.recogniser import RATE_HZ

log = logging.getLogger(__name__)


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


CONVERTER = f"`sox IN -r {RATE_HZ // 1000}k -b 16 -c 1 OUT`"


def read_wav(path: Path) -> bytes:
    """Return the samples in the WAV file at `path`, little-endian.

    Of a file that is cut off the samples that are there are returned, and a warning is logged.

    Raises:
        ConfigError: If it cannot be read, or is not of 16 kHz, 16 bits (PCM) and one channel.
    """
    try:
        with wave.open(str(path), "rb") as file:
            channels, width, rate_hz, count, *_ = file.getparams()
            samples = file.readframes(min(count, path.stat().st_size))  # the count may be a placeholder
    except (OSError, EOFError, wave.Error) as error:
        reason = getattr(error, "strerror", None) or str(error) or "it is cut off"
        raise ConfigError(
            f"{path}: no WAV file that can be read: {reason}; record it again, or convert it: {CONVERTER}"
        ) from error
    if (channels, width, rate_hz) != (1, 2, RATE_HZ):
        raise ConfigError(
            f"{path}: has {channels} x {8 * width} bits at {rate_hz} Hz, and must have 1 x 16 bits at "
            f"{RATE_HZ} Hz; convert it: {CONVERTER}"
        )
    if not samples:
        raise ConfigError(f"{path}: no WAV file that can be read: it has no sound; record it again")
    if len(samples) < 2 * count:
        log.warning("%s: states %d samples, and %d are there", path, count, len(samples) // 2)
    return samples[: len(samples) // 2 * 2]


BLOCK_S = 0.05
BLOCK = round(BLOCK_S * RATE_HZ) * 2
"""Bytes of a block."""
TAIL_S = 1.0
"""Silence after a file, s, by which its last utterance ends."""
RECORDER = ("arecord", "-q", "-t", "raw", "-f", "S16_LE", "-c", "1", "-r", str(RATE_HZ))
MICROPHONE = "microphone"


class WavFile:
    """A WAV file, played at the pace of the site's time from now on."""

    def __init__(self, path: Path, clock: Clock) -> None:
        """Read the file.

        Raises:
            ConfigError: If it is no WAV file of 16 kHz, 16 bits and one channel.
        """
        self._samples = read_wav(path)
        self._clock = clock

    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks when they would have been heard."""
        start_ns = self._clock.now_ns()
        samples = self._samples + bytes(round(TAIL_S * RATE_HZ) * 2)
        for index in range(0, len(samples), BLOCK):
            stamp_ns = start_ns + index // 2 * NS_PER_S // RATE_HZ
            wait_s = (stamp_ns - self._clock.now_ns()) / NS_PER_S + BLOCK_S
            await asyncio.sleep(max(wait_s, 0.0) / self._clock.speed)
            yield stamp_ns, samples[index : index + BLOCK]


class Stream:
    """Raw samples of 16 kHz, 16 bits, one channel from standard input or a microphone, as they come."""

    def __init__(self, clock: Clock, *, is_microphone: bool) -> None:
        """Open nothing yet.

        Raises:
            ConfigError: If there is no program that records.
        """
        if is_microphone and shutil.which(RECORDER[0]) is None:
            raise ConfigError(
                "no `arecord` (package alsa-utils) for a microphone: pipe samples into `--audio -`"
            )
        self._clock, self._is_microphone = clock, is_microphone

    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks as they come. Each ends when it has arrived."""
        if not self._is_microphone:
            rest = b""
            async for read in blocks_of(sys.stdin.fileno(), BLOCK):
                rest += read
                if len(rest) >= BLOCK:
                    yield self._clock.now_ns() - round(BLOCK_S * NS_PER_S), rest[:BLOCK]
                    rest = rest[BLOCK:]
            if rest := rest[: len(rest) // 2 * 2]:
                yield self._clock.now_ns() - round(BLOCK_S * NS_PER_S), rest
            return
        process = await asyncio.create_subprocess_exec(*RECORDER, stdout=asyncio.subprocess.PIPE)
        try:
            while process.stdout is not None and (block := await process.stdout.read(BLOCK)):
                yield self._clock.now_ns() - round(len(block) / 2 * NS_PER_S / RATE_HZ), block
        finally:
            if process.returncode is None:
                process.terminate()
            await process.wait()
