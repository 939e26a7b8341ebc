"""The table of transitions: drawn as it is, and without rows that are never used."""

import runpy
from pathlib import Path

from pointit.services.supervisor.transitions import TABLE

DOCS = Path(__file__).parents[3] / "docs"


def test_the_document_shows_the_table() -> None:
    page = runpy.run_path(str(DOCS / "pictures/life_cycle.py"))["page"]
    is_same = (DOCS / "explanation/life_cycle.md").read_text(encoding="utf-8") == page()
    assert is_same, "run: python docs/pictures/life_cycle.py"


def test_no_row_hides_behind_one_whose_conditions_always_hold_with_it() -> None:
    for stage, rows in TABLE.items():
        for index, row in enumerate(rows):
            for event in row.events:
                before = [other for other in rows[:index] if event in other.events]
                assert not any(set(other.conditions) <= set(row.conditions) for other in before), (stage, row)


def test_every_attempt_can_be_left_by_the_person_and_ends_by_itself() -> None:
    for stage, rows in TABLE.items():
        leaving = {event for row in rows if row.then in ("idle", "before") for event in row.events}
        if stage not in ("idle", "pointing"):
            assert leaving >= {"press", "double", "hold", "silent", "timeout"}
