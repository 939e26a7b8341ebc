"""Check of a study's folder: what is missing or wrong."""

import datetime as dt
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from pointit.runtime.errors import ConfigError
from pointit.study.data import TRIALS, Row, counts, done_trials, read_about, read_table, study_in
from pointit.study.model import SHIPPED, Study
from pointit.study.order import imbalance
from pointit.study.plan import plan_of
from pointit.study.session import CLOCK_APART_S
from pointit.study.site.scenario import check_services


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
    if study.scenario in SHIPPED:  # another one is beside the file, which may be elsewhere
        try:
            check_services(study)
        except ConfigError as error:
            findings.append(Finding("error", "", str(error)))
    begun: dict[str, list[Row]] = {}
    for path in sorted(folder.glob(f"*/{TRIALS}")):
        name = path.parent.name
        try:
            begun[name] = read_table(path)
        except ConfigError as error:
            findings.append(Finding("error", name, str(error)))
            continue
        if name not in study.people:
            findings.append(Finding("error", name, "does not take part in the study; remove the folder"))
        else:
            findings += _of_one(study, name, path.parent, begun[name])
    findings += [Finding("error", "", text) for text in _twice(begun, folder)]
    missing = [name for name in study.people if name not in begun]
    if missing:
        findings.append(Finding("note", "", f"not begun: {', '.join(missing)}"))
    orders = [plan_of(study, name).order for name in study.people if name in begun]
    if broken := imbalance(orders, study.order):
        findings.append(
            Finding(
                "note" if missing else "error",
                "",
                f"orders are not balanced{' so far' if missing else ''}: {broken}",
            )
        )
    return sorted(findings, key=lambda finding: finding.severity != "error")


def _of_one(study: Study, name: str, folder: Path, rows: list[Row]) -> Iterator[Finding]:
    plan, about = plan_of(study, name), read_about(folder)
    missing = sorted({trial.number for trial in plan.trials} - done_trials(rows))
    if missing:
        some = ", ".join(map(str, missing[:5])) + (" ..." if len(missing) > 5 else "")
        ended = bool(about.get("ended"))
        text = f"{len(missing)} of {len(plan.trials)} trials are missing: {some}"
        yield Finding(
            "error" if ended else "note", name, text + ("" if ended else "; the same command goes on")
        )
    if about.get("order", list(plan.order)) != list(plan.order):
        yield Finding("error", name, f"had the order {about['order']}, the plan has {list(plan.order)}")
    by_number = {trial.number: trial for trial in plan.trials}
    for row in rows:
        trial = by_number.get(int(row["trial"]))
        if trial is None or any(row.get(factor) != level for factor, level in trial.cell.items()):
            yield Finding("error", name, f"trial {row['trial']} is not that of the plan")
    if twice := [key for key, n in Counter((row["trial"], row["attempt"]) for row in rows).items() if n > 1]:
        yield Finding("error", name, f"attempt {twice[0][1]} at trial {twice[0][0]} is there twice")
    if skipped := [row["trial"] for row in rows if counts(row) and row["outcome"] == "skipped"]:
        yield Finding("note", name, f"skipped: trial {', '.join(skipped)}")
    if not about.get("simulated"):  # virtual time begins again after a crash
        yield from _clocks(name, rows, float(about.get("clock_apart_s", 0.0)))


def _clocks(name: str, rows: list[Row], apart_s: float) -> Iterator[Finding]:
    if apart_s > CLOCK_APART_S:
        yield Finding("error", name, f"the wrist's clock is {apart_s:g} s apart from the site's")
    before: Row | None = None
    for row in rows:
        if before is not None:
            least_s = float(before["selection_s"] or 0.0)
            passed_s = (_time(row) - _time(before)).total_seconds()
            if passed_s < least_s:
                text = (
                    f"trial {row['trial']} begins before trial {before['trial']} ends: a clock was set back"
                )
                yield Finding("error", name, text)
        before = row


def _twice(begun: dict[str, list[Row]], folder: Path) -> Iterator[str]:
    """Yield a sentence on each participant whose data stand in two folders."""
    owners: dict[str, str] = {}
    for name, rows in begun.items():
        said = {row["participant"] for row in rows} | {str(read_about(folder / name).get("pseudonym", name))}
        for other in sorted(said):
            if (first := owners.setdefault(other, name)) != name or other != name:
                yield (
                    f"{other} is there twice, in {first} and {name}"
                    if first != name
                    else f"{name} has data of {other}"
                )


def _time(row: Row) -> dt.datetime:
    return dt.datetime.fromisoformat(row["began_utc"])
