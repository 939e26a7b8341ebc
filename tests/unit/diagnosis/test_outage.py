"""When most services vanish together, one finding names the address; findings about one name only."""

from collections.abc import Sequence

from pointit.diagnosis.diagnose import diagnose, filter_findings, is_healthy
from pointit.diagnosis.observation import Finding, Observation
from pointit.runtime.link.link import ROUTER_LOST
from pointit.schemas import ExpectedService
from pointit.schemas.problems import ROUTER_LOST as LOST_CODE
from pointit.schemas.problems import Problem
from tests.unit.diagnosis.test_diagnose import deployment, health, observation

WHERE = "tcp/10.0.0.1:7447"
LOST = Problem(code=LOST_CODE, sentence=ROUTER_LOST.format(where=WHERE, ago_s=12.3), subject=WHERE)
SERVICES = ("pui", "selector", "led-driver", "conveyor-sim", "keeper")
EXPECTED = deployment(*(ExpectedService(service=name, command=("python",)) for name in SERVICES))


def told(findings: Sequence[Finding]) -> Finding:
    (finding,) = (each for each in findings if not each.follows)
    assert (finding.code, finding.service) == ("unreachable", "")
    return finding


def test_lost_router_is_one_finding_with_address_and_remedy() -> None:
    seen = observation(health("web", problems=(LOST,), status="degraded"), deployments=EXPECTED)
    findings = diagnose(seen)
    outage = told(findings)
    assert findings[0] is outage
    assert outage.severity == "error"
    assert outage.sentence == f"the router at {WHERE} does not answer: 5 of 6 services are out of reach"
    assert "`kill -CONT PID`" in outage.remedy
    assert "pointit service run" not in outage.remedy
    assert sorted(each.service for each in findings if each.follows) == sorted((*SERVICES, "web"))


def test_lost_router_leaves_services_of_the_own_process_reachable() -> None:
    here = [health(name, problems=(LOST,), status="degraded") for name in SERVICES]
    findings = diagnose(observation(*here, deployments=EXPECTED))
    outage = told(findings)
    assert (outage.severity, is_healthy(findings)) == ("warning", False)
    assert outage.sentence == f"the router at {WHERE} does not answer: nothing arrives from other machines"


def test_all_of_a_run_that_vanish_together_are_one_finding() -> None:
    findings = diagnose(observation(health("web"), deployments=EXPECTED))
    (finding,) = (each for each in findings if not each.follows)
    assert (finding.code, finding.severity, finding.service) == ("absent", "error", "")
    assert finding.sentence.startswith("conveyor-sim, keeper, led-driver and 2 more should run and do not: ")
    assert "start scenario_3 again where it ran, with `pointit run`" in finding.remedy
    assert sorted(each.service for each in findings if each.follows) == sorted(SERVICES)


def test_most_services_vanishing_together_are_one_finding() -> None:
    seen = observation(health("web"), health("pui"), deployments=EXPECTED)
    outage = told(diagnose(seen))
    assert outage.sentence.startswith("4 of 6 services are gone together: ")
    assert outage.severity == "error"


def test_a_few_that_are_absent_are_named_each() -> None:
    running = map(health, SERVICES[2:])
    findings = diagnose(observation(*running, deployments=EXPECTED))
    assert [(each.code, each.follows) for each in findings] == [("absent", False)] * 2


def test_outage_excludes_findings_that_are_not_sure() -> None:
    seen = observation(health("web"), deployments=EXPECTED)
    assert diagnose(seen, lambda finding: finding.code != "absent") == []


def test_outage_is_shown_when_one_service_is_asked_for() -> None:
    seen = observation(health("web"), deployments=EXPECTED)
    kept = filter_findings(diagnose(seen), seen, "pui")
    assert [(each.code, each.service) for each in kept] == [("absent", ""), ("absent", "pui")]


def found(service: str) -> Finding:
    return Finding(severity="error", code="silent", service=service, sentence="", remedy="")


def test_filter_keeps_only_findings_about_the_name() -> None:
    seen = Observation(began_s=0.0, now_s=1.0, present=frozenset({"pui", "pointing.anna", "pointing.ben"}))
    findings = [found(""), found("pui"), found("pointing.anna"), found("pointing.ben")]
    assert filter_findings(findings, seen, "pui") == [findings[1]]
    assert filter_findings(findings, seen, "anna") == [findings[2]]
    assert filter_findings(findings, seen, "pointing") == findings[2:]


def test_filter_finds_former_services_and_reports_unknown_names_as_absent() -> None:
    seen = Observation(began_s=0.0, now_s=1.0, left=frozenset({"pui"}))
    assert filter_findings([found("pui")], seen, "pui") == [found("pui")]
    (finding,) = filter_findings([found("pui")], seen, "selector")
    assert (finding.code, finding.service, finding.severity) == ("absent", "selector", "error")
