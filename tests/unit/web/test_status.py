"""Status of the site for the page."""

import pytest

from pointit.bridges.web.model.status import GRACE_S, KEPT_S, LEFT_S, SiteObservation
from pointit.bridges.web.wire import PersonLine, Status
from pointit.runtime.link.outage import SILENT_S
from pointit.schemas import Deployment, Health, KeyHealth
from pointit.schemas.system import ExpectedService

DEPLOYED = {
    "run.s": Deployment(
        stamp_ns=0,
        name="s",
        services=(ExpectedService(service="pui", command=("pointit", "service", "pui")),),
    )
}


def health(**fields: object) -> Health:
    known: dict[str, object] = {"stamp_ns": 0, "service": "pui", "instance": "pui", "pid": 1}
    return Health.model_validate({**known, **fields})


def told(sight: SiteObservation, now_s: float, deployments: dict[str, Deployment] | None = None) -> Status:
    return sight.status(deployments or {}, [], now_s)


def codes(status: Status) -> list[tuple[str, str]]:
    return [(finding.severity, finding.service) for finding in status.findings]


@pytest.fixture
def sight() -> SiteObservation:
    sight = SiteObservation(0.0)
    sight.set_present("web", True, 0.0)
    sight.report("web", health(service="web", instance="web"), 0.0)
    return sight


def heard(sight: SiteObservation, instance: str, now_s: float, **fields: object) -> None:
    sight.report(instance, health(service=instance.partition(".")[0], instance=instance, **fields), now_s)


def test_services_come_and_go_with_since_when(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 1.0)
    lines = {line.instance: line for line in told(sight, 3.0).services}
    assert lines["pui"].present
    assert lines["pui"].since_s == 2.0
    sight.set_present("pui", False, 5.0)
    lines = {line.instance: line for line in told(sight, 6.5).services}
    assert not lines["pui"].present
    assert lines["pui"].since_s == 1.5


def test_who_has_left_long_ago_and_is_not_expected_is_forgotten(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 1.0)
    sight.set_present("pui", False, 2.0)
    told(sight, 2.0 + LEFT_S + 1.0)
    heard(sight, "web", 2.0 + LEFT_S + 1.9)
    status = told(sight, 2.0 + LEFT_S + 2.0)
    assert [line.instance for line in status.services] == ["web"]
    assert status.findings == ()


def test_who_left_with_the_scenario_before_is_not_missed(sight: SiteObservation) -> None:
    def missed(now_s: float) -> list[str]:
        heard(sight, "web", now_s)
        status = told(sight, now_s)
        assert {line.instance for line in status.services} >= {name for _, name in codes(status)}
        return [name for _, name in codes(status)]

    for instance in ("selector", "pui"):
        sight.set_present(instance, True, 9.0)
        sight.set_present(instance, False, 10.0)
    assert missed(10.1) == ["pui", "selector"]
    sight.reset(10.2)
    assert missed(10.3) == []
    for began_s, left_s in ((10.4, 11.0), (13.0, 14.0)):  # one that was late, and one of the new scenario
        sight.set_present("led-driver", True, began_s)
        sight.set_present("led-driver", False, left_s)
        assert missed(left_s + 0.1) == ([] if left_s == 11.0 else ["led-driver"])


def test_who_is_expected_is_missed_for_ever(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 1.0)
    sight.set_present("pui", False, 2.0)
    for now_s in (2.0 + LEFT_S + 1.0, 2.0 + 10 * LEFT_S):
        heard(sight, "web", now_s)
        status = told(sight, now_s, DEPLOYED)
        (line,) = [line for line in status.services if line.instance == "pui"]
        assert line.since_s == now_s - 2.0
        assert codes(status) == [("error", "pui")]
        assert "pointit service run pui" in status.findings[0].remedy


def test_who_may_be_starting_is_not_missed_yet(sight: SiteObservation) -> None:
    assert told(sight, 1.0, DEPLOYED).findings == ()
    heard(sight, "web", 1.0 + GRACE_S)
    assert codes(told(sight, 1.0 + GRACE_S, DEPLOYED)) == [("error", "pui")]


def test_who_has_just_come_is_not_silent(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 100.0)
    heard(sight, "web", 100.0)
    assert told(sight, 100.0 + SILENT_S).findings == ()
    heard(sight, "web", 101.0 + SILENT_S)
    status = told(sight, 101.0 + SILENT_S)
    assert codes(status) == [("error", "pui")]


def test_what_grows_is_an_error_and_what_grew_long_ago_is_a_note(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 0.0)

    def invalid(count: int) -> tuple[KeyHealth, ...]:
        return (KeyHealth(key="map", direction="in", rate_hz=0.0, invalid=count),)

    heard(sight, "pui", 1.0, keys=invalid(0))
    heard(sight, "pui", 2.0, keys=invalid(3))
    heard(sight, "web", 2.0)
    assert codes(told(sight, 2.0)) == [("error", "pui")]
    for second in range(3, 4 + int(KEPT_S)):
        heard(sight, "pui", float(second), keys=invalid(3))
        heard(sight, "web", float(second))
    assert codes(told(sight, 3.0 + KEPT_S)) == [("note", "pui")]


def test_a_service_that_was_started_again_does_not_run_twice(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 50.0)
    heard(sight, "pui", 50.0, pid=1, uptime_s=49.0)
    sight.set_present("pui", False, 51.0)
    sight.set_present("pui", True, 52.0)
    heard(sight, "pui", 53.0, pid=2, uptime_s=1.0)
    heard(sight, "web", 53.0)
    assert told(sight, 53.0).findings == ()


def test_two_that_have_one_name_are_found(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 0.0)
    for second in range(40, 50):
        heard(sight, "pui", float(second), pid=1, uptime_s=45.0)
        heard(sight, "pui", second + 0.5, pid=2, uptime_s=30.0)
        heard(sight, "web", float(second))
    assert codes(told(sight, 50.0)) == [("error", "pui")]


def test_warnings_come_with_remedies(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 0.0)
    heard(sight, "pui", 1.0, status="degraded", warnings=("it is dark",))
    heard(sight, "web", 1.0)
    (finding,) = told(sight, 1.0).findings
    assert finding.sentence == "it is dark"
    assert finding.remedy


def test_reports_of_who_is_not_there_are_not_kept(sight: SiteObservation) -> None:
    for number in range(100):
        heard(sight, f"ghost{number}", 1.0)
    assert sight._reports.keys() == {"web"}


def test_the_rest_is_told_as_it_is(sight: SiteObservation) -> None:
    people = [PersonLine(user="anna", moved_by="mouse", is_mine=True)]
    status = sight.status({}, people, 0.0, viewers=3, lan_url="https://10.0.0.7:8443", speed=2.0)
    assert status.people == tuple(people)
    assert status.viewers == 3
    assert status.lan_url == "https://10.0.0.7:8443"
