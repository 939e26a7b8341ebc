"""A page's knowledge of its site, and scenarios that begin again."""

import pytest

from pointit.bridges.web.model import site_model as module
from pointit.bridges.web.model.site_model import (
    GRACE_S,
    LEFT_S,
    MISSED_S,
    SETTLE_S,
    WINDOW_S,
    Deployments,
    SiteModel,
    SiteObservation,
)
from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.wire import Mover, PersonLine, Status
from pointit.diagnosis.observation import LOADING_S
from pointit.runtime.link.link import SILENT_S
from pointit.schemas import (
    Deployment,
    Environment,
    ExpectedService,
    Health,
    KeyHealth,
    Lamp,
    LampColor,
    SelectionEvent,
    UserPose,
)
from pointit.schemas.environment import Thing
from pointit.schemas.system import OWN_SOURCE, RUN, Figure
from pointit.schemas.topics import DEPLOYMENT, HEALTH, LAMP_COLOR, MAP, POSE, SELECTION_EVENTS

DEPLOYED_PUI = ExpectedService(service="pui", command=("pointit", "service", "run", "pui"))
DEPLOYED = {"run.s": Deployment(stamp_ns=0, name="s", services=(DEPLOYED_PUI,))}


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


def test_services_are_listed_with_the_time_of_their_change(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 1.0)
    lines = {line.instance: line for line in told(sight, 3.0).services}
    assert lines["pui"].present
    assert lines["pui"].since_s == 2.0
    sight.set_present("pui", False, 5.0)
    lines = {line.instance: line for line in told(sight, 6.5).services}
    assert not lines["pui"].present
    assert lines["pui"].since_s == 1.5


def test_unexpected_service_is_forgotten_long_after_it_left(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 1.0)
    sight.set_present("pui", False, 2.0)
    told(sight, 2.0 + LEFT_S + 1.0)
    heard(sight, "web", 2.0 + LEFT_S + 1.9)
    status = told(sight, 2.0 + LEFT_S + 2.0)
    assert [line.instance for line in status.services] == ["web"]
    assert status.findings == ()


def test_service_of_the_previous_scenario_is_not_missing(sight: SiteObservation) -> None:
    def missed(now_s: float) -> list[str]:
        heard(sight, "web", now_s)
        status = told(sight, now_s)
        assert {line.instance for line in status.services} >= {name for _, name in codes(status)}
        return [name for _, name in codes(status)]

    for instance in ("selector", "pui"):
        sight.set_present(instance, True, 9.0)
        sight.set_present(instance, False, 10.0)
    assert missed(10.1) == ["pui", "selector"]
    sight.begin_run(10.2)
    assert missed(10.3) == []
    for began_s, left_s in ((10.4, 11.0), (13.0, 14.0)):  # one that was late, and one of the new scenario
        sight.set_present("led-driver", True, began_s)
        sight.set_present("led-driver", False, left_s)
        assert missed(left_s + 0.1) == ([] if left_s == 11.0 else ["led-driver"])


def test_expected_service_stays_missing(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 1.0)
    sight.set_present("pui", False, 2.0)
    for now_s in (2.0 + LEFT_S + 1.0, 2.0 + 10 * LEFT_S):
        heard(sight, "web", now_s)
        status = told(sight, now_s, DEPLOYED)
        (line,) = [line for line in status.services if line.instance == "pui"]
        assert line.since_s == now_s - 2.0
        assert codes(status) == [("error", "pui")]
        assert "pointit service run pui" in status.findings[0].remedy


def test_starting_service_is_not_missing_yet(sight: SiteObservation) -> None:
    assert told(sight, 1.0, DEPLOYED).findings == ()
    heard(sight, "web", 1.0 + GRACE_S)
    assert codes(told(sight, 1.0 + GRACE_S, DEPLOYED)) == [("error", "pui")]


def test_new_service_is_not_silent(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 100.0)
    heard(sight, "web", 100.0)
    assert told(sight, 100.0 + SILENT_S).findings == ()
    heard(sight, "web", 101.0 + SILENT_S)
    status = told(sight, 101.0 + SILENT_S)
    assert codes(status) == [("error", "pui")]


def test_growing_counter_is_an_error_and_an_old_one_noted(sight: SiteObservation) -> None:
    sight.set_present("pui", True, 0.0)

    def invalid(count: int) -> tuple[KeyHealth, ...]:
        return (KeyHealth(key="map", direction="in", rate_hz=0.0, invalid=count),)

    heard(sight, "pui", 1.0, keys=invalid(0))
    heard(sight, "pui", 2.0, keys=invalid(3))
    heard(sight, "web", 2.0)
    assert codes(told(sight, 2.0)) == [("error", "pui")]
    for second in range(3, 4 + int(WINDOW_S)):
        heard(sight, "pui", float(second), keys=invalid(3))
        heard(sight, "web", float(second))
    assert codes(told(sight, 3.0 + WINDOW_S)) == [("note", "pui")]


def test_report_of_an_absent_service_is_not_stored(sight: SiteObservation) -> None:
    for number in range(100):
        heard(sight, f"ghost{number}", 1.0)
    assert sight._reports.keys() == {"web"}


def deployment(*instances: str, scenario: str = "") -> Deployment:
    services = tuple(
        ExpectedService(service=service, user=user)
        for service, _, user in (instance.partition(".") for instance in instances)
    )
    return Deployment(stamp_ns=0, name="x", services=services, scenario=scenario)


def test_vanished_deployment_is_missing_for_a_day() -> None:
    deployments = Deployments("web")
    assert deployments.put("anna", deployment("pointing.anna", "supervisor.anna"), 0.0) == []
    assert deployments.over({"pui", "supervisor.anna"}, 100.0) == []
    assert deployments.over({"pui"}, 99.0 + MISSED_S) == []
    assert set(deployments.known) == {"anna"}
    assert deployments.over({"pui"}, 100.0 + MISSED_S) == [(DEPLOYMENT, "anna")]
    deployments.drop("anna")
    assert deployments.over(set(), 101.0 + MISSED_S) == []


def test_deployment_is_over_at_once_when_ended_on_purpose() -> None:
    model = SiteModel("web", 0.0)
    model.take(DEPLOYMENT, "anna", deployment("pointing.anna"), 1, 0.0)
    assert model.cache.names(DEPLOYMENT) == ["anna"]
    model.take(DEPLOYMENT, "anna", deployment(), 2, 1.0)
    model.take(DEPLOYMENT, "ben", deployment(), 2, 1.0)
    assert model.cache.names(DEPLOYMENT) == []


def test_deployment_is_over_when_only_the_page_is_left() -> None:
    deployments = Deployments("web")
    deployments.put("scenario_4", deployment("pui", "web"), 0.0)
    assert deployments.over({"web"}, MISSED_S) == [(DEPLOYMENT, "scenario_4")]


def test_scenario_replaces_another_but_no_part_of_a_person() -> None:
    deployments = Deployments("web")
    deployments.put("scenario_3", deployment("pui", scenario="scenario_3"), 0.0)
    deployments.put("anna", deployment("pointing.anna"), 0.0)
    replaced = deployments.put("scenario_4", deployment("pui", scenario="scenario_4"), 0.0)
    assert replaced == [(DEPLOYMENT, "scenario_3")]
    deployments.drop("scenario_3")
    assert set(deployments.known) == {"anna", "scenario_4"}
    assert deployments.put("scenario_4", deployment("pui", scenario="scenario_4"), 0.0) == []


def test_another_scenario_differs_from_the_same_started_again() -> None:
    def scenario(name: str) -> Deployment:
        return deployment("pui", scenario=name)

    deployments = Deployments("web")
    assert not deployments.is_another(scenario("scenario_4"))
    deployments.put("run", scenario("scenario_4"), 0.0)
    assert not deployments.is_another(scenario("scenario_4"))
    assert not deployments.is_another(scenario(""))  # one person's part
    assert deployments.is_another(scenario("scenario_1"))
    deployments.drop("run")
    assert deployments.is_another(scenario("scenario_1")), "it ended before the other began"


PUI = ExpectedService(service="pui")


def test_memory_is_bounded_when_names_never_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LatestValueCache", lambda: LatestValueCache(max_keys=10))
    recent = Recent("lab")
    belief = SiteModel("web", 0.0, recent)
    pose = UserPose(stamp_ns=1, yaw_rad=0.0, position_m=(0.0, 0.0, 0.0))
    taken = [belief.take(POSE, f"user{n}", pose, n, n / 1e9) for n in range(100)]
    assert taken == [True] * 10 + [False] * 90
    assert len(recent.past(100).states_at(100)) == 10


def test_lamps_outside_the_map_are_not_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LatestValueCache", lambda: LatestValueCache(max_keys=3))
    belief = SiteModel("web", 0.0)
    room = Environment(stamp_ns=1, name="lab", lamps=(Lamp(id="real", position_m=(0.0, 0.0, 1.0)),))
    lamp = LampColor(stamp_ns=1, color=(1, 2, 3))
    assert belief.take(MAP, "", room, 1, 0.0)
    for number in range(10):
        assert belief.take(LAMP_COLOR, f"x{number}", lamp, 1, 0.0)
    assert belief.take(LAMP_COLOR, "real", lamp, 1, 0.0)
    assert belief.take(POSE, "anna", UserPose(stamp_ns=1, yaw_rad=0.0, position_m=(0.0, 0.0, 0.0)), 1, 0.0)
    assert belief.cache.names(LAMP_COLOR) == ["real"]


def test_home_things_without_a_bridge_are_a_finding() -> None:
    model = SiteModel("web", 0.0)
    for instance in ("web", "pui"):
        model.set_service(instance, True, 0.0)

    def findings(*actions: str) -> list[str]:
        things = tuple(
            Thing(id=f"lamp_{number}", center_m=(0, 0, 1), size_m=(1, 1, 1), home_assistant=action)
            for number, action in enumerate(actions)
        )
        model.take(MAP, "", Environment(stamp_ns=1, name="home", things=things), 1, 0.0)
        status = model.status([], now_s, viewers=0, lan_url="", speed=1.0)
        return [finding.sentence for finding in status.findings if "Home Assistant" in finding.sentence]

    now_s = GRACE_S / 2
    assert findings("light.desk") == [], "its service may not be known yet"
    now_s = GRACE_S + 1.0
    assert findings("light.desk", "") == [
        "Home Assistant is not connected: pointing at lamp_0 switches nothing there"
    ]
    assert findings("", "") == []
    model.set_service("pui", False, now_s)
    assert findings("light.desk") == [], "the run is over, and the map is that of before"


def test_history_begins_with_the_run() -> None:
    belief = SiteModel("web", 0.0)

    def happens(stamp_ns: int) -> None:
        event = SelectionEvent(stamp_ns=stamp_ns, event="selected", object_id="red-1")
        belief.take(SELECTION_EVENTS, "", event, stamp_ns, 0.0)

    def deployed(
        name: str, stamp_ns: int, now_ns: int, services: tuple[ExpectedService, ...] = (PUI,)
    ) -> None:
        message = Deployment(stamp_ns=stamp_ns, name=name, scenario=name, services=services)
        belief.take(DEPLOYMENT, f"{RUN}{name}", message, now_ns, 0.0)

    happens(10)
    assert len(belief.cache.history()) == 1
    deployed("one", 20, 20)
    happens(30)
    assert len(belief.cache.history()) == 1
    deployed("one", 40, 40, services=())
    deployed("two", 900, 50)  # a slow simulation: its time is behind the wall's
    assert len(belief.cache.history()) == 0
    happens(60)
    belief.take(DEPLOYMENT, "anna", Deployment(stamp_ns=70, name="anna", services=(PUI,)), 70, 0.0)
    assert len(belief.cache.history()) == 1


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
def test_scenario_raises_no_alarm_when_replaced_or_restarted(scenario: str) -> None:
    restart = Restart()
    restart.end("run.scenario_4", 10.0)
    assert restart.status[-1].run == "over"
    restart.take(f"run.{scenario}", run_of(scenario), 16.0)
    for number, instance in enumerate(SERVICES):
        assert restart.tick(16.0 + 2 * number).run == "starts"
        restart.site.set_service(instance, True, 17.0 + 2 * number)
    assert restart.tick(16.0 + 2 * len(SERVICES)).run == "runs"
    assert [finding for status in restart.status for finding in status.findings] == []


def test_service_is_missing_when_it_never_starts_or_leaves_soon() -> None:
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


def test_run_is_over_when_ended_and_missing_when_it_died() -> None:
    ended = Restart()
    died = Restart()
    ended.end("run.scenario_4", 10.0)
    for now_s in (20.0, 100.0):
        status = ended.tick(now_s)
        assert (status.run, status.findings) == ("over", ())
    for instance in SERVICES:
        died.site.set_service(instance, False, 10.0)
    died.tick(10.0)
    assert (died.tick(13.0).run, len(died.tick(14.0).findings)) == ("runs", len(SERVICES) + 1)


def test_person_who_comes_after_the_end_begins_no_run() -> None:
    restart = Restart()
    restart.end("run.scenario_4", 10.0)
    restart.take("anna", deployment("pointing.anna"), 20.0)
    assert restart.tick(20.0).run == "runs"


def test_run_goes_on_when_one_person_ends() -> None:
    restart = Restart()
    restart.take("anna", deployment("pointing.anna"), 2.0)
    restart.take("anna", deployment(), 3.0)
    assert restart.tick(4.0).run == "runs"


def test_arm_source_is_a_simulation_a_device_or_none(sight: SiteObservation) -> None:
    def source(moved_by: Mover = "own") -> str:
        return sight.status({}, [PersonLine(user="anna", moved_by=moved_by)], 1.0).people[0].source

    assert source() == "device"
    sight.set_present("imu-bridge.anna", True, 0.0)
    assert source() == "unknown", "its bridge has not reported yet"
    heard(sight, "imu-bridge.anna", 1.0, figures=(Figure(name=OWN_SOURCE, value=1.0),))
    assert source() == "device"
    heard(sight, "imu-bridge.anna", 2.0, figures=(Figure(name=OWN_SOURCE, value=0.0),))
    assert (source("mouse"), source()) == ("none", "none"), "at once when the page gives it back"
    sight.set_present("user-sim.ben", True, 0.0)
    sight.set_present("tool-of-somebody.anna", True, 0.0)
    assert source() == "none", "of another person, and of a program that is not known here"
    sight.set_present("user-sim.anna", True, 0.0)
    assert source() == "simulation"
