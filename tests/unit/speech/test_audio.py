"""Sound files: one that cannot be used is named, with what to do."""

import logging
import struct
import wave
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit.speech.audio import read_wav

SOUND = struct.pack("<6h", 0, 300, -300, 12000, -12000, 7)


def write(folder: Path, *, channels: int = 1, width: int = 2, rate_hz: int = 16_000) -> Path:
    path = folder / "words.wav"
    with wave.open(str(path), "wb") as file:
        file.setparams((channels, width, rate_hz, 0, "NONE", ""))
        file.writeframes(SOUND)
    return path


def test_samples_are_read_and_those_before_a_cut_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path)
    assert read_wav(path) == SOUND
    assert not caplog.records
    path.write_bytes(path.read_bytes()[:-1])
    with caplog.at_level(logging.WARNING):
        assert read_wav(path) == SOUND[:-2]
    assert f"{path}: states 6 samples, and 5 are there" in caplog.text


def test_sound_of_a_program_that_could_not_state_its_size_is_read(tmp_path: Path) -> None:
    content = write(tmp_path).read_bytes()
    path = tmp_path / "piped.wav"
    path.write_bytes(content[:4] + b"\xff" * 4 + content[8:40] + b"\xff" * 4 + content[44:])
    assert read_wav(path) == SOUND


@pytest.mark.parametrize(
    ("form", "has"),
    [
        ({"channels": 2}, "has 2 x 16 bits at 16000 Hz"),
        ({"width": 3}, "has 1 x 24 bits at 16000 Hz"),
        ({"rate_hz": 44_100}, "has 1 x 16 bits at 44100 Hz"),
    ],
)
def test_another_format_is_named_with_the_command_that_converts_it(
    tmp_path: Path, form: dict[str, int], has: str
) -> None:
    with pytest.raises(ConfigError, match=f"{has}.*`sox IN -r 16k -b 16 -c 1 OUT`"):
        read_wav(write(tmp_path, **form))


def test_file_that_is_none_or_of_another_encoding_makes_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "said.wav"
    with pytest.raises(ConfigError) as error:
        read_wav(path)
    assert str(error.value).startswith(f"{path}: no WAV file that can be read: No such file or directory; ")
    content = write(tmp_path).read_bytes()
    floats = content[:20] + b"\3" + content[21:]
    for cut in (*(content[:size] for size in range(45)), floats, b"no sound at all"):
        path.write_bytes(cut)
        with pytest.raises(ConfigError, match=r"^[^\n]*no WAV file that can be read: [^\n]*$"):
            read_wav(path)
