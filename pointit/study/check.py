"""Check of a study's folder: what is missing or wrong."""

import datetime as dt
import itertools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pointit.errors import ConfigError
from pointit.schemas.text import first_of
from pointit.study.model import SHIPPED, Study
from pointit.study.order import imbalance
from pointit.study.plan import check_names, check_sequences, plan_of, row_errors
from pointit.study.scenario import check_services
from pointit.study.session import CLOCK_APART_S
from pointit.study.study_folder import (
    TRIALS,
    check_begun,
    check_record,
    read_about,
    read_answers,
    read_any_trials,
    study_in,
)
from pointit.study.table_file import Row, counts, done_trials


class StudyFinding(NamedTuple):
    """Something that is missing or wrong."""

    severity: Literal["error", "note"]
    participant: str
    """`""` if it concerns the whole study."""
    text: str


def check_folder(folder: Path) -> list[StudyFinding]:
    """Return the findings on the data of a study, errors first.

    Raises: ConfigError: If the folder holds no study, or its copy of the file is damaged.
    """
    study = study_in(folder)
    findings = _of_study(study)
    begun: dict[str, list[Row]] = {}
    for path in sorted(path for path in folder.iterdir() if path.is_dir()):
        findings += _of_folder(study, path, begun)
    findings += [StudyFinding("error", "", text) for text in _twice(begun, folder)]

    # All participants together: a damaged one is not missing.
    damaged = {finding.participant for finding in findings}
    missing = [name for name in study.people if name not in begun.keys() | damaged]
    if missing:
        findings.append(StudyFinding("note", "", f"not begun: {', '.join(missing)}"))
    orders = [plan_of(study, name).order for name in study.people if name not in missing]
    problem = imbalance(orders, study.order)
    if problem and missing:
        findings.append(StudyFinding("note", "", f"orders are not balanced so far: {problem}"))
    elif problem:
        findings.append(StudyFinding("error", "", f"orders are not balanced: {problem}"))
    return sorted(findings, key=lambda finding: finding.severity != "error")


def _of_study(study: Study) -> list[StudyFinding]:
    """Return the findings on the study's file."""
    checks: list[Callable[[Study], None]] = [check_names]
    if study.scenario in SHIPPED:  # another one may be elsewhere
        checks.append(check_services)
    checks.append(check_sequences)
    findings: list[StudyFinding] = []
    for check in checks:
        try:
            check(study)
        except ConfigError as error:
            findings.append(StudyFinding("error", "", str(error)))
    return findings


def _of_folder(study: Study, path: Path, begun: dict[str, list[Row]]) -> Iterator[StudyFinding]:
    """Yield the findings on the folder of one participant, and put their rows into `begun`.

    What is damaged is reported, and not looked at further.
    """
    name = path.name
    notes: list[str] = []
    try:
        about = read_about(path)
        check_begun(path)
        if not (path / TRIALS).exists():
            return
        begun[name] = read_any_trials(study, path, notes.append)
        if name in study.people:
            read_answers(study, path, notes.append)
        check_record(path, about, begun[name])
    except ConfigError as error:
        yield StudyFinding("error", name, str(error))
        return
    for note in notes:
        yield StudyFinding("note", name, note)
    if name in study.people:
        yield from _of_participant(study, name, about, begun[name])
    else:
        yield StudyFinding("error", name, "does not take part in the study; remove the folder")


def _of_participant(
    study: Study, name: str, about: Mapping[str, Any], rows: list[Row]
) -> Iterator[StudyFinding]:
    """Yield the findings on one participant's data."""
    plan = plan_of(study, name)
    missing = sorted({trial.number for trial in plan.trials} - done_trials(rows))
    if missing:
        numbers = first_of(map(str, missing), 5)
        text = f"{len(missing)} of {len(plan.trials)} trials are missing: {numbers}"
        if about.get("ended"):
            yield StudyFinding("error", name, text)
        else:
            yield StudyFinding("note", name, f"{text}; the same command goes on")

    # The record of the sessions, as far as it is there.
    if about.get("order", list(plan.order)) != list(plan.order):
        yield StudyFinding("error", name, f"had the order {about['order']}, the plan has {list(plan.order)}")
    pseudonym = str(about.get("pseudonym", name))
    if pseudonym != name:
        yield StudyFinding("error", name, f"{name} has the participant.yaml of {pseudonym}")

    # The rows.
    for text in row_errors(plan, rows):
        yield StudyFinding("error", name, text)
    numbers_in_order = [int(row["trial"]) for row in rows]
    if numbers_in_order != sorted(numbers_in_order):
        yield StudyFinding(
            "note", name, "trials are not in the order of their plan: they were sorted otherwise"
        )
    skipped = [row["trial"] for row in rows if _is_skipped(row)]
    if skipped:
        yield StudyFinding("note", name, f"skipped: trial {', '.join(skipped)}")
    if not about.get("simulated"):  # of earlier versions, virtual time began again after a crash
        yield from _clocks(name, rows, float(about.get("clock_apart_s", 0.0)))


def _is_skipped(row: Row) -> bool:
    return row["outcome"] == "skipped" and counts(row)


def _clocks(name: str, rows: list[Row], apart_s: float) -> Iterator[StudyFinding]:
    """Yield errors of clocks: `apart_s` is the largest difference between those of wrist and site."""
    if apart_s > CLOCK_APART_S:
        yield StudyFinding("error", name, f"the wrist's clock is {apart_s:g} s apart from the site's")
    for previous, row in itertools.pairwise(filter(_began, rows)):
        min_s = float(previous["selection_s"] or 0.0)
        passed_s = (_time(row) - _time(previous)).total_seconds()
        if passed_s < min_s:
            trials = f"trial {row['trial']} begins before trial {previous['trial']} ends"
            yield StudyFinding("error", name, f"{trials}: a clock was set back")


def _twice(begun: dict[str, list[Row]], folder: Path) -> Iterator[str]:
    """Yield a sentence on each participant whose data stand in two folders."""
    owners: dict[str, str] = {}
    for name, rows in begun.items():
        participants = {row["participant"] for row in rows}
        participants.add(str(read_about(folder / name).get("pseudonym", name)))
        for participant in sorted(participants):
            owner = owners.setdefault(participant, name)
            if owner != name:
                yield f"{participant} is there twice, in {owner} and {name}"


def _began(row: Row) -> str:
    return row["began_utc"]


def _time(row: Row) -> dt.datetime:
    return dt.datetime.fromisoformat(row["began_utc"])
