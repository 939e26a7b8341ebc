"""Rows and answers are compared with the plan by check, run and report alike."""

from collections.abc import Callable
from pathlib import Path

import pytest

import pointit
from pointit import study_report
from pointit.errors import PointItError
from pointit.runtime.errors import ConfigError
from pointit.study.check import check_folder
from pointit.study.model import Study
from pointit.study.plan import plan_of
from pointit.study.session import Session
from pointit.study.simulated import SimulatedView
from pointit.study.study_folder import StudyFolder
from pointit.study.study_site import SiteOptions
from tests.unit.study.studies import small

RATIOS = """
name: ratios
participants: 2
order: latin_square
task: {kind: reach}
factors:
  ratio: {levels: {'1.1': {task.width_m: 0.2}, '1.10': {task.width_m: 0.3}}}
questionnaires: [sus]
"""


@pytest.fixture
def ratios(tmp_path: Path) -> tuple[Study, StudyFolder]:
    """Return a study whose levels a spreadsheet cannot tell apart, with the trials and answers of P01."""
    study, folder = small(tmp_path, RATIOS)
    table, answers = folder.trials("P01"), folder.answers("P01")
    for trial in plan_of(study, "P01").trials:
        usual = {"participant": "P01", "block": trial.block, "attempt": 1, "practice": False}
        numbers = {"selection_s": 1.5, "path_length_deg": 12.5, "corrections": 1}
        row = {**usual, "trial": trial.number, "outcome": "hit", **trial.cell, **numbers}
        table.append({**row, "began_utc": f"2026-03-02T09:0{trial.number}:00+00:00"})
        answers.append(
            *(
                {**usual, "questionnaire": "sus", "condition": trial.cell["ratio"], "item": item, "value": 3}
                for item in range(1, 11)
            )
        )
    table.close()
    answers.close()
    folder.put_about("P01", {"pseudonym": "P01", "simulated": False, "seed": 0, "begun": "2026-03-02 09:00"})
    return study, folder


def verdicts(study: Study, folder: StudyFolder) -> dict[str, str]:
    """Return the first error of check, run and report by their name, `""` if there is none."""

    def run() -> None:
        Session(
            study, folder, "P01", SimulatedView(0, lambda _: None), SiteOptions(imu="page")
        )._table.close()
        folder.answers("P01").close()

    def check() -> None:
        for finding in check_folder(folder.path):
            if finding.severity == "error" and finding.participant:
                raise PointItError(finding.text)

    found: dict[str, str] = {}
    calls: dict[str, Callable[[], object]] = {
        "check": check,
        "run": run,
        "report": lambda: study_report.trials(folder.path),
    }
    for name, call in calls.items():
        try:
            call()
        except PointItError as error:
            found[name] = str(error)
        else:
            found[name] = ""
    return found


def replace_in(path: Path, before: bytes, after: bytes) -> None:
    content = path.read_bytes()
    assert before in content
    path.write_bytes(content.replace(before, after))


def test_rows_of_the_plan_are_accepted_by_check_run_and_report(ratios: tuple[Study, StudyFolder]) -> None:
    assert verdicts(*ratios) == {"check": "", "run": "", "report": ""}


@pytest.mark.parametrize(
    ("table", "before", "after", "sentence"),
    [
        ("trials.csv", b",1.10,", b",1.1,", "not that of the plan: ratio is '1.1', in the plan '1.10'"),
        ("trials.csv", b"P01,2,2,1,", b"P01,2,7,1,", "trial 7 is not that of the plan, which has 2"),
        ("trials.csv", b"P01,2,2,1,", b"P02,2,2,1,", "P01 has data of P02"),
        ("trials.csv", b",1.5,", b",-1.5,", "trial 1: selection_s is -1.5, which is below 0"),
        ("trials.csv", b",12.5,", b",1e999,", "line 2: path_length_deg is '1e999', not a number or empty"),
        ("trials.csv", b",12.5,", b",1234567,", "trial 1: path_length_deg is 1234567, limit 40000"),
        ("trials.csv", b",1,12.5,", b",-1,12.5,", "trial 1: corrections is -1, which is below 0"),
        ("answers.csv", b",1.10,", b",1.1,", "block 2 has condition '1.1', in the plan '1.10'"),
        ("answers.csv", b"P01,", b"P02,", "P01 has answers of P02"),
    ],
)  # fmt: skip
def test_damaged_rows_are_refused_alike_by_check_run_and_report(
    ratios: tuple[Study, StudyFolder], table: str, before: bytes, after: bytes, sentence: str
) -> None:
    replace_in(ratios[1].path / "P01" / table, before, after)
    found = verdicts(*ratios)
    assert all(sentence in text for text in found.values()), found


def test_rows_without_a_record_of_the_person_are_not_continued_and_are_noted(
    ratios: tuple[Study, StudyFolder],
) -> None:
    study, folder = ratios
    table = folder.path / "P01/trials.csv"
    replace_in(table, table.read_bytes().splitlines(keepends=True)[2], b"")
    (folder.path / "P01/participant.yaml").unlink()
    sentence = "does not state whether the trials are of a person"
    session = Session(study, folder, "P01", SimulatedView(0, lambda _: None), SiteOptions(imu="page"))
    with pytest.raises(ConfigError, match=sentence):
        pointit.run_virtually(session.run())
    assert any(sentence in each.text and each.severity == "error" for each in check_folder(folder.path))
    assert any(sentence in note for note in study_report.trials(folder.path).notes)
