"""`pointit page FILE`: what cannot be opened is told in a sentence, and nothing is served."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from pointit.cli.page.page import command
from pointit.recording.entries import RecordingError


@pytest.mark.parametrize("content", [None, b"", b"plainly no recording"])
def test_what_is_no_recording_is_refused_in_a_sentence(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "lab.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"lab\.mcap"):
        CliRunner().invoke(command, [str(path)], catch_exceptions=False)
