"""Keys of people, services and scenarios that have gone are removed."""

from collections.abc import Sequence
from typing import Any

from pointit.bridges.web.model.stale_keys import (
    MISSED_S,
    SILENT_S,
    WITH_WRITER,
    Deployments,
    Trackers,
    keys_of_person,
    keys_of_service,
)
from pointit.schemas import Deployment
from pointit.schemas.system import ExpectedService
from pointit.schemas.topics import (
    CONVEYOR_STATE,
    CURSOR,
    DEPLOYMENT,
    FEEDBACK,
    HEALTH,
    HOVER,
    INTERACTION,
    LAMP_COLOR,
    LOCALIZATION,
    MAP,
    OBJECTS,
    POSE,
    PROFILE,
    ROBOT_PLAN,
    ROBOT_STATE,
    SELECTION,
    STEERING,
    STRIPS_FRAME,
    Topic,
)


def gone(instance: str, present: Sequence[str], known: dict[Topic[Any], list[str]]) -> set[tuple[str, str]]:
    return {
        (topic.key, name) for topic, name in keys_of_service(instance, present, lambda t: known.get(t, []))
    }


def test_what_has_lost_its_writer_goes() -> None:
    known: dict[Topic[Any], list[str]] = {CURSOR: ["anna", "ben"], MAP: [""], SELECTION: [""]}
    assert gone("pui", ["selector"], known) == {
        (CURSOR.key, "anna"),
        (CURSOR.key, "ben"),
        (HEALTH.key, "pui"),
    }


def test_what_another_still_writes_stays() -> None:
    known: dict[Topic[Any], list[str]] = {LAMP_COLOR: ["l1"]}
    assert gone("led-driver", ["led-driver"], known) == {(HEALTH.key, "led-driver")}  # its successor
    assert (LAMP_COLOR.key, "l1") in gone("led-driver", ["pui"], known)


def test_one_persons_service_takes_nothing_of_others() -> None:
    known: dict[Topic[Any], list[str]] = {INTERACTION: ["anna", "ben"], LOCALIZATION: ["anna"]}
    present = ["supervisor.ben", "localizer.anna"]
    assert gone("supervisor.anna", present, known) == {
        (INTERACTION.key, "anna"),
        (HEALTH.key, "supervisor.anna"),
    }


def test_one_robot_takes_nothing_of_others() -> None:
    known: dict[Topic[Any], list[str]] = {ROBOT_STATE: ["quad", "cart"], ROBOT_PLAN: ["quad"]}
    assert gone("robot.quad", ["robot.cart", "goal.anna"], known) == {
        (ROBOT_STATE.key, "quad"),
        (ROBOT_PLAN.key, "quad"),
        (HEALTH.key, "robot.quad"),
    }


def test_what_outsiders_may_write_does_not_go_with_a_service() -> None:
    assert not {MAP, OBJECTS, POSE, PROFILE, DEPLOYMENT} & set(WITH_WRITER)
    assert {CURSOR, HOVER, STRIPS_FRAME, CONVEYOR_STATE, SELECTION} <= set(WITH_WRITER)


def test_all_that_is_a_persons_goes_with_them() -> None:
    topics = {topic for topic, user in keys_of_person("anna") if user == "anna"}
    assert topics == {PROFILE, POSE, LOCALIZATION, CURSOR, HOVER, INTERACTION, STEERING}
    assert FEEDBACK not in topics, "what happened, happened"


def test_a_silent_tracker_is_gone_once() -> None:
    trackers = Trackers()
    trackers.heard("conveyor", 0.0)
    trackers.heard("robot", 2.0)
    assert trackers.silent(SILENT_S) == []
    assert trackers.silent(SILENT_S + 0.1) == [(OBJECTS, "conveyor")]
    assert trackers.silent(SILENT_S + 0.2) == []


def deployment(*instances: str, scenario: str = "") -> Deployment:
    services = tuple(
        ExpectedService(service=service, user=user)
        for service, _, user in (instance.partition(".") for instance in instances)
    )
    return Deployment(stamp_ns=0, name="x", services=services, scenario=scenario)


def test_what_has_vanished_is_missed_for_a_day() -> None:
    deployments = Deployments("web")
    assert deployments.put("anna", deployment("pointing.anna", "supervisor.anna"), 0.0) == []
    assert deployments.over({"pui", "supervisor.anna"}, 100.0) == []
    assert deployments.over({"pui"}, 99.0 + MISSED_S) == []
    assert set(deployments.known) == {"anna"}
    assert deployments.over({"pui"}, 100.0 + MISSED_S) == [(DEPLOYMENT, "anna")]
    assert deployments.known == {}
    assert deployments.over(set(), 101.0 + MISSED_S) == []


def test_what_was_ended_on_purpose_is_over_at_once() -> None:
    deployments = Deployments("web")
    deployments.put("anna", deployment("pointing.anna"), 0.0)
    assert deployments.put("anna", deployment(), 1.0) == [(DEPLOYMENT, "anna")]
    assert deployments.known == {}
    assert deployments.put("ben", deployment(), 1.0) == [(DEPLOYMENT, "ben")], "a page that came since"
    assert deployments.over(set(), 2.0 + MISSED_S) == []


def test_the_page_itself_keeps_no_deployment() -> None:
    deployments = Deployments("web")
    deployments.put("scenario_4", deployment("pui", "web"), 0.0)
    assert deployments.over({"web"}, MISSED_S) == [(DEPLOYMENT, "scenario_4")]


def test_one_scenario_replaces_another_and_no_persons_part() -> None:
    deployments = Deployments("web")
    deployments.put("scenario_3", deployment("pui", scenario="scenario_3"), 0.0)
    deployments.put("anna", deployment("pointing.anna"), 0.0)
    replaced = deployments.put("scenario_4", deployment("pui", scenario="scenario_4"), 0.0)
    assert replaced == [(DEPLOYMENT, "scenario_3")]
    assert set(deployments.known) == {"anna", "scenario_4"}
    assert deployments.put("scenario_4", deployment("pui", scenario="scenario_4"), 0.0) == []


def test_another_scenario_is_told_from_the_same_again() -> None:
    def scenario(name: str) -> Deployment:
        return deployment("pui", scenario=name)

    deployments = Deployments("web")
    assert not deployments.is_another(scenario("scenario_4"))
    deployments.put("run", scenario("scenario_4"), 0.0)
    assert not deployments.is_another(scenario("scenario_4"))
    assert not deployments.is_another(scenario(""))  # one person's part
    assert deployments.is_another(scenario("scenario_1"))
    deployments.put("run", deployment(), 1.0)
    assert deployments.is_another(scenario("scenario_1")), "it ended before the other began"
