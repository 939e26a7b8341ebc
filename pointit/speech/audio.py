"""Sound: samples of a file, standard input or a microphone with their times."""

import asyncio
import logging
import os
import shutil
import struct
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import NamedTuple

from pointit.errors import ConfigError
from pointit.runtime.clock import Clock
from pointit.schemas import NS_PER_S
from pointit.schemas.text import system_reason
from pointit.speech.recogniser import RATE_HZ

log = logging.getLogger(__name__)

MAX_BYTES = 256 * 2**20
"""Limit of a file: more than two hours."""

PCM = 1
EXTENSIBLE = 0xFFFE
ENCODINGS = {PCM: "PCM", 2: "ADPCM", 3: "float", 6: "A-law", 7: "mu-law", 0x11: "ADPCM", 0x55: "MP3"}
"""Names of format tags."""

STREAMED = 0x7FFF0000
"""Size of data from which it is a placeholder of a program that could not seek back, or was ended."""

_CHUNK = struct.Struct("<4sI")
_NAMES = frozenset({b"data", b"fmt ", b"LIST", b"fact", b"cue ", b"bext", b"JUNK", b"id3 ", b"smpl", b"PEAK"})
"""Names of usual chunks."""
_FORMAT = struct.Struct("<HHIIHH")
_SUBFORMAT = 24
"""Offset of the extensible format's subformat."""
_SUBFORMAT_END = bytes.fromhex("000000001000800000aa00389b71")
"""Bytes that follow if its first two bytes are a format tag."""
_CONVERTER = f"`sox IN -r {RATE_HZ // 1000}k -b 16 -c 1 OUT`"

BLOCK_S = 0.05
BLOCK = round(BLOCK_S * RATE_HZ) * 2
"""Bytes of a block."""
TAIL_S = 1.0
"""Silence after a file, s, by which its last utterance ends."""
RECORDER = ("arecord", "-q", "-t", "raw", "-f", "S16_LE", "-c", "1", "-r", str(RATE_HZ))
MICROPHONE = "microphone"


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
    loop = asyncio.get_running_loop()
    is_ready = asyncio.Event()
    try:
        loop.add_reader(descriptor, is_ready.set)
    except (PermissionError, NotImplementedError):  # a file, which is always ready, or Windows
        await asyncio.sleep(0)
        return
    try:
        await is_ready.wait()
    finally:
        loop.remove_reader(descriptor)


class WavFormat(NamedTuple):
    """Format of the samples in a file."""

    encoding: int
    channels: int
    rate_hz: int
    bits: int

    def __str__(self) -> str:
        """Return the format for a message."""
        encoding = ENCODINGS.get(self.encoding, f"format {self.encoding:#06x}")
        channels = f"{self.channels} channel{'' if self.channels == 1 else 's'}"
        return f"{encoding}, {self.rate_hz / 1000:g} kHz, {self.bits} bits, {channels}"


NEEDED = WavFormat(PCM, 1, RATE_HZ, 16)


def read_wav(path: Path) -> bytes:
    """Return the samples in the WAV file at `path`, little-endian, those of all its data chunks.

    Of a file that is cut off the samples that are there are returned, and a warning is logged.

    Raises:
        ConfigError: If it cannot be read, or has another format than `NEEDED`. Names both, with the remedy.
    """
    formats: set[WavFormat] = set()
    sound: list[bytes] = []
    for name, stated_size, content in _chunks(_file_content(path)):
        if name == b"fmt ":
            wav_format = _format(content)
            if wav_format is not None:
                formats.add(wav_format)
        elif name == b"data":
            size = len(content)
            sound.append(content[: size // 2 * 2])
            if size < stated_size < STREAMED:
                log.warning("%s: is cut off, %d of %d bytes of sound are there", path, size, stated_size)
        elif name in (b"RIFF", b"wavl"):
            raise ConfigError(f"{path}: has several recordings; export them as one, or as files of their own")

    _check_formats(path, formats)
    if not any(sound):
        raise ConfigError(_missing_text(path, "sound"))
    return b"".join(sound)


def _check_formats(path: Path, formats: set[WavFormat]) -> None:
    """Check that a file has the format `NEEDED` alone. Raises ConfigError."""
    for wav_format in formats - {NEEDED}:
        raise ConfigError(f"{path}: has {wav_format}, and must have {NEEDED}; convert it: {_CONVERTER}")
    if not formats:
        raise ConfigError(_missing_text(path, "format"))


def _missing_text(path: Path, part: str) -> str:
    return f"{path}: no WAV file that can be read: it has no {part}; copy or record it again"


def _file_content(path: Path) -> bytes:
    """Return the bytes of the WAV file at `path`.

    Raises:
        ConfigError: If it cannot be read, is too large, or is none.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: no WAV file that can be read: {system_reason(error)}") from error
    if len(data) > MAX_BYTES:
        raise ConfigError(f"{path}: has more than {MAX_BYTES >> 20} MB; cut it into pieces")
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        problem = f"it begins with {data[:4]!r}" if data else "it is empty"
        raise ConfigError(f"{path}: no WAV file that can be read: {problem}; convert it: {_CONVERTER}")
    return data


def _chunks(data: bytes) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield name, stated size and content of the chunks, the last of which may be cut off."""
    offset = 12
    end = 8 + int.from_bytes(data[4:8], "little")
    while offset + _CHUNK.size <= len(data):
        name, size = _CHUNK.unpack_from(data, offset)
        offset += _CHUNK.size
        # A recorder that was ended has written the sizes of an empty file: its sound goes to the end.
        is_empty = name == b"data" and not size
        has_true_end = offset < end <= len(data)
        if is_empty and not has_true_end:
            yield name, size, data[offset:]
        else:
            yield name, size, data[offset : offset + size]
        offset += size
        if data[offset : offset + 4] not in _NAMES:  # some programs leave the padding out
            offset += size % 2


def _format(content: bytes) -> WavFormat | None:
    """Return the format in a chunk, or None if it is cut off."""
    if len(content) < _FORMAT.size:
        return None
    encoding, channels, rate_hz, _, _, bits = _FORMAT.unpack_from(content)
    if encoding == EXTENSIBLE and content[_SUBFORMAT + 2 :].startswith(_SUBFORMAT_END):
        encoding = int.from_bytes(content[_SUBFORMAT : _SUBFORMAT + 2], "little")
    return WavFormat(encoding, channels, rate_hz, bits)


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
        self._clock = clock
        self._is_microphone = is_microphone

    def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks as they come. Each ends when it has arrived."""
        return self._microphone_blocks() if self._is_microphone else self._input_blocks()

    async def _input_blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks of standard input; the last one may be shorter."""
        rest = b""
        async for received in blocks_of(sys.stdin.fileno(), BLOCK):
            rest += received
            if len(rest) >= BLOCK:
                yield self._clock.now_ns() - round(BLOCK_S * NS_PER_S), rest[:BLOCK]
                rest = rest[BLOCK:]
        rest = rest[: len(rest) // 2 * 2]
        if rest:
            yield self._clock.now_ns() - round(BLOCK_S * NS_PER_S), rest

    async def _microphone_blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks of the program that records, until it ends."""
        process = await asyncio.create_subprocess_exec(*RECORDER, stdout=asyncio.subprocess.PIPE)
        try:
            while process.stdout is not None:
                block = await process.stdout.read(BLOCK)
                if not block:
                    return
                yield self._clock.now_ns() - round(len(block) / 2 * NS_PER_S / RATE_HZ), block
        finally:
            if process.returncode is None:
                process.terminate()
            await process.wait()
