"""Page of broken situations. `python -m tests.unit.diagnosis.page` writes docs/reference/doctor.md."""

from collections.abc import Sequence
from pathlib import Path

from pointit.diagnosis.observation import Finding
from tests.unit.diagnosis.remedies import ACTS, ended_faults
from tests.unit.diagnosis.situations import SITUATIONS, Situation

PAGE = Path(__file__).parents[3] / "docs/reference/doctor.md"
HEAD = """# Broken situations

What `pointit doctor` reports when a site is broken, and the remedy. Each row is a test: a healthy site gets
the fault of its row, and doctor finds nothing else. *Tried as* states how the test applies the remedy:

- `command`: `pointit` accepts the printed command, or it is `kill -CONT` with the process's number.
- `option`: the service accepts the `--set`.
- `act`: it is done by hand. The test checks only that the words ask for it and name its object.

Other tests break real processes, people and routers, and follow the printed remedy until all is well
(`tests/e2e/run/test_doctor_faults.py`). Names and numbers are examples. `python -m tests.unit.diagnosis.page`
writes this page. [Troubleshooting](../how-to/troubleshooting.md) explains each code.

| situation | doctor reports | remedy | tried as |
|---|---|---|---|
"""
SUBJECT = "SERVICE"
"""Stands for the name of the service in the cells of rows that are compared."""


def page() -> str:
    """Return the page for users. Situations that differ by the service alone share a row."""
    rows: dict[tuple[str, ...], tuple[str, ...]] = {}
    alike: dict[tuple[str, ...], list[str]] = {}
    for each in SITUATIONS:
        cells = cells_of(each)
        key = tuple(without_subject(cell, each.subject) for cell in cells)
        rows.setdefault(key, cells)
        alike.setdefault(key, []).append(each.subject)

    lines: list[str] = []
    for key, cells in rows.items():
        others = alike[key][1:]
        name = cells[0]
        if others:
            name = f"{name}; likewise {', '.join(f'`{other}`' for other in others)}"
        escaped = [cell.replace("|", "\\|") for cell in (name, *cells[1:])]
        lines.append("| " + " | ".join(escaped) + " |")
    return HEAD + "\n".join(lines) + "\n"


def cells_of(situation: Situation) -> tuple[str, ...]:
    """Return the cells of a situation: its name, what doctor says, the remedy, and how it was tried."""
    finding = cause(situation.findings(), situation)
    who = f"{finding.service}: " if finding.service else ""
    sentence = finding.sentence.removeprefix("says: “").removesuffix("”")
    remedy = finding.remedy
    if not remedy:
        at = max(sentence.rfind(mark, 0, step_at(sentence, situation)) for mark in ("; ", ": "))
        sentence, remedy = (sentence[:at], sentence[at + 2 :]) if at > 0 else (sentence, "")
    (way, *_) = ended_faults(finding, situation.faults, situation.make()).values()
    return (situation.name, f"{finding.severity} `{finding.code}`: {who}{sentence}", remedy, way)


def without_subject(cell: str, subject: str) -> str:
    """Return `cell` with `SUBJECT` for a service such as `pointing.user1`, and for its kind `pointing`."""
    if not subject:
        return cell
    kind = subject.partition(".")[0]
    return cell.replace(subject, SUBJECT).replace(kind, SUBJECT)


def step_at(sentence: str, situation: Situation) -> int:
    """Return the index after the first letter of the words that ask for the step, or of its first command."""
    steps = (ACTS.get(situation.faults[0].kind, "`"), "--set", "`pointit")
    return 1 + min((at for each in steps if (at := sentence.find(each)) >= 0), default=len(sentence))


def cause(findings: Sequence[Finding], situation: Situation) -> Finding:
    """Return the finding of the situation, without those that one person claims beside it."""
    return next(
        each for each in findings if each.code == situation.code and each.service == situation.subject
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
