"""Page of broken situations. `python -m tests.unit.diagnosis.page` writes docs/reference/doctor.md."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from pointit.diagnosis.observation import Finding
from tests.unit.diagnosis.situations import SITUATIONS, Situation

PAGE = Path(__file__).parents[3] / "docs/reference/doctor.md"


def page() -> str:
    """Return the page for users."""
    lines = [
        "# Broken situations",
        "",
        "What `pointit doctor` says when a site is broken, and the step that mends it. Each row is a test on",
        "the reports of such a site: this cause is the only finding, and its commands can be typed. Where",
        "processes have ended or are stopped, the site is well once the printed command is carried out.",
        "`python -m tests.unit.diagnosis.page` writes this page. Names and numbers are examples.",
        "[Troubleshooting](../how-to/troubleshooting.md) has the meaning of each code.",
        "",
        "| situation | doctor says | remedy |",
        "|---|---|---|",
    ]
    for each in SITUATIONS:
        finding = cause(each.findings(), each)
        who = f"{finding.service}: " if finding.service else ""
        sentence, remedy = finding.sentence.removeprefix("says: “").removesuffix("”"), finding.remedy
        if not remedy:
            at = max(sentence.rfind(mark, 0, sentence.find(each.step) + 1) for mark in ("; ", ": "))
            sentence, remedy = (sentence[:at], sentence[at + 2 :]) if at > 0 else (sentence, "")
        cells = (each.name, f"{finding.severity} `{finding.code}`: {who}{sentence}", remedy)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def cause(findings: Sequence[Finding], situation: Situation) -> Finding:
    """Return the finding of the situation, without those that one person claims beside it."""
    return next(
        each for each in findings if each.code == situation.code and each.service == situation.subject
    )


def commands(text: str) -> Iterator[list[str]]:
    """Yield the words of each `pointit COMMAND …` in backquotes, without credentials, which would be read."""
    for part in text.split("`")[1::2]:
        program, *words = re.sub(r" --credentials \S+", "", part).split()
        if program == "pointit" and not words[0].startswith("-"):
            yield words


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
