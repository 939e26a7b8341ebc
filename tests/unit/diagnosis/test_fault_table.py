"""Sites that are well, and faults that several services report, or that come together."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pointit.diagnosis.diagnose import diagnose, filter_findings
from pointit.diagnosis.observation import Finding
from pointit.schemas.problems import CLOCK, DENIED, LATE, REVOKED, UNWRITABLE, Problem
from pointit.schemas.topics import CURSOR, HOVER, IMU, RAY, Topic
from tests.unit.diagnosis.fault_sites import (
    DEPLOYMENTS,
    SHARED,
    Site,
    deployment,
    one_process,
    processes,
    router_with_people,
    services_of,
)


def change(site: Site, name: str, **fields: Any) -> Site:
    site.processes[name] = replace(site.processes[name], **fields)
    return site


def late(topic: Topic[Any]) -> Problem:
    sentence = f"40 messages on {topic.key} arrived after newer ones: check the link"
    return Problem(code=LATE, sentence=sentence, topic=topic.key)


def is_starved(site: Site) -> None:
    change(site, site.process_of("pui"), latency_s=0.4, period_s=1.3)
    site.warnings = {
        "pui": (late(RAY),),
        "selector": (late(CURSOR),),
        "led-driver": (late(CURSOR), late(HOVER)),
    }
    for reader, topic in (("selector", CURSOR), ("led-driver", HOVER)):
        site.ages_s[reader, topic, "in"] = 1.2


def has_wrong_rights(site: Site) -> None:
    sentence = "this identity (operator) may not write users/ben/ray: use credentials of ben"
    for name in (*SHARED, *services_of("user1")):
        change(site, name, warnings=(Problem(code=DENIED, sentence=sentence, subject="operator"),))


def problems(findings: list[Finding]) -> list[Finding]:
    return [each for each in findings if not each.follows]


@pytest.mark.parametrize(
    ("break_it", "make", "code", "words"),
    [
        (is_starved, one_process, "starved", "process 10 of machine desk"),
        (is_starved, router_with_people, "starved", "process 2 of machine desk"),
        (has_wrong_rights, processes, "denied", "may not write users/ben/ray"),
    ],
)
def test_fault_that_several_services_report_is_one_finding(
    break_it: Callable[[Site], None], make: Callable[[], Site], code: str, words: str
) -> None:
    break_it(site := make())
    (finding,) = problems(diagnose(site.seen()))
    assert (finding.code, words in finding.sentence) == (code, True), finding


@pytest.mark.parametrize("kind", DEPLOYMENTS)
def test_a_site_that_is_well_has_no_finding(kind: str) -> None:
    assert diagnose(DEPLOYMENTS[kind]().seen()) == []


def is_idle(site: Site) -> Site:
    """Nobody points."""
    for service, topic in (("pui", CURSOR), ("selector", HOVER)):
        site.ages_s[service, topic, "out"] = 300.0
    for service, topic in (("selector", CURSOR), ("led-driver", CURSOR), ("led-driver", HOVER)):
        site.ages_s[service, topic, "in"] = 300.0
    return site


def is_busy(site: Site) -> Site:
    """A machine that makes pauses of half a second."""
    for process in site.processes.values():
        process.latency_s = 0.09
        for service in process.services:
            site.ages_s |= {(service, topic, "in"): 0.6 for topic in (IMU, RAY, CURSOR, HOVER)}
    return site


def is_starting(site: Site) -> Site:
    for name in sorted(site.processes)[::2]:
        if name not in ("router", "run"):
            del site.processes[name]
    for process in site.processes.values():
        process.uptime_s = 1.0
    site.deployments = {
        name: each.model_copy(update={"stamp_ns": each.stamp_ns + 598 * 10**9})
        for name, each in site.deployments.items()
    }
    return site


def has_just_restarted(site: Site) -> Site:
    for name in site.processes:
        change(site, name, pid=500 + site.processes[name].pid, uptime_s=1.5)
    return site


@pytest.mark.parametrize("kind", DEPLOYMENTS)
@pytest.mark.parametrize("state", [is_idle, is_busy, is_starting, has_just_restarted])
def test_healthy_states_have_no_finding(state: Callable[[Site], Site], kind: str) -> None:
    assert diagnose(state(DEPLOYMENTS[kind]()).seen()) == []


def test_a_person_whose_process_has_ended_is_one_command() -> None:
    site = router_with_people()
    site.end("anna")
    (finding,) = problems(diagnose(site.seen()))
    assert (finding.code, finding.severity, finding.service) == ("absent", "error", "anna")
    assert "`pointit person add anna --credentials hall/identities/anna`" in finding.remedy
    kept = filter_findings(diagnose(site.seen()), site.seen(), "anna")
    assert finding in kept
    assert not problems(filter_findings(diagnose(site.seen()), site.seen(), "ben"))


def test_a_revoked_identity_and_a_wrong_clock_hide_no_denial() -> None:
    site = router_with_people()
    denials = {
        "a denial of anna": Problem(code=DENIED, sentence="a denial of anna", subject="anna"),
        "a denial of ben": Problem(code=DENIED, sentence="a denial of ben", subject="ben"),
        "anna was revoked": Problem(code=REVOKED, sentence="anna was revoked", subject="anna"),
        "a wrong clock": Problem(code=CLOCK, sentence="a wrong clock", subject="desk"),
    }
    site.warnings["router"] = tuple(denials.values())
    found = [each for each in problems(diagnose(site.seen())) if not each.follows]
    assert {each.sentence for each in found} == denials.keys()


def test_two_faults_are_two_findings() -> None:
    site = router_with_people()
    site.end("anna")
    site.warnings["selector"] = (Problem(code=UNWRITABLE, sentence="full: make room", subject="journal"),)
    assert {each.code for each in problems(diagnose(site.seen()))} == {"disk", "absent"}
    independent = router_with_people()
    independent.end("anna")
    battery = Problem(code="battery", sentence="the battery of the wrist is at 5 %; charge it")
    independent.warnings = {"imu-bridge.ben": (battery,), "pointing.ben": (battery,)}
    assert len(problems(diagnose(independent.seen()))) == 2


def test_people_without_selector_are_an_error_unless_none_is_deployed() -> None:
    site = router_with_people("anna")
    site.processes["site"] = replace(site.processes["site"], services=("pui", "led-driver"))
    site.deployments.pop("run.scenario_4")
    (finding,) = problems(diagnose(site.seen()))
    assert (finding.code, finding.severity, finding.service) == ("no-cursor", "error", "anna")
    assert finding.sentence == "anna has no selections: selector does not run on this site"
    site.deployments["run.scenario_1"] = deployment("scenario_1", [site.processes["site"]])
    assert diagnose(site.seen()) == []


def test_messages_that_were_invalid_are_one_note() -> None:
    site = one_process()
    seen = site.seen()
    for reader in ("pointing.user1", "localizer.user1", "supervisor.user1"):
        (key, *others) = seen.reports[reader][-1].health.keys
        keys = (key.model_copy(update={"invalid": 5}), *others)
        told = [
            replace(each, health=each.health.model_copy(update={"keys": keys}))
            for each in seen.reports[reader]
        ]
        seen = replace(seen, reports={**seen.reports, reader: told})
    (finding,) = problems(diagnose(seen))
    assert (finding.code, finding.severity) == ("failed", "note")
