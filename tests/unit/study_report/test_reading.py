"""Folders that are not whole: each is a sentence."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pointit import study_report
from pointit.errors import PointItError
from tests.unit.study_report.generated import RINGS, edit_trials, write_answers, write_study


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_study(tmp_path, {"dwell": 1.0, "press": 0.8}, people=3, rings=RINGS[:1], wrong=0.0)
    return tmp_path


def edited(before: str, after: str, name: str = "P02/trials.csv") -> Callable[[Path], object]:
    """Return an edit that replaces the first `before` in a table."""

    def edit(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        assert before in text
        (folder / name).write_text(text.replace(before, after, 1), encoding="utf-8")

    return edit


def replaced(name: str, content: bytes) -> Callable[[Path], object]:
    """Return an edit that replaces or makes a file."""

    def edit(folder: Path) -> None:
        (folder / name).write_bytes(content)

    return edit


def emptied(folder: Path) -> None:
    for path in folder.glob("P*/trials.csv"):
        path.unlink()


def unnamed(folder: Path) -> None:
    (folder / "study.yaml").unlink()


def copied(folder: Path) -> None:
    shutil.copytree(folder / "P01", folder / "P04")


def headed(folder: Path) -> None:
    for path in folder.glob("P*/trials.csv"):
        path.write_text(path.read_text(encoding="utf-8").splitlines(keepends=True)[0], encoding="utf-8")


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (emptied, "no trial besides practice; there is nothing to report"),
        (unnamed, r"there is no study\.yaml; give the folder that `pointit study run` has written"),
        (headed, "no trial besides practice; there is nothing to report"),
        (
            edited(",hit,", ",Hit,"),
            r"P02/trials\.csv, line 2: outcome is 'Hit', not one of hit, wrong, timeout",
        ),
        (edited(",dwell,", ",Dwell,"), r"P02/trials\.csv: method 'Dwell' is not of the study; correct it"),
        (replaced("study.yaml", b"factors: ["), "study.yaml: is not YAML in line 2"),
        (replaced("P02/trials.csv", b"\xff"), "another program has rewritten it"),
        (copied, "P04: P04 has data of P01"),
    ],
)
def test_damaged_folder_is_one_sentence(
    folder: Path, damage: Callable[[Path], object], sentence: str
) -> None:
    damage(folder)
    with pytest.raises(PointItError, match=sentence) as raised:
        study_report.trials(folder)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("lost", [3, 20, 100])
def test_truncated_last_line_is_left_out_and_noted(folder: Path, lost: int) -> None:
    path = folder / "P02/trials.csv"
    path.write_text(path.read_text(encoding="utf-8")[:-lost], encoding="utf-8")
    study = study_report.trials(folder)
    assert (len(study.rows), study.notes) == (
        59,
        ("The last line of P02/trials.csv is not whole and left out.",),
    )


def test_one_participant_has_medians_but_no_intervals(folder: Path) -> None:
    for name in ("P02", "P03"):
        (folder / name / "trials.csv").unlink()
    study = study_report.trials(folder)
    row = study_report.medians(study)[0]
    assert (row["participants"], row["low"]) == (1, None)
    assert row["median"] is not None
    assert study_report.differences(study)[0]["p"] is None
    with pytest.raises(PointItError, match="needs two participants"):
        study_report.mixed_model(study)


def test_participant_without_a_level_is_noted_and_not_compared(folder: Path) -> None:
    edit_trials(folder, "P02", lambda row: row["method"] != "press")
    study = study_report.trials(folder)
    assert study.notes == ("P02 has no trial with method press, and is left out of comparisons with it.",)
    assert study_report.differences(study)[0]["participants"] == 2


def test_last_attempt_counts_but_practice_and_repeats_do_not(folder: Path) -> None:
    path = folder / "P02/trials.csv"
    header, *lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    again = lines[0].replace("P02,1,1,1,0", "P02,1,1,2,0").replace(",hit,", ",timeout,")
    useless = lines[1].replace("P02,1,2,1,0", "P02,1,2,2,0").replace(",hit,,", ",hit,repeated: noise,")
    practice = lines[2].replace("P02,1,3,1,0", "P02,1,3,1,1")
    path.write_text("".join([header, again, *lines[:2], useless, practice, *lines[3:]]), encoding="utf-8")
    counted = [row for row in study_report.trials(folder).counted if row.participant == "P02"]
    assert [(row.trial, row.attempt, row.outcome) for row in counted[:3]] == [
        *((1, 2, "timeout"), (2, 1, "hit"), (4, 1, "hit"))
    ]


def test_levels_are_in_the_order_of_the_study(folder: Path) -> None:
    assert study_report.trials(folder).levels("method") == ("dwell", "press")
    write_study(folder, {"press": 1.0, "other": 1.0, "dwell": 1.0}, people=3, rings=RINGS[:1])
    for name in ("P01", "P02", "P03"):
        edit_trials(folder, name, lambda row: row["method"] != "other")
    study = study_report.trials(folder)
    assert study.conditions == (("press",), ("dwell",))
    assert study.title == "made"
    with pytest.raises(PointItError, match="no factor 'mode'; factors of this study: method"):
        study.levels("mode")


def test_answers_that_are_no_numbers_are_left_to_the_reader(folder: Path) -> None:
    write_answers(folder, "P01", {("own", "dwell"): [1]})
    edited(",1,1", ",1,well", "P01/answers.csv")(folder)
    with pytest.raises(PointItError, match="no answer to a questionnaire that is a number"):
        study_report.questionnaires(study_report.trials(folder))
