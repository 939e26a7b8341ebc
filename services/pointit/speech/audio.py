"""Samples from a WAV file, standard input or a microphone, with their times."""

import asyncio
import shutil
import sys
from collections.abc import AsyncIterator
from pathlib import Path

from pointit.runtime.clock import Clock
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit.speech.recogniser import RATE_HZ
from pointit.speech.standard_input import blocks_of
from pointit.speech.wav_file import read_wav

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
