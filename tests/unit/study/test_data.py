"""Rows are whole or not there: after a crash in the middle of one, on a full disk, with two processes."""

import os
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError, PointItError
from pointit.study.append_only_csv import AppendOnlyCsv
from pointit.study.data import StudyFolder, read_table
from pointit.study.model import Study

COLUMNS = ("trial", "reason")
DAMAGED = ("trial", "attempt", "selection_s")


def test_row_that_a_crash_has_cut_off_is_removed_at_each_byte(tmp_path: Path) -> None:
    table = AppendOnlyCsv(tmp_path / "t.csv", COLUMNS)
    table.append({"trial": 1, "reason": 'said "no", and\nleft'})
    whole = table.path.read_bytes()
    table.append({"trial": 2, "reason": "x"})
    table.close()
    content = table.path.read_bytes()
    for size in range(len(whole), len(content)):
        table.path.write_bytes(content[:size])
        again = AppendOnlyCsv(table.path, COLUMNS)
        assert [row["trial"] for row in again.rows] == ["1"]
        again.append({"trial": 2, "reason": "x"})
        again.close()
        assert table.path.read_bytes() == content


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ("x,,", "line 3: trial is 'x', not a whole number"),
        ("1,1,soon", "line 3: selection_s is 'soon', not a number or empty; correct or delete the line"),
        ("1,1", "line 3: not 3 values"),
        ("1,\xff,", "cannot be read"),
    ],
)
def test_damaged_row_is_said_with_its_line(tmp_path: Path, row: str, sentence: str) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"trial,attempt,selection_s\n1,1,2.0\n" + row.encode("latin-1") + b"\n")
    with pytest.raises(ConfigError, match=rf"t\.csv.* {sentence}"):
        read_table(path, DAMAGED)


def test_full_disk_is_said_and_the_rows_before_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = AppendOnlyCsv(tmp_path / "t.csv", COLUMNS)
    table.append({"trial": 1})

    def full(_number: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(
            PointItError, match=r"t\.csv: a row cannot be written \(No space left on device\).*make room"
        ):
            table.append({"trial": 2})
    assert [row["trial"] for row in read_table(table.path, COLUMNS)] == ["1"]
    table.append({"trial": 2})
    table.close()
    assert [row["trial"] for row in read_table(table.path, COLUMNS)] == ["1", "2"]


def test_participant_runs_once_at_a_time_and_a_folder_holds_one_study(tmp_path: Path) -> None:
    study = Study.model_validate({"name": "s", "participants": 2, "task": {"kind": "reach"}})
    folder = StudyFolder(tmp_path / "data", study, "name: s")
    table = folder.trials("P01")
    with pytest.raises(ConfigError, match="another process runs this participant"):
        folder.trials("P01")
    table.close()
    folder.trials("P01").close()
    (tmp_path / "columns.csv").write_text("mine")
    with pytest.raises(ConfigError, match=r"columns\.csv is not of this study"):
        StudyFolder(tmp_path, study, "name: s")
    with pytest.raises(ConfigError, match="differs from the study; use another folder"):
        StudyFolder(tmp_path / "data", study, "name: other")
