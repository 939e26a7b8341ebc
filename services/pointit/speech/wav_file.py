"""Reads WAV files of speech: PCM of 16 kHz, 16 bits, one channel, also with the extensible header."""

import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from pointit.runtime.errors import ConfigError
from pointit.speech.recogniser import RATE_HZ

log = logging.getLogger(__name__)

MAX_BYTES = 256 * 2**20
"""Limit of a file: more than two hours."""

PCM, EXTENSIBLE = 1, 0xFFFE
ENCODINGS = {PCM: "PCM", 2: "ADPCM", 3: "float", 6: "A-law", 7: "mu-law", 0x11: "ADPCM", 0x55: "MP3"}
"""Names of format tags."""

STREAMED = 0x7FFF0000
"""Size of data from which it is a placeholder of a program that could not seek back, or was ended."""

_CHUNK = struct.Struct("<4sI")
_NAMES = frozenset({b"data", b"fmt ", b"LIST", b"fact", b"cue ", b"bext", b"JUNK", b"id3 ", b"smpl", b"PEAK"})
"""Names of usual chunks."""
_FORMAT = struct.Struct("<HHIIHH")
_SUBFORMAT, _SUBFORMAT_END = 24, bytes.fromhex("000000001000800000aa00389b71")
"""Offset of the extensible format's subformat, and what follows if its first two bytes are a format tag."""
_CONVERTER = f"`sox IN -r {RATE_HZ // 1000}k -b 16 -c 1 OUT`"


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
    data = _file_content(path)
    forms: set[WavFormat] = set()
    sound: list[bytes] = []
    for name, size, content in _chunks(data):
        if name == b"fmt " and (form := _format(content)) is not None:
            forms.add(form)
        elif name == b"data":
            sound.append(content[: len(content) // 2 * 2])
            if len(content) < size < STREAMED:
                log.warning("%s: is cut off, %d of %d bytes of sound are there", path, len(content), size)
        elif name in (b"RIFF", b"wavl"):
            raise ConfigError(f"{path}: has several recordings; export them as one, or as files of their own")
    for form in forms - {NEEDED}:
        raise ConfigError(f"{path}: has {form}, and must have {NEEDED}; convert it: {_CONVERTER}")
    if not forms or not any(sound):
        missing = "sound" if forms else "format"
        raise ConfigError(
            f"{path}: no WAV file that can be read: it has no {missing}; copy or record it again"
        )
    return b"".join(sound)


def _file_content(path: Path) -> bytes:
    """Return the bytes of the WAV file at `path`.

    Raises:
        ConfigError: If it cannot be read, is too large, or is none.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: no WAV file that can be read: {error.strerror or error}") from error
    if len(data) > MAX_BYTES:
        raise ConfigError(f"{path}: has more than {MAX_BYTES >> 20} MB; cut it into pieces")
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        begin = f"it begins with {data[:4]!r}" if data else "it is empty"
        raise ConfigError(f"{path}: no WAV file that can be read: {begin}; convert it: {_CONVERTER}")
    return data


def _chunks(data: bytes) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield name, stated size and content of the chunks, the last of which may be cut off."""
    offset, end = 12, 8 + int.from_bytes(data[4:8], "little")
    while offset + _CHUNK.size <= len(data):
        name, size = _CHUNK.unpack_from(data, offset)
        offset += _CHUNK.size
        # a recorder that is ended has written the sizes of an empty file
        is_unfinished = name == b"data" and not size and not offset < end <= len(data)
        yield name, size, data[offset:] if is_unfinished else data[offset : offset + size]
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
