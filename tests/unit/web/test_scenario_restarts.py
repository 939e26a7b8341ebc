"""Scenarios that are replaced, restarted or ended: what the page calls missing."""

import pytest

from pointit.bridges.web.model.site_model import SETTLE_S, SiteModel
from pointit.bridges.web.wire import Status
from pointit.diagnosis.observation import LOADING_S
from pointit.schemas import Deployment
from pointit.schemas.topics import DEPLOYMENT, HEALTH
from tests.unit.web.test_site_model import codes, deployment, health

SERVICES = ("pui", "selector", "pointing.user1", "supervisor.user1", "keeper")


def run_of(scenario: str, *instances: str) -> Deployment:
    return deployment(*(instances or SERVICES), scenario=scenario)


class Restart:
    """A site whose scenario is replaced as `RunningScenario.switch_to` does it, slowly."""

    def __init__(self) -> None:
        self.site = SiteModel("web", 0.0)
        self.status: list[Status] = []
        self.take("run.scenario_4", run_of("scenario_4"), 0.0)
        for instance in SERVICES:
            self.site.set_service(instance, True, 0.0)
        self.tick(1.0)
        assert self.status[-1].run == "runs"

    def take(self, name: str, message: Deployment, now_s: float) -> None:
        self.site.take(DEPLOYMENT, name, message, round(now_s * 1e9), now_s)

    def tick(self, now_s: float, uptime_s: float = 0.0) -> Status:
        for instance in self.site.present:
            report = health(service=instance.partition(".")[0], instance=instance, uptime_s=uptime_s)
            self.site.take(HEALTH, instance, report, round(now_s * 1e9), now_s)
        self.status.append(self.site.status([], now_s, viewers=1, lan_url="", speed=1.0))
        return self.status[-1]

    def end(self, name: str, now_s: float) -> None:
        self.take(name, deployment(), now_s)
        for number, instance in enumerate(SERVICES):  # a busy machine
            self.site.set_service(instance, False, now_s + number)
            self.tick(now_s + number + 0.5)


@pytest.mark.parametrize("scenario", ["scenario_3", "scenario_4"])
def test_a_scenario_that_is_replaced_or_restarted_raises_no_alarm(scenario: str) -> None:
    restart = Restart()
    restart.end("run.scenario_4", 10.0)
    assert restart.status[-1].run == "over"
    restart.take(f"run.{scenario}", run_of(scenario), 16.0)
    for number, instance in enumerate(SERVICES):
        assert restart.tick(16.0 + 2 * number).run == "starts"
        restart.site.set_service(instance, True, 17.0 + 2 * number)
    assert restart.tick(16.0 + 2 * len(SERVICES)).run == "runs"
    assert [finding for status in restart.status for finding in status.findings] == []


def test_a_service_that_never_starts_or_leaves_soon_after_the_start_is_missing() -> None:
    restart = Restart()
    restart.end("run.scenario_4", 10.0)
    restart.take("run.scenario_3", run_of("scenario_3"), 16.0)
    for instance in SERVICES[1:]:
        restart.site.set_service(instance, True, 17.0)
    restart.site.set_service("selector", False, 18.0 + SETTLE_S)
    restart.tick(18.0 + SETTLE_S)
    late = restart.tick(18.0 + SETTLE_S + LOADING_S, LOADING_S)
    assert codes(late) == [("error", "pui"), ("error", "selector"), ("error", "user1")]
    assert [each.follows for each in late.findings] == [False, False, True], "no cursor, for want of pui"
    assert late.run == "runs"


def test_a_run_that_ended_on_purpose_is_over_without_an_alarm_and_one_that_died_is_missed() -> None:
    ended, died = Restart(), Restart()
    ended.end("run.scenario_4", 10.0)
    for now_s in (20.0, 100.0):
        status = ended.tick(now_s)
        assert (status.run, status.findings) == ("over", ())
    for instance in SERVICES:
        died.site.set_service(instance, False, 10.0)
    died.tick(10.0)
    assert (died.tick(13.0).run, len(died.tick(14.0).findings)) == ("runs", len(SERVICES) + 1)


def test_a_person_who_comes_after_the_run_has_ended_is_no_ended_run() -> None:
    restart = Restart()
    restart.end("run.scenario_4", 10.0)
    restart.take("anna", deployment("pointing.anna"), 20.0)
    assert restart.tick(20.0).run == "runs"


def test_a_person_who_ends_alone_ends_no_run() -> None:
    restart = Restart()
    restart.take("anna", deployment("pointing.anna"), 2.0)
    restart.take("anna", deployment(), 3.0)
    assert restart.tick(4.0).run == "runs"
