"""Draws the life cycle, docs/explanation/life_cycle.md: `python docs/pictures/life_cycle.py`."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from pointit.services.supervisor.transitions import CONDITIONS, EFFECTS, EVENTS, STAGES, TABLE, Transition

FILE = Path(__file__).parents[1] / "explanation" / "life_cycle.md"
HEAD = """# Life cycle of an interaction

`python docs/pictures/life_cycle.py` makes this page from the table in
[`supervisor/transitions.py`](../../services/pointit/services/supervisor/transitions.py).
[`supervisor/life_cycle.py`](../../services/pointit/services/supervisor/life_cycle.py)
runs it for each person. An arrow shows its events, with conditions in brackets.
`before` is the stage that preceded the attempt.
"""


def page() -> str:
    """Return the document."""
    return "\n".join(
        [
            HEAD,
            "```mermaid",
            *diagram(),
            "```",
            "",
            *table(
                ("stage", "event", "if", "next stage", "cue", "effects"),
                (
                    (
                        stage,
                        _listed(row.events),
                        _listed(row.conditions),
                        row.then,
                        row.cue,
                        _listed(row.effects),
                    )
                    for stage, rows in TABLE.items()
                    for row in rows
                ),
            ),
            "",
            *legend("stage", STAGES.items()),
            *legend("event", EVENTS.items()),
            *legend("condition", CONDITIONS.items()),
            *legend("effect", EFFECTS.items()),
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


def legend(name: str, meanings: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield the lines of a table that explains words."""
    yield from (*table((name, "meaning"), meanings), "")


def _listed(words: Iterable[str]) -> str:
    return ", ".join(words)


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
