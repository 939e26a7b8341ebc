"""A small study, run with simulated participants."""

import csv
from pathlib import Path

from pointit.study.model import Study, read_study
from pointit.study.simulated import simulate
from pointit.study.study_folder import StudyFolder

SMALL = """
name: small
participants: 2
order: latin_square
task: {kind: reach}
factors:
  method: {levels: {hold: {selector.method: hold}, gauge: {selector.method: gauge}}}
repetitions: 2
questionnaires: [sus]
"""


def small(folder: Path, text: str = SMALL) -> tuple[Study, StudyFolder]:
    """Return the study of `text` and its data below `folder`."""
    folder.mkdir(exist_ok=True)
    file = folder / "small.yaml"
    file.write_text(text)
    study = read_study(file)
    return study, StudyFolder(folder / "data", study, text)


def simulate_all(study: Study, folder: StudyFolder) -> None:
    """Run all participants."""
    for name in study.people:
        simulate(study, folder, name, lambda _status: None)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        return [*csv.DictReader(file)]
