"""Findings about one service or person only."""

from pointit.diagnosis.diagnose import diagnose, filter_findings, is_about
from pointit.diagnosis.observation import Finding, Observation


def found(service: str) -> Finding:
    return Finding(severity="error", code="silent", service=service, sentence="", remedy="")


def test_a_name_is_that_of_an_instance_a_service_or_a_person() -> None:
    assert is_about("pointing.anna", "pointing.anna")
    assert is_about("pointing.anna", "pointing")
    assert is_about("pointing.anna", "anna")
    assert is_about("pui", "pui")
    assert not is_about("pointing.anna", "ben")
    assert not is_about("", "pui")


def test_who_may_not_look_on_is_told_that_and_not_that_nothing_runs() -> None:
    seen = Observation(began_s=0.0, now_s=1.0, denied="this identity (anna) may do nothing here")
    (finding,) = filter_findings(diagnose(seen), seen, "pui")
    assert (finding.code, finding.sentence) == ("denied", seen.denied)


def test_only_what_is_about_the_name_is_left() -> None:
    seen = Observation(began_s=0.0, now_s=1.0, present=frozenset({"pui", "pointing.anna", "pointing.ben"}))
    findings = [found(""), found("pui"), found("pointing.anna"), found("pointing.ben")]
    assert filter_findings(findings, seen, "pui") == [findings[1]]
    assert filter_findings(findings, seen, "anna") == [findings[2]]
    assert filter_findings(findings, seen, "pointing") == findings[2:]


def test_what_was_there_is_told_of_and_what_never_was_is_absent() -> None:
    seen = Observation(began_s=0.0, now_s=1.0, left=frozenset({"pui"}))
    assert filter_findings([found("pui")], seen, "pui") == [found("pui")]
    (finding,) = filter_findings([found("pui")], seen, "selector")
    assert (finding.code, finding.service, finding.severity) == ("absent", "selector", "error")
