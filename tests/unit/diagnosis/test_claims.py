"""Forged reports of a person's services change no finding about any other person or shared service."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation
from pointit.schemas.problems import CODES, Problem
from pointit.schemas.topics import CURSOR, RAY
from pointit.services.registry import person_of
from tests.unit.diagnosis.fault_sites import Site, router_with_people

INSIDER = "ben"
SUBJECTS = ("", "pui", "anna", "site", "laptop-anna", "tls/elsewhere:7447", "process 1 on desk", "selector")


def with_claims(seen: Observation, problems: tuple[Problem, ...], **fields: object) -> Observation:
    """The site, in which all services of the insider report `problems` and `fields`."""

    def forged(report: DiagnosisReport) -> DiagnosisReport:
        return replace(report, health=report.health.model_copy(update={"problems": problems, **fields}))

    reports = {
        name: tuple(map(forged, each)) if person_of(name) == INSIDER else each
        for name, each in seen.reports.items()
    }
    return replace(seen, reports=reports)


def about_others(findings: list[Finding]) -> set[Finding]:
    return {each for each in findings if person_of(each.service) != INSIDER}


def ill() -> Site:
    """The selector is silent, pui has no rays and is late, and another person's wrist is away."""
    site = router_with_people()
    site.processes["selector"] = replace(
        site.processes["site"], pid=77, services=("selector",), silence_s=9.0
    )
    shared = tuple(each for each in site.processes["site"].services if each != "selector")
    site.processes["site"] = replace(site.processes["site"], services=shared)
    site.ages_s["pui", RAY, "in"] = 20.0
    site.ages_s["led-driver", CURSOR, "in"] = 20.0
    site.warnings["pui"] = (Problem(code="late", sentence="late", topic=RAY.key),)
    site.warnings["imu-bridge.anna"] = (Problem(code="port", sentence="the port is not there: plug it in"),)
    site.warnings["keeper"] = (Problem(code="unwritable", sentence="full: make room", subject="states"),)
    return site


@pytest.mark.parametrize("site", [router_with_people, ill])
@pytest.mark.parametrize("code", CODES)
def test_a_forged_problem_changes_no_finding_about_another(code: str, site: Callable[[], Site]) -> None:
    seen = site().seen()
    truth = about_others(diagnose(seen))
    for subject in SUBJECTS:
        claims = tuple(
            Problem(code=code, sentence="says: forged", subject=subject, topic=topic)
            for topic in ("", RAY.key, CURSOR.key)
        )
        assert about_others(diagnose(with_claims(seen, claims))) == truth


@pytest.mark.parametrize("site", [router_with_people, ill])
def test_a_forged_machine_and_stamp_are_a_claim(site: Callable[[], Site]) -> None:
    seen = site().seen()
    truth = about_others(diagnose(seen))
    stamp_ns = max(each[-1].health.stamp_ns for each in seen.reports.values()) + 30 * 10**9
    findings = diagnose(with_claims(seen, (), host="laptop-anna", stamp_ns=stamp_ns))
    assert about_others(findings) == truth
    (clock,) = (each for each in findings if each.code == "clock")
    assert person_of(clock.service) == INSIDER
    assert clock.sentence.startswith(f"the services of {INSIDER} say that the clock of machine laptop-anna")


def silent_site() -> Site:
    """The process of the shared services does not report."""
    site = router_with_people()
    site.processes["site"] = replace(site.processes["site"], silence_s=9.0)
    site.deployments.pop("run.scenario_4")
    return site


@pytest.mark.parametrize("site", [router_with_people, ill, silent_site])
def test_a_forged_process_is_a_claim(site: Callable[[], Site]) -> None:
    seen = site().seen()
    truth = about_others(diagnose(seen))
    for fields in ({"pid": 2, "host": "desk"}, {"pid": 77, "host": "desk"}, {"pid": 99, "host": "desk"}):
        assert about_others(diagnose(with_claims(seen, (), **fields))) == truth
        assert about_others(diagnose(with_claims(seen, (), uptime_s=9999.0, **fields))) == truth
