"""Sound files: one that cannot be used is named, with what to do."""

import logging
import struct
import wave
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit.speech.audio import WavFile, read_wav
from tests.support.bench import ManualClock


def test_a_file_that_cannot_be_read_is_named_once(tmp_path: Path) -> None:
    path = tmp_path / "said.wav"
    with pytest.raises(ConfigError) as error:
        WavFile(path, ManualClock())
    assert str(error.value) == f"{path}: no WAV file that can be read: no such file or directory"
    path.write_bytes(b"RIFF")
    with pytest.raises(ConfigError, match="no WAV file that can be read"):
        WavFile(path, ManualClock())


def test_file_of_another_rate_is_refused_with_the_converting_command(tmp_path: Path) -> None:
    path = tmp_path / "said.wav"
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 44_100, 0, "NONE", ""))
    with pytest.raises(ConfigError, match="`sox IN -r 16k -b 16 -c 1 OUT`"):
        WavFile(path, ManualClock())


SOUND = struct.pack("<6h", 0, 300, -300, 12000, -12000, 7)
SUBFORMAT = bytes.fromhex("000000001000800000aa00389b71")


def chunk(name: bytes, content: bytes, size: int | None = None) -> bytes:
    stated = len(content) if size is None else size
    return name + struct.pack("<I", stated) + content + bytes(len(content) % 2)


def format_of(tag: int, *, channels: int = 1, rate_hz: int = 16_000, bits: int = 16) -> bytes:
    block = channels * bits // 8
    return struct.pack("<HHIIHH", tag, channels, rate_hz, rate_hz * block, block, bits)


def extensible(tag: int, *, channels: int = 1, bits: int = 16) -> bytes:
    mask = 4
    subformat = struct.pack("<H", tag) + SUBFORMAT
    return format_of(0xFFFE, channels=channels, bits=bits) + struct.pack("<HHI", 22, bits, mask) + subformat


def write(folder: Path, *chunks: bytes, size: int | None = None) -> Path:
    body = b"WAVE" + b"".join(chunks)
    path = folder / "words.wav"
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body) if size is None else size) + body)
    return path


FORMAT = chunk(b"fmt ", format_of(1))


@pytest.mark.parametrize(
    "chunks",
    [
        (FORMAT, chunk(b"data", SOUND)),
        (chunk(b"fmt ", extensible(1)), chunk(b"data", SOUND)),
        (chunk(b"fmt ", format_of(1) + b"\0\0"), chunk(b"fact", b"\6\0\0\0"), chunk(b"data", SOUND)),
        (
            chunk(b"JUNK", bytes(7)),
            chunk(b"fmt ", extensible(1)),
            chunk(b"LIST", b"INFO"),
            chunk(b"data", SOUND),
        ),
        (FORMAT, chunk(b"data", SOUND), chunk(b"LIST", b"INFOISFT")),
        (FORMAT, chunk(b"data", SOUND[:4]), chunk(b"data", SOUND[4:])),
        (
            FORMAT,
            chunk(b"data", SOUND[:8]),
            chunk(b"LIST", b"INFOIART\5\0\0\0Zoe.."),
            chunk(b"data", SOUND[8:]),
        ),
        (FORMAT, chunk(b"data", b""), chunk(b"data", SOUND)),
        (chunk(b"data", SOUND), FORMAT),
        (FORMAT, chunk(b"note", b"odd"), chunk(b"data", SOUND)),
        (FORMAT, chunk(b"note", b"odd")[:-1], chunk(b"data", SOUND)),  # without its padding
        (chunk(b"JUNK", b"x")[:-1], FORMAT, chunk(b"LIST", b"INFO.")[:-1], chunk(b"data", SOUND)),
        (FORMAT, chunk(b"data", SOUND + b"\1"), chunk(b"LIST", b"INFO")),
        (FORMAT, FORMAT, chunk(b"data", SOUND)),
    ],
)
def test_pcm_is_read_whatever_header_and_chunks_it_has(
    tmp_path: Path, chunks: tuple[bytes, ...], caplog: pytest.LogCaptureFixture
) -> None:
    assert read_wav(write(tmp_path, *chunks)) == SOUND
    assert not caplog.records


def test_second_chunk_of_another_format_or_second_file_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, FORMAT, chunk(b"data", SOUND), chunk(b"fmt ", format_of(1, rate_hz=8000)))
    with pytest.raises(ConfigError, match="has PCM, 8 kHz, 16 bits, 1 channel, and must have"):
        read_wav(path)
    path = write(tmp_path, FORMAT, chunk(b"data", SOUND))
    path.write_bytes(2 * path.read_bytes())
    with pytest.raises(ConfigError, match="has several recordings; export them as one"):
        read_wav(path)


@pytest.mark.parametrize(
    ("riff", "data"), [(0xFFFFFFFF, 0xFFFFFFFF), (36, 0), (0, 0), (0x7FFFFFFF, 0x7FFFF000)]
)
def test_sound_without_stated_sizes_is_read_without_a_warning(
    tmp_path: Path, riff: int, data: int, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path, chunk(b"fmt ", format_of(1)), chunk(b"data", SOUND, data), size=riff)
    assert read_wav(path) == SOUND
    assert not caplog.records


def test_sound_before_a_cut_is_read_with_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(tmp_path, chunk(b"fmt ", format_of(1)), chunk(b"data", SOUND, 4000))
    path.write_bytes(path.read_bytes()[:-1])
    with caplog.at_level(logging.WARNING):
        assert read_wav(path) == SOUND[:-2]
    assert f"{path}: is cut off, 11 of 4000 bytes of sound are there" in caplog.text


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (
            format_of(3, bits=32),
            "has float, 16 kHz, 32 bits, 1 channel, and must have PCM, 16 kHz, 16 bits, 1",
        ),
        (extensible(3, bits=32), "has float, 16 kHz, 32 bits, 1 channel,"),
        (extensible(1, bits=24), "has PCM, 16 kHz, 24 bits, 1 channel,"),
        (format_of(1, channels=2), "has PCM, 16 kHz, 16 bits, 2 channels,"),
        (format_of(1, rate_hz=44_100), "has PCM, 44.1 kHz, 16 bits, 1 channel,"),
        (format_of(7, bits=8), "has mu-law, 16 kHz, 8 bits, 1 channel,"),
        (format_of(0x2000), "has format 0x2000, 16 kHz"),
        (format_of(1)[:10], "it has no format; copy or record it again"),
    ],
)
def test_another_format_is_named_with_the_one_that_is_needed(
    tmp_path: Path, content: bytes, sentence: str
) -> None:
    path = write(tmp_path, chunk(b"fmt ", content), chunk(b"data", SOUND))
    with pytest.raises(ConfigError) as error:
        read_wav(path)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("size", range(44))
def test_a_header_that_is_cut_off_makes_one_sentence(tmp_path: Path, size: int) -> None:
    path = write(tmp_path, chunk(b"fmt ", format_of(1)), chunk(b"data", SOUND))
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(ConfigError, match=r"^[^\n]*no WAV file that can be read: [^\n]*$"):
        read_wav(path)
