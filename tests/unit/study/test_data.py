"""Rows are whole or not there: after a crash in the middle of one, on a full disk, with two processes."""

import csv
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError, PointItError
from pointit.study.append_only_csv import AppendOnlyCsv
from pointit.study.check import check_folder
from pointit.study.model import Study, read_study
from pointit.study.scenario import check_ready
from pointit.study.study_folder import StudyFolder, read_table

COLUMNS = ("trial", "reason")


def test_row_truncated_at_any_byte_is_moved_to_another_file(tmp_path: Path) -> None:
    table = AppendOnlyCsv(tmp_path / "t.csv", COLUMNS)
    table.append({"trial": 1, "reason": 'said "no", and\nleft'})
    whole = table.path.read_bytes()
    table.append({"trial": 2, "reason": "x"})
    table.close()
    content = table.path.read_bytes()
    sizes = range(len(whole), len(content))
    for number, size in enumerate(sizes):
        table.path.write_bytes(content[:size])
        notes: list[str] = []
        again = AppendOnlyCsv(table.path, COLUMNS, on_note=notes.append)
        assert [row["trial"] for row in again.rows] == ["1"]
        again.append({"trial": 2, "reason": "x"})
        again.close()
        assert table.path.read_bytes() == content
        aside = tmp_path / f"incomplete_t{f'_{number}' if number > 1 else ''}.csv"
        if size > len(whole):
            assert aside.read_bytes() == content[len(whole) : size]
            assert notes == [f"{table.path}: the last row was cut off and is moved to {aside.name}."]

    assert len([*tmp_path.iterdir()]) == len(sizes)


def test_full_disk_is_said_and_the_rows_before_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = AppendOnlyCsv(tmp_path / "t.csv", COLUMNS)
    table.append({"trial": 1})

    def full(_number: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(
            PointItError, match=r"t\.csv: a row cannot be written \(no space left on device\).*make room"
        ):
            table.append({"trial": 2})
    assert [row["trial"] for row in read_table(table.path, COLUMNS)] == ["1"]
    table.append({"trial": 2})
    table.close()
    assert [row["trial"] for row in read_table(table.path, COLUMNS)] == ["1", "2"]


def test_participant_runs_once_at_a_time_and_folders_hold_one_study(tmp_path: Path) -> None:
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


def saved_in_place(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def saved_as_another_file(path: Path, content: bytes) -> None:
    path.with_suffix(".tmp").write_bytes(content)
    path.with_suffix(".tmp").replace(path)


def deleted(path: Path, content: bytes) -> None:
    del content
    path.unlink()


@pytest.mark.parametrize("save", [saved_in_place, saved_as_another_file, deleted])
@pytest.mark.parametrize("ends_first", [True, False])
@pytest.mark.parametrize("dialect", [b"\n", b"\r\n", b"no table"])
def test_rows_added_while_another_program_saves_are_not_lost(
    tmp_path: Path, save: Callable[[Path, bytes], None], dialect: bytes, *, ends_first: bool
) -> None:
    path = tmp_path / "t.csv"
    table = AppendOnlyCsv(path, COLUMNS, ("trial",))
    table.append({"trial": 1, "reason": "a"})
    opened = path.read_bytes()
    table.append({"trial": 2, "reason": "b"})

    saved = dialect if b" " in dialect else opened.replace(b"\n", dialect)
    save(path, saved)
    with pytest.raises(PointItError, match=r"all \d rows are in measured_t\.csv: move that to t\.csv"):
        table.close() if ends_first else table.append({"trial": 3, "reason": "c"})

    table.close()
    if save is not deleted:
        assert path.read_bytes() == saved

    (tmp_path / "measured_t.csv").replace(path)
    again = AppendOnlyCsv(path, COLUMNS, ("trial",))
    assert [row["trial"] for row in again.rows] == (["1", "2"] if ends_first else ["1", "2", "3"])
    again.close()


def test_texts_are_no_formulas_for_spreadsheets_and_come_back(tmp_path: Path) -> None:
    columns = ("trial", "reason", "error_m", "value")
    texts = ["=1+1", "+1", "-1", "@a", "\tx", "'quoted", "plain", "-"]
    table = AppendOnlyCsv(tmp_path / "t.csv", columns)
    table.append(
        *({"trial": n, "reason": text, "error_m": -0.5, "value": -3} for n, text in enumerate(texts))
    )
    table.close()
    with table.path.open(newline="") as file:
        cells = [row["reason"] for row in csv.DictReader(file)]

    assert cells == ["'=1+1", "'+1", "'-1", "'@a", "'\tx", "'quoted", "plain", "'-"]
    assert b",-0.5,-3\n" in table.path.read_bytes()
    again = AppendOnlyCsv(table.path, columns)
    assert [row["reason"] for row in again.rows] == texts

    again.append({"trial": 9})
    again.close()
    assert [each.name for each in tmp_path.iterdir()] == ["t.csv"]


STUDY = """name: s
participants: ['01', '02']
timeout_s: 10
task: {kind: reach}
factors: {width: {levels: {'0.30': {task.width_m: 0.3}, '0.5': {task.width_m: 0.5}}}}
"""


def study_folder(path: Path, text: str = STUDY, notes: list[str] | None = None) -> StudyFolder:
    (path / "s.yaml").write_text(text)
    return StudyFolder(
        path / "data", read_study(path / "s.yaml"), text, (notes if notes is not None else []).append
    )


def measured(path: Path, *rows: dict[str, object]) -> Path:
    """Return the table of participant 01 with `rows`, and what they have begun."""
    folder = study_folder(path)
    table = folder.trials("01")
    usual = {"participant": "01", "block": 1, "attempt": 1, "practice": False, "width": "0.30"}
    table.append(*({**usual, "outcome": "hit", "trial": n, **row} for n, row in enumerate(rows, 1)))
    table.close()
    folder.put_about("01", {"pseudonym": "01", "simulated": False, "seed": 0, "begun": "2026-02-03 10:00"})
    return table.path


@pytest.mark.parametrize("level", ["None", "NA", "null", "nan", "n/a", "#N/A", "<missing>", "."])
def test_level_that_reads_as_missing_is_refused_before_a_study(tmp_path: Path, level: str) -> None:
    study_folder(tmp_path, text := STUDY.replace("'0.30'", f"'{level}'"))
    with pytest.raises(ConfigError, match="is read as a missing value by programs for statistics: give it"):
        check_ready(read_study(tmp_path / "s.yaml"))
    assert any(repr(level) in each.text for each in check_folder(tmp_path / "data"))
    (tmp_path / "s.yaml").write_text(text.replace(f"'{level}'", "'no light'"))
    check_ready(read_study(tmp_path / "s.yaml"))


@pytest.mark.parametrize("level", [" wide", "wide ", "two\\nlines", "'=wide", "''-wide", "=wide"])
def test_any_name_of_a_level_is_read_back(tmp_path: Path, level: str) -> None:
    study_folder(tmp_path, STUDY.replace("'0.30'", f'"{level}"'))
    level = level.replace("\\n", "\n")
    folder = StudyFolder(
        tmp_path / "data", read_study(tmp_path / "s.yaml"), (tmp_path / "s.yaml").read_text()
    )
    usual = {"participant": "01", "block": 1, "trial": 1, "attempt": 1, "practice": False, "width": level}
    table = folder.trials("01")
    table.append({**usual, "outcome": "hit"})
    table.close()
    again = folder.trials("01")
    again.close()
    assert [row["width"] for row in again.rows] == [level]


@pytest.mark.parametrize("content", [None, b"", b"\n", b" \r\n"])
def test_lost_table_of_a_started_participant_is_not_begun_again(
    tmp_path: Path, content: bytes | None
) -> None:
    path = measured(tmp_path, {})
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"trials\.csv: is (missing|empty), but 01 has begun") as refused:
        study_folder(tmp_path).trials("01")
    assert str(refused.value) in [each.text for each in check_folder(tmp_path / "data")]


def test_files_saved_by_an_editor_are_read_the_same(tmp_path: Path) -> None:
    measured(tmp_path, {})
    copy = tmp_path / "data/study.yaml"
    copy.write_bytes(
        b"\xef\xbb\xbf# ours\r\n" + copy.read_bytes().replace(b"\n", b"\r\n").replace(b"'", b'"')
    )
    about = tmp_path / "data/01/participant.yaml"
    about.write_bytes(b"\xef\xbb\xbf# left-handed\r\n" + about.read_bytes().replace(b"\n", b"\r\n"))
    edited = about.read_bytes()

    notes = list[str]()
    folder = study_folder(tmp_path, notes=notes)
    known = folder.about("01")
    assert (known["pseudonym"], known["simulated"]) == ("01", False)

    folder.put_about("01", {**known, "seed": 1})
    folder.put_about("01", {**known, "seed": 2})
    assert about.with_name("edited_participant.yaml").read_bytes() == edited
    assert len(notes) == len([*about.parent.glob("edited*")]) == 1
    with pytest.raises(ConfigError, match=r"differs from the study; use another folder.*see timeout_s"):
        study_folder(tmp_path, STUDY.replace("timeout_s: 10", "timeout_s: 20"))


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("consented: maybe", "consented: write true or false"),
        ("consented: 1", "consented: write true or false"),
        ("simulated: 1", "simulated: write true or false"),
        ("clock_apart_s: 0,7", "clock_apart_s: write a number"),
        ("order: slow", "order: write a list"),
        ("ended: [1, 2]", "ended"),
        ("ended: [", "is not YAML"),
    ],
)
def test_damaged_participant_record_is_reported_by_run_and_check(
    tmp_path: Path, line: str, sentence: str
) -> None:
    measured(tmp_path, {})
    with (tmp_path / "data/01/participant.yaml").open("a") as file:
        file.write(line + "\n" if not line.startswith("simulated") else "")
    if line.startswith("simulated"):
        about = tmp_path / "data/01/participant.yaml"
        about.write_text(about.read_text().replace("simulated: false", line))
    with pytest.raises(ConfigError, match=sentence) as refused:
        study_folder(tmp_path).about("01")
    assert str(refused.value) in [each.text for each in check_folder(tmp_path / "data")]
