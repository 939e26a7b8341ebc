"""Check of a study's folder: what is missing or wrong."""

import datetime as dt
import itertools
from collections.abc import Iterator, Mapping
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


class Finding(NamedTuple):
    """Something that is missing or wrong."""

    severity: Literal["error", "note"]
    participant: str
    """`""` if it concerns the whole study."""
    text: str


def check_folder(folder: Path) -> list[Finding]:
    """Return the findings on the data of a study, errors first.

    Raises: ConfigError: If the folder holds no study, or its copy of the file is damaged.
    """
    study = study_in(folder)
    findings: list[Finding] = []
    of_site = [check_services] if study.scenario in SHIPPED else []  # another one may be elsewhere
    for check in (check_names, *of_site, check_sequences):
        try:
            check(study)
        except ConfigError as error:
            findings.append(Finding("error", "", str(error)))
    begun: dict[str, list[Row]] = {}
    for path in sorted(each for each in folder.iterdir() if each.is_dir()):
        name = path.name
        try:
            about = read_about(path)
            check_begun(path)
            if not (path / TRIALS).exists():
                continue
            notes: list[str] = []
            begun[name] = read_any_trials(study, path, notes.append)
            if name in study.people:
                read_answers(study, path, notes.append)
            check_record(path, about, begun[name])
        except ConfigError as error:
            findings.append(Finding("error", name, str(error)))
            continue
        findings += [Finding("note", name, note) for note in notes]
        if name not in study.people:
            findings.append(Finding("error", name, "does not take part in the study; remove the folder"))
        else:
            findings += _of_one(study, name, about, begun[name])
    findings += [Finding("error", "", text) for text in _twice(begun, folder)]
    damaged = {finding.participant for finding in findings}
    missing = [name for name in study.people if name not in begun.keys() | damaged]
    if missing:
        findings.append(Finding("note", "", f"not begun: {', '.join(missing)}"))
    orders = [plan_of(study, name).order for name in study.people if name not in missing]
    if broken := imbalance(orders, study.order):
        findings.append(
            Finding(
                "note" if missing else "error",
                "",
                f"orders are not balanced{' so far' if missing else ''}: {broken}",
            )
        )
    return sorted(findings, key=lambda finding: finding.severity != "error")


def _of_one(study: Study, name: str, about: Mapping[str, Any], rows: list[Row]) -> Iterator[Finding]:
    plan = plan_of(study, name)
    missing = sorted({trial.number for trial in plan.trials} - done_trials(rows))
    if missing:
        some = first_of(map(str, missing), 5)
        ended = bool(about.get("ended"))
        text = f"{len(missing)} of {len(plan.trials)} trials are missing: {some}"
        yield Finding(
            "error" if ended else "note", name, text + ("" if ended else "; the same command goes on")
        )
    if about.get("order", list(plan.order)) != list(plan.order):
        yield Finding("error", name, f"had the order {about['order']}, the plan has {list(plan.order)}")
    if (pseudonym := str(about.get("pseudonym", name))) != name:
        yield Finding("error", name, f"{name} has the participant.yaml of {pseudonym}")
    for text in row_errors(plan, rows):
        yield Finding("error", name, text)
    if any(int(one["trial"]) > int(two["trial"]) for one, two in itertools.pairwise(rows)):
        yield Finding("note", name, "trials are not in the order of their plan: they were sorted otherwise")
    if skipped := [row["trial"] for row in rows if counts(row) and row["outcome"] == "skipped"]:
        yield Finding("note", name, f"skipped: trial {', '.join(skipped)}")
    if not about.get("simulated"):  # of earlier versions, virtual time began again after a crash
        yield from _clocks(name, rows, float(about.get("clock_apart_s", 0.0)))


def _clocks(name: str, rows: list[Row], apart_s: float) -> Iterator[Finding]:
    if apart_s > CLOCK_APART_S:
        yield Finding("error", name, f"the wrist's clock is {apart_s:g} s apart from the site's")
    before: Row | None = None
    for row in filter(_began, rows):
        if before is not None:
            min_s = float(before["selection_s"] or 0.0)
            passed_s = (_time(row) - _time(before)).total_seconds()
            if passed_s < min_s:
                text = (
                    f"trial {row['trial']} begins before trial {before['trial']} ends: a clock was set back"
                )
                yield Finding("error", name, text)
        before = row


def _twice(begun: dict[str, list[Row]], folder: Path) -> Iterator[str]:
    """Yield a sentence on each participant whose data stand in two folders."""
    owners: dict[str, str] = {}
    for name, rows in begun.items():
        names = {row["participant"] for row in rows} | {str(read_about(folder / name).get("pseudonym", name))}
        for other in sorted(names):
            if (first := owners.setdefault(other, name)) != name:
                yield f"{other} is there twice, in {first} and {name}"


def _began(row: Row) -> str:
    return row["began_utc"]


def _time(row: Row) -> dt.datetime:
    return dt.datetime.fromisoformat(row["began_utc"])
