"""Sound files: one that cannot be used is named, with what to do."""

import wave
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit.speech.audio import WavFile
from tests.support.bench import ManualClock


def test_a_file_that_cannot_be_read_is_named_once(tmp_path: Path) -> None:
    path = tmp_path / "said.wav"
    with pytest.raises(ConfigError) as error:
        WavFile(path, ManualClock())
    assert str(error.value) == f"{path}: no WAV file that can be read: No such file or directory"
    path.write_bytes(b"RIFF")
    with pytest.raises(ConfigError, match="no WAV file that can be read"):
        WavFile(path, ManualClock())


def test_a_file_of_another_rate_is_refused_with_the_command_that_converts_it(tmp_path: Path) -> None:
    path = tmp_path / "said.wav"
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 44_100, 0, "NONE", ""))
    with pytest.raises(ConfigError, match="`sox IN -r 16k -b 16 -c 1 OUT`"):
        WavFile(path, ManualClock())
