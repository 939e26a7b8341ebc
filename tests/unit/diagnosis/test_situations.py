"""Each broken situation of the table is one finding, whose printed remedy mends it; the page is current."""

import pytest

from pointit.diagnosis.diagnose import diagnose, is_healthy
from pointit.services.registry import person_of
from tests.unit.diagnosis.page import PAGE, cause, page
from tests.unit.diagnosis.remedies import check_sentence, ended_faults, text_of
from tests.unit.diagnosis.situations import SITUATIONS, Situation

rows = pytest.mark.parametrize("row", SITUATIONS, ids=lambda row: row.name)


def test_the_table_has_at_least_forty_rows_of_different_names() -> None:
    assert len({each.name for each in SITUATIONS}) == len(SITUATIONS) >= 40


@rows
def test_the_cause_is_the_only_finding(row: Situation) -> None:
    findings = row.findings()
    finding = cause(findings, row)
    others = [each for each in findings if each is not finding]
    assert len(others) == row.claims
    assert all(person_of(each.service) for each in others), "only a person's claims stand beside it"
    assert row.words in finding.sentence
    assert is_healthy(findings) == (finding.severity == "note")
    check_sentence(text_of(finding))


@rows
def test_the_printed_remedy_mends_the_site_and_nothing_else_does(row: Situation) -> None:
    assert diagnose(row.make().seen()) == []
    finding = cause(row.findings(), row)
    ended = ended_faults(finding, row.faults, row.make())
    assert ended, text_of(finding)
    left = row.findings(ended)
    assert len(left) == row.claims
    assert {person_of(each.service) for each in left} <= {each.of for each in row.faults}, "a lie remains"
    others = [each for other in SITUATIONS for each in other.faults if each.kind != row.faults[0].kind]
    mended = ended_faults(finding, others, row.make())
    assert {each.kind for each in mended} <= {"ended", "stopped"}, "whose process may do either"


def test_the_page_is_current() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m tests.unit.diagnosis.page"
