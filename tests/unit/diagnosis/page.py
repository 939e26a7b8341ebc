"""Page of broken situations. `python -m tests.unit.diagnosis.page` writes docs/reference/doctor.md."""

from collections.abc import Sequence
from pathlib import Path

from pointit.diagnosis.observation import Finding
from tests.unit.diagnosis.remedies import ACTS, ended_faults
from tests.unit.diagnosis.situations import SITUATIONS, Situation

PAGE = Path(__file__).parents[3] / "docs/reference/doctor.md"
HEAD = """# Broken situations

What `pointit doctor` says when a site is broken, and the step that mends it. Each row is a test: a site that
is well gets the faults of its row, in the reports that its services would send, and doctor looks at them.

- *doctor says*: this is the only finding, beside what one person alone claims. Sentences of services about
  their devices are copies; the words that ask for a step are those of the product.
- *remedy*: nothing but the printed text is read, the fault that it ends is gone, and no finding is left.
- *tried as* `command`: `pointit` reads it as printed (without its credentials), or it is `kill -CONT` with
  the number. `option`: the service accepts the `--set`. `act`: it is done by hand, so its success is not
  tested, only that the words ask for it and name its object.

With real processes, tests kill, stop and cut off services, people and routers, do what is printed, and wait
until doctor says that all is well (`tests/e2e/run/test_doctor_faults.py`).
`python -m tests.unit.diagnosis.page` writes this page. Names and numbers are examples.
[Troubleshooting](../how-to/troubleshooting.md) has the meaning of each code.

| situation | doctor says | remedy | tried as |
|---|---|---|---|
"""


def page() -> str:
    """Return the page for users."""
    lines: list[str] = []
    for each in SITUATIONS:
        finding = cause(each.findings(), each)
        who = f"{finding.service}: " if finding.service else ""
        sentence = finding.sentence.removeprefix("says: “").removesuffix("”")
        remedy = finding.remedy
        if not remedy:
            at = max(sentence.rfind(mark, 0, step_at(sentence, each)) for mark in ("; ", ": "))
            sentence, remedy = (sentence[:at], sentence[at + 2 :]) if at > 0 else (sentence, "")
        (way, *_) = ended_faults(finding, each.faults, each.make()).values()
        cells = (each.name, f"{finding.severity} `{finding.code}`: {who}{sentence}", remedy, way)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return HEAD + "\n".join(lines) + "\n"


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
