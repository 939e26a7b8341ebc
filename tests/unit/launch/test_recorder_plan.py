"""The last sentence of a run that recorded itself."""

from pathlib import Path

import pytest

from pointit.launch.recorder import recorded, recorder_launch
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import check_launches
from tests.support.recorded import session, write_recording


def test_recording_that_was_cut_off_is_not_told_as_a_success(tmp_path: Path) -> None:
    launch = recorder_launch(tmp_path / "session.mcap")
    assert "is not there" in recorded(launch)
    write_recording(tmp_path / "session.mcap", session("scenario_1", 1.0))
    content = (tmp_path / "session.mcap").read_bytes()
    assert recorded(launch).endswith(" MB")
    (tmp_path / "session.mcap").write_bytes(content[:-100])
    assert recorded(launch).endswith("cut off; the log says why")


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("/proc/x.mcap", r"/proc/x\.mcap: cannot be written \(.+\); record in another folder"),
        ("/none/x.mcap", "its folder does not exist; create it, or record elsewhere"),
        ("/proc", "/proc is a folder; give a file in it, such as /proc/session.mcap"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused_before_anything_starts(file: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        check_launches([recorder_launch(Path(file))])


def test_a_check_leaves_no_file(tmp_path: Path) -> None:
    check_launches([recorder_launch(tmp_path / "x.mcap")])
    assert list(tmp_path.iterdir()) == []
