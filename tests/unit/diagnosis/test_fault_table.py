"""Each fault of each deployment is exactly one finding, with its cause and its remedy."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pointit.diagnosis.causes import unreachable
from pointit.diagnosis.diagnose import diagnose, filter_findings, is_healthy
from pointit.diagnosis.observation import Finding, StoppedProcess
from pointit.runtime.link.link import ROUTER_LOST
from pointit.schemas.problems import CLOCK, DENIED, LATE, REVOKED, TWICE, UNWRITABLE, Problem
from pointit.schemas.problems import ROUTER_LOST as LOST
from pointit.schemas.topics import CURSOR, HOVER, IMU, RAY, Topic
from tests.unit.diagnosis.fault_sites import (
    DEPLOYMENTS,
    SHARED,
    Process,
    Site,
    deployment,
    one_process,
    router_with_people,
    services_of,
)

AT = ("tcp/127.0.0.1:7447",)
FULL = "/state/{name} cannot be written (database or disk is full); later ones are lost: make room there"
MAY_NOT = (
    "this identity ({name}) may not write users/ben/ray: use credentials of ben, or have them added with "
    "`pointit site user add ben`"
)


def late(topic: Topic[Any]) -> Problem:
    sentence = f"40 messages on {topic.key} came later than others before them: check the link"
    return Problem(code=LATE, sentence=sentence, topic=topic.key)


def full(name: str) -> Problem:
    return Problem(code=UNWRITABLE, sentence=FULL.format(name=name), subject=name)


def denied(name: str) -> Problem:
    return Problem(code=DENIED, sentence=MAY_NOT.format(name=name), subject=name)


def other(sentence: str) -> Problem:
    return Problem(code="battery", sentence=sentence)


def change(site: Site, name: str, **fields: Any) -> Site:
    site.processes[name] = replace(site.processes[name], **fields)
    return site


def killed(kind: str, site: Site) -> Site:
    site.end({"--processes": "pui", "router": "site"}[kind], with_its_deployment=kind == "router")
    return site


def stopped(kind: str, site: Site) -> Site:
    site.stop({"--processes": "pui", "router": "site"}[kind])
    return site


def starved(kind: str, site: Site) -> Site:
    name = {"one process": "run", "--processes": "pui", "router": "site"}[kind]
    change(site, name, latency_s=0.4, period_s=1.3)
    site.warnings = {
        "pui": (late(RAY),),
        "selector": (late(CURSOR),),
        "led-driver": (late(CURSOR), late(HOVER)),
    }
    for reader, topic in (("selector", CURSOR), ("led-driver", HOVER)):
        site.ages_s[reader, topic, "in"] = 1.2
    return site


def disconnected(kind: str, site: Site) -> Site:
    if kind == "one process":  # the wrist
        for reader in ("pointing", "localizer", "supervisor"):
            site.ages_s[f"{reader}.user1", IMU, "in"] = 30.0
        site.ages_s["user-sim.user1", IMU, "out"] = site.ages_s["pointing.user1", RAY, "out"] = 30.0
        site.ages_s["localizer.user1", RAY, "in"] = 30.0
    elif kind == "--processes":  # everybody but the observer's own
        sentence = ROUTER_LOST.format(where=AT[0], ago_s=7.0)
        lost = (Problem(code=LOST, sentence=sentence, subject=AT[0]),)
        site.processes = {"web": Process(7, "desk", ("web",), ("pointit", "dashboard"), warnings=lost)}
    else:
        site.end("anna")
    return site


def duplicated(kind: str, site: Site) -> Site:
    name = site.process_of("pui")
    first = site.processes[name]
    second = ("pui",) if kind != "router" else first.services
    site.processes["second"] = replace(first, pid=99, services=second)
    for service in second:
        sentence = f"{service} runs twice: here and as process 99 on desk; end one of the two"
        site.warnings[service] = (Problem(code=TWICE, sentence=sentence, subject="process 99 on desk"),)
    site.warnings["selector"] = (*site.warnings.get("selector", ()), late(CURSOR))
    site.warnings["led-driver"] = (*site.warnings.get("led-driver", ()), late(CURSOR))
    return site


def has_wrong_rights(kind: str, site: Site) -> Site:
    if kind == "one process":
        site.processes.clear()
        site.deployments.clear()
        site.options["denied"] = (
            "this identity (anna) may do nothing here: it was revoked; copy the folder again"
        )
    elif kind == "--processes":
        for name in (*SHARED, *services_of("user1")):
            change(site, name, warnings=(denied("operator"),))
    else:
        change(site, "ben", warnings=(denied("cleo"),))
        sentence = "hall/cleo may not write users/ben/ray (200 times): refused"
        site.warnings["router"] = (Problem(code=DENIED, sentence=sentence, subject="cleo"),)
    return site


def has_wrong_clock(kind: str, site: Site) -> Site:
    if kind == "router":
        change(site, "anna", ahead_s=-3.0)  # what pui says of late rays does not say whose they are
        sentence = "9 IMU samples made no ray, the last is 3.0 s old: look for a slow link"
        site.warnings["pointing.anna"] = (Problem(code=LATE, sentence=sentence),)
    else:  # the observer's own machine is another than the site's
        site.options["host"] = "tablet"
        for name in site.processes:
            change(site, name, ahead_s=2.0)
    return site


def has_full_disk(kind: str, site: Site) -> Site:
    del kind
    for name in ("selector", "conveyor-sim"):
        site.warnings[name] = (full(f"{name}.sqlite"),)
    site.warnings["keeper"] = (full("states"),)
    return site


FAULTS: dict[str, tuple[Callable[[str, Site], Site], set[str], dict[str, str]]] = {
    "killed": (
        killed,
        {"absent", "no-cursor"},
        {"--processes": "pui", "router": "anna, ben and cleo have no cursor"},
    ),
    "stopped": (
        stopped,
        {"stopped"},
        {"--processes": "process 20 is stopped", "router": "process 2 is stopped"},
    ),
    "starved": (starved, {"starved"}, {"one process": "process 10 of machine desk"}),
    "disconnected": (disconnected, {"stale", "unreachable", "absent"}, {"router": "pointing.anna"}),
    "duplicated": (duplicated, {"twice"}, {}),
    "wrong rights": (has_wrong_rights, {"denied"}, {"router": "hall/cleo may not write"}),
    "wrong clock": (has_wrong_clock, {"clock"}, {"router": "machine laptop-anna"}),
    "full disk": (has_full_disk, {"disk"}, {}),
}
OUT_OF_REACH = ("killed", "stopped")
"""Faults of a single process that leave nothing to observe."""


def problems(findings: list[Finding]) -> list[Finding]:
    return [each for each in findings if not each.follows]


@pytest.mark.parametrize("kind", DEPLOYMENTS)
@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_one_finding_with_its_cause_and_remedy(fault: str, kind: str) -> None:
    make_faulty, codes, words = FAULTS[fault]
    if kind == "one process" and fault in OUT_OF_REACH:
        stopped_run = (StoppedProcess(10, ("pointit", "run")),) if fault == "stopped" else ()
        findings = [unreachable(AT, stopped_run, is_refused=fault == "killed", is_secured=False)]
        codes = {"unreachable", "stopped"}
    else:
        findings = diagnose(make_faulty(kind, DEPLOYMENTS[kind]()).seen())
    assert not is_healthy(findings)
    (finding,) = problems(findings)
    assert finding.code in codes
    assert words.get(kind, "") in f"{finding.service} {finding.sentence}"
    assert finding.remedy or ": " in finding.sentence or "; " in finding.sentence


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
    site = has_full_disk("router", router_with_people())
    site.end("anna")
    assert {each.code for each in problems(diagnose(site.seen()))} == {"disk", "absent"}
    independent = router_with_people()
    independent.end("anna")
    independent.warnings["imu-bridge.ben"] = (other("the battery of the wrist is at 5 %; charge it"),)
    independent.warnings["pointing.ben"] = (other("the battery of the wrist is at 5 %; charge it"),)
    assert len(problems(diagnose(independent.seen()))) == 2


def test_people_without_selector_are_an_error_unless_the_run_has_none() -> None:
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
