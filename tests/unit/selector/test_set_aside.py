"""A damaged journal is set aside by one process, and the next ones say so."""

from pathlib import Path

import pytest

from pointit.schemas import NS_PER_S
from pointit.services.selector.service import Selector
from pointit.services.selector.store.journal import Journal

NOW_NS = 1_700_000_000 * NS_PER_S


def test_file_set_aside_by_an_earlier_process_is_named_for_a_day_and_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a run, which closes what is selected before its selector begins."""
    (tmp_path / "journal.sqlite").write_bytes(b"damaged while it ran" * 100)

    def folder(_site: str, _service: str) -> Path:
        return tmp_path

    monkeypatch.setattr("pointit.services.selector.service.site_folder", folder)
    Selector.discard_saved_state("lab", NOW_NS)
    [aside] = tmp_path.glob("journal.corrupt-*")
    assert f"was damaged and is now {aside.name}" in caplog.text
    day_ns = 86_400 * NS_PER_S
    for now_ns, is_told in ((NOW_NS + NS_PER_S, True), (NOW_NS + day_ns, True), (NOW_NS + day_ns + 1, False)):
        journal = Journal(tmp_path)
        journal.begin(now_ns)
        assert (aside.name in journal.problem) == is_told
        journal.close()
