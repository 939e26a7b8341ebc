"""Draws the life cycle, docs/explanation/life_cycle.md: `python docs/pictures/life_cycle.py`."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

from pointit.services.supervisor.transitions import TABLE, Condition, Event, Stage, Transition

W = TypeVar("W", bound=str)
FILE = Path(__file__).parents[1] / "explanation" / "life_cycle.md"
HEAD = """# Life cycle of an interaction

`python docs/pictures/life_cycle.py` makes this page from the table in
[`supervisor/transitions.py`](../../services/supervisor/transitions.py).
[`supervisor/life_cycle.py`](../../services/supervisor/life_cycle.py)
runs it for each person. An arrow shows its events, with conditions in brackets.
`before` is the stage that preceded the attempt. Cues, effects and the transitions that stay in a stage are in
the table.
"""

STAGES: Mapping[Stage, str] = {
    "idle": "the person rests",
    "pointing": "the person has a cursor",
    "localizing": "the person asked to be localized, and points at the targets",
    "anchoring": "the person points at one lamp, which corrects the pose",
    "joined": "another client asked to localize the person, who points at its targets",
}

EVENTS: Mapping[Event, str] = {
    "sample": "a timely sample of the wrist",
    "found": "the localizer has found or corrected the pose",
    "refused": "the localizer found no pose",
    "lost": "the localizer does something else",
    "rejected": "the localizer rejected the request",
    "recovered": "a localization that an earlier supervisor requested continues",
    "silent": "nothing was heard from the wrist for `imu_timeout_s`",
    "timeout": "no further target within `localization_timeout_s`",
}

CONDITIONS: Mapping[Condition, str] = {
    "must localize": "`localize`, and no pose is known or `relocalize_each_time`",
    "localizes": "`localize`",
    "press ends": "`press_while_pointing` is `ends`",
    "may start": "`autostart`, not forbidden, and no delay runs",
    "may resume": "pointing was interrupted within `resume_s`, and the pose is still known",
}


def page() -> str:
    """Return the document."""
    return "\n".join(
        [
            HEAD,
            "```mermaid",
            *diagram(),
            "```",
            "",
            *legend("stage", STAGES),
            *legend("event", EVENTS),
            *legend("condition", CONDITIONS),
        ]
    )


def diagram() -> Iterator[str]:
    """Yield the lines of a Mermaid state diagram. Attempts end in the choice `before`."""
    yield "stateDiagram-v2"
    yield "    state before <<choice>>"
    yield "    [*] --> idle"
    for stage, rows in TABLE.items():
        for then in dict.fromkeys(row.then for row in rows if row.then != stage):
            labels = "<br>".join(_label(row) for row in rows if row.then == then)
            yield f"    {stage} --> {then}: {labels}"
    for stage in ("idle", "pointing"):
        yield f"    before --> {stage}: was {stage}"


def _label(row: Transition) -> str:
    return _listed(row.events) + (f" [{_listed(row.conditions)}]" if row.conditions else "")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield the lines of a Markdown table."""
    columns = list(head)
    for cells in (columns, ["---"] * len(columns), *rows):
        yield f"| {' | '.join(cells)} |"


def legend(name: str, meanings: Mapping[W, str]) -> Iterator[str]:
    """Yield the lines of a table that explains words."""
    yield from (*table((name, "meaning"), meanings.items()), "")


def _listed(words: Iterable[str]) -> str:
    return ", ".join(words)


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
