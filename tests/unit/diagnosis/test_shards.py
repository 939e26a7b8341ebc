"""Findings about shards and machines' clocks, and the writers of a topic."""

from collections.abc import Sequence

import pytest

from pointit.diagnosis.diagnose import diagnose, find_clock_skew, is_healthy
from pointit.diagnosis.observation import DiagnosisReport, Observation, silence_reason
from pointit.schemas import NS_PER_S, Deployment, ExpectedService, Health
from pointit.schemas.problems import Problem
from pointit.schemas.topics import CLOCK, CURSOR, IMU, MAP, POSE, RAY, SELECTION
from pointit.services.registry import present_writers
from tests.unit.diagnosis.test_diagnose import WELL, health, key, observation, only

ANNAS = health("pointing.anna", key(RAY, "out"))
BENS = health("pointing.ben", key(RAY, "out"))
"""People who point all the time."""


def test_a_default_instance_need_not_hear_people_whom_shards_serve() -> None:
    quiet = health("pui", key(RAY, "in", 9.0))
    shard = health("pui.anna", key(RAY, "in"))
    assert not diagnose(observation(ANNAS, quiet, shard))
    assert only(observation(ANNAS, quiet)).code == "stale"


@pytest.mark.parametrize("shard", ["pui.anna", "pui.hall"])
def test_a_default_instance_must_hear_people_whom_no_shard_serves(shard: str) -> None:
    deaf = health("pui", key(RAY, "in", 9.0))
    other = health(shard, key(RAY, "in"))
    shards = frozenset({"pui.anna", "selector.ben"})
    assert not diagnose(observation(ANNAS, deaf, other, shards=shards))
    finding = only(observation(ANNAS, BENS, deaf, other, shards=shards))
    assert (finding.code, finding.service) == ("stale", "pui")
    assert "pointing.ben" in finding.sentence
    assert "anna" not in finding.sentence


def test_default_selector_must_hear_cursors_of_people_without_a_shard() -> None:
    site = (
        health("pui", key(CURSOR, "out")),
        health("pui.anna", key(CURSOR, "out")),
        health("selector", key(CURSOR, "in", 9.0)),
        health("selector.hall", key(CURSOR, "in")),
    )
    finding = only(observation(*site, shards=frozenset({"pui.anna", "selector.anna"})))
    assert (finding.code, finding.service) == ("stale", "selector")
    assert not diagnose(observation(*site, shards=frozenset({"pui.anna", "selector.anna", "selector.ben"})))


def test_a_shard_called_after_a_person_must_hear_them() -> None:
    deaf = health("pui.anna", key(RAY, "in", 9.0))
    other = health("pui.hall", key(RAY, "in", 9.0))
    assert only(observation(ANNAS, BENS, deaf)).service == "pui.anna"
    assert not diagnose(observation(BENS, deaf, other))  # presence does not tell whom the other serves


def test_a_missing_shard_is_named_with_its_command() -> None:
    gone = ExpectedService(service="pui", name="anna", command=("python", "-m", "x"))
    told = {"anna": Deployment(stamp_ns=0, name="anna", services=(gone,))}
    finding = only(observation(WELL[2], deployments=told))
    assert (finding.code, finding.service) == ("absent", "pui.anna")
    assert "pointit service run pui --name anna --people [...]" in finding.remedy


NOW_NS = 1_700_000_000 * NS_PER_S


def reports(instance: str, host: str, ahead_s: float, *problems: Problem) -> Sequence[DiagnosisReport]:
    who = {"service": instance, "instance": instance, "pid": 1, "host": host, "problems": problems}

    def report(second: int) -> DiagnosisReport:
        now_ns = NOW_NS + second * NS_PER_S
        said = Health.model_validate({"stamp_ns": now_ns + int((ahead_s - 0.002) * 1e9), **who})
        return DiagnosisReport(received_s=100.0 + second, arrived_ns=now_ns, health=said)

    return list(map(report, range(3)))


def seen(**by_instance: Sequence[DiagnosisReport]) -> Observation:
    return Observation(
        began_s=100.0, now_s=102.5, host="desk", present=frozenset(by_instance), reports=by_instance
    )


@pytest.mark.parametrize(
    ("ahead_s", "severity", "words"),
    [
        (0.08, "warning", "78 ms ahead of the clock of desk"),
        (-0.08, "warning", "80 ms behind the clock of desk"),
        (1.5, "error", "refused"),
        (-1.5, "error", "refused"),
    ],
)
def test_a_clock_apart_is_found(ahead_s: float, severity: str, words: str) -> None:
    site = seen(
        pui=reports("pui", "server", 0.0), led=reports("led", "desk", 0.0), sim=reports("sim", "pi", ahead_s)
    )
    (finding,) = find_clock_skew(site)
    assert (finding.code, finding.severity, finding.service) == ("clock", severity, "")
    assert "machine pi " in finding.sentence
    assert words in finding.sentence
    assert "NTP" in finding.remedy
    assert [found for found in diagnose(site) if found.code == "clock"] == [finding]
    assert not is_healthy([finding])


def test_clock_that_the_keeper_reports_is_one_finding() -> None:
    warning = Problem(code="clock", sentence="the clock of machine pi is 80 ms behind", subject="pi")
    site = seen(keeper=reports("keeper", "server", 0.0, warning), sim=reports("sim", "pi", -0.08))
    assert not list(find_clock_skew(site))


PRESENT = {"pointing.anna", "pointing.ben", "pui", "user-sim.anna", "imu-bridge.ben"}


def test_a_persons_topic_is_written_by_their_own_services() -> None:
    assert present_writers(RAY, "anna", PRESENT) == ["pointing.anna"]
    assert present_writers(RAY, "*", PRESENT) == ["pointing.anna", "pointing.ben"]
    assert present_writers(IMU, "*", PRESENT) == ["imu-bridge.ben", "user-sim.anna"]
    assert present_writers(RAY, "eve", PRESENT) == []


def test_shards_write_for_people_but_not_for_the_site() -> None:
    present = {"pui.hall", "selector.anna"}
    assert present_writers(CURSOR, "anna", present) == ["pui.hall"]
    assert present_writers(MAP, "", present) == []
    assert present_writers(SELECTION, "", present) == []


def test_silence_is_explained() -> None:
    assert "pointing.anna can write it and runs" in silence_reason(RAY, "anna", PRESENT)
    assert "`pointit service run pointing --user eve`" in silence_reason(RAY, "eve", PRESENT)
    assert "`pointit service run pointing --user NAME`" in silence_reason(RAY, "*", ())
    assert "`pointit service run pui`" in silence_reason(MAP, "", ())
    assert "(localizer or mocap or ros2 or web or external)" in silence_reason(POSE, "anna", ())
    assert silence_reason(CLOCK, "", ()) == "it is written by cli or ros2"
