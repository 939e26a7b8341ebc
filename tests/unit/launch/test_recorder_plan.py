"""The last sentence of a run that recorded itself."""

from pathlib import Path

from pointit.launch.plan.recorder import recorded, recorder_launch
from tests.support.recorded import session, write_recording


def test_recording_that_was_cut_off_is_not_told_as_a_success(tmp_path: Path) -> None:
    launch = recorder_launch(tmp_path / "session.mcap")
    assert "is not there" in recorded(launch)
    write_recording(tmp_path / "session.mcap", session("scenario_1", 1.0))
    content = (tmp_path / "session.mcap").read_bytes()
    assert recorded(launch).endswith(" MB")
    (tmp_path / "session.mcap").write_bytes(content[:-100])
    assert recorded(launch).endswith("cut off; the log says why")
