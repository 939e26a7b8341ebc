"""Messages of a site that are valid, by the same rules for everybody."""

from typing import Any

import pytest

from pointit.schemas import (
    ActOutcome,
    Configuration,
    Cursor,
    Health,
    Message,
    Selection,
    SelectionEvent,
    ThingStates,
    UserPose,
)
from pointit.schemas.topics import (
    ANNOUNCED,
    CONFIGURATION,
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
    OUTCOMES,
    POSE,
    PROFILE,
    SELECTION,
    SELECTION_EVENTS,
    STEERING,
    STRIPS_FRAME,
    THING_STATES,
    Topic,
)
from pointit.services.registry import SHOWN
from pointit.site import site_state as module
from pointit.site.site_state import MAX_TRACKER_AGE_S, Change, SiteState, ends_with_writers, is_personal

POSED = UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0)
CURSED = Cursor(stamp_ns=1)


@pytest.fixture
def changes() -> list[Change]:
    return []


@pytest.fixture
def site(changes: list[Change]) -> SiteState:
    return SiteState(changes.append)


def put(site: SiteState, topic: Topic[Any], name: str = "", message: Message = CURSED) -> bool:
    return site.take(topic, name, message, 0.0)


def appear(site: SiteState, *instances: str) -> None:
    for instance in instances:
        site.set_service(instance, True)


def gone(changes: list[Change]) -> set[tuple[str, str]]:
    return {(each.topic.key, each.name) for each in changes if each.message is None}


def test_what_has_lost_its_writer_goes(site: SiteState, changes: list[Change]) -> None:
    appear(site, "pui", "selector")
    for topic, name in ((CURSOR, "anna"), (CURSOR, "ben"), (MAP, ""), (SELECTION, ""), (HEALTH, "pui")):
        assert put(site, topic, name)
    site.set_service("pui", False)
    assert gone(changes) == {(CURSOR.key, "anna"), (CURSOR.key, "ben"), (HEALTH.key, "pui")}
    assert site.former_services == {"pui"}
    assert list(site.all(MAP)) == [""]


def test_what_another_still_writes_stays(site: SiteState, changes: list[Change]) -> None:
    appear(site, "led-driver", "ros2", "supervisor.anna", "supervisor.ben")
    for topic, name in ((LAMP_COLOR, "l1"), (INTERACTION, "anna"), (INTERACTION, "ben")):
        put(site, topic, name)
    site.set_service("supervisor.anna", False)
    assert gone(changes) == set(), "ros2 may write it"
    site.set_service("ros2", False)
    assert gone(changes) == {(INTERACTION.key, "anna")}


def test_what_outsiders_may_write_does_not_go_with_a_service() -> None:
    with_writers = {topic for topic in SHOWN if ends_with_writers(topic)}
    assert not {MAP, OBJECTS, POSE, PROFILE, DEPLOYMENT} & with_writers
    assert {CURSOR, HOVER, STRIPS_FRAME, CONVEYOR_STATE, SELECTION} <= with_writers


def test_all_that_is_a_persons_goes_with_them() -> None:
    personal = {topic for topic in SHOWN if is_personal(topic)}
    assert personal == {PROFILE, POSE, LOCALIZATION, CURSOR, HOVER, ANNOUNCED, INTERACTION, STEERING}
    assert FEEDBACK not in personal, "what happened, happened"


def test_states_return_with_their_person_and_late_messages_do_not(
    site: SiteState, changes: list[Change]
) -> None:
    site.set_person("anna", True)
    put(site, POSE, "anna", POSED)
    put(site, CURSOR, "anna")
    site.set_person("anna", False)
    put(site, CURSOR, "anna")  # held up on its way
    assert not site.all(POSE)
    assert not site.all(CURSOR)
    changes.clear()
    site.set_person("anna", True)
    assert changes == [Change(POSE, "anna", POSED)]
    put(site, CURSOR, "anna")
    assert site.get(CURSOR, "anna") == CURSED


def test_late_messages_of_a_service_bring_nothing_back(site: SiteState) -> None:
    appear(site, "pui", "selector")
    put(site, CURSOR, "anna")
    put(site, SELECTION, "", Selection(stamp_ns=1))
    site.set_service("pui", False)
    put(site, CURSOR, "anna")
    put(site, HEALTH, "pui", Health(stamp_ns=1, service="pui", instance="pui", pid=1))
    assert not site.all(CURSOR)
    assert not site.all(HEALTH)
    site.set_service("selector", False)
    put(site, SELECTION, "", Selection(stamp_ns=2))  # the next one's, whose presence is not known yet
    assert not site.all(SELECTION)
    appear(site, "selector")
    assert site.get(SELECTION) == Selection(stamp_ns=2)


def test_states_return_with_a_writer_that_was_cut_off_until_it_writes_new_ones(
    site: SiteState, changes: list[Change]
) -> None:
    appear(site, "selector")
    put(site, SELECTION, "", kept := Selection(stamp_ns=1))
    put(
        site,
        CONFIGURATION,
        "selector",
        told := Configuration(stamp_ns=1, service="selector", instance="selector"),
    )
    site.set_service("selector", False)
    assert not site.all(SELECTION)
    assert not site.all(CONFIGURATION)
    changes.clear()
    appear(site, "selector")
    assert changes == [Change(SELECTION, "", kept), Change(CONFIGURATION, "selector", told)]
    put(site, SELECTION, "", restarted := Selection(stamp_ns=2))
    assert site.get(SELECTION) == restarted


def test_a_report_that_comes_before_the_presence_of_its_service_is_shown_with_it(site: SiteState) -> None:
    appear(site, "pui")
    site.set_service("pui", False)
    put(site, CONFIGURATION, "pui", report := Configuration(stamp_ns=1, service="pui", instance="pui"))
    assert site.get(CONFIGURATION, "pui") is None
    appear(site, "pui")
    assert site.get(CONFIGURATION, "pui") == report


def test_a_silent_tracker_is_gone_once(site: SiteState, changes: list[Change]) -> None:
    site.take(OBJECTS, "conveyor", CURSED, 0.0)
    site.take(OBJECTS, "robot", CURSED, 2.0)
    site.tick(MAX_TRACKER_AGE_S)
    assert gone(changes) == set()
    site.tick(MAX_TRACKER_AGE_S + 0.1)
    site.tick(MAX_TRACKER_AGE_S + 0.2)
    assert [each for each in changes if each.message is None] == [Change(OBJECTS, "conveyor", None, CURSED)]


def test_of_names_without_end_nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_FORMER", 5)
    site = SiteState(max_keys=10)
    assert [put(site, POSE, f"user{n}", POSED) for n in range(20)] == [True] * 10 + [False] * 10
    for n in range(20):
        site.set_person(f"user{n}", False)
    assert not site.all(POSE)
    assert put(site, POSE, "user0", POSED), "forgotten that they have left"
    site.set_person("user9", True)
    assert site.get(POSE, "user9") == POSED


def acted(result: str = "", **fields: object) -> SelectionEvent | ActOutcome:
    """Return an act of anna on the lamp, or its outcome."""
    usual = {"stamp_ns": 5, "event": "selected", "object_id": "lamp", "user": "anna"}
    if result:
        return ActOutcome.model_validate(usual | {"stamp_ns": 9, "event_ns": 5, "result": result} | fields)
    return SelectionEvent.model_validate(usual | {"carriers": ("home",)} | fields)


@pytest.mark.parametrize(
    ("results", "told", "pending"),
    [
        ([], [], 1),
        (["done"], [("selected", "")], 0),
        (["started", "done"], [("selected", "")], 0),
        (["failed"], [("refused", "no power")], 0),
        (["started", "failed"], [("selected", ""), ("refused", "no power")], 0),
        (["done", "done"], [("selected", "")], 0),
    ],
)
def test_an_act_is_told_when_its_carriers_have_told_the_result(
    site: SiteState, changes: list[Change], results: list[str], told: list[tuple[str, str]], pending: int
) -> None:
    put(site, SELECTION_EVENTS, "", acted())
    for result in results:
        put(site, OUTCOMES, "", acted(result, text="no power" if result == "failed" else ""))
    if "failed" in results:
        put(site, SELECTION_EVENTS, "", acted(event="deselected", reason="not done: no power", carriers=()))
    events = [each.message for each in changes if isinstance(each.message, SelectionEvent)]
    assert [(each.event, each.reason) for each in events] == told
    assert all((each.stamp_ns, each.carriers) == (5, ()) for each in events)
    assert [each.topic for each in changes if each.topic is OUTCOMES] == [OUTCOMES] * len(results)
    assert site.act_results.pending == pending


def test_an_outcome_that_is_read_before_its_event_shows_it(site: SiteState, changes: list[Change]) -> None:
    put(site, OUTCOMES, "", acted("done"))
    put(site, SELECTION_EVENTS, "", acted())
    assert [each.message.event for each in changes if isinstance(each.message, SelectionEvent)] == [
        "selected"
    ]
    assert site.act_results.pending == 0


def test_what_goes_back_waits_for_nobody(site: SiteState) -> None:
    put(site, SELECTION_EVENTS, "", acted(event="deselected", reason="not done: no power"))
    assert site.act_results.pending == 0


def test_the_things_of_a_carrier_end_and_return_with_it(site: SiteState, changes: list[Change]) -> None:
    put(site, THING_STATES, "home", ThingStates(stamp_ns=1))
    site.set_carrier("home", True)
    site.set_carrier("home", False)
    assert gone(changes) == {(THING_STATES.key, "home")}
    put(site, THING_STATES, "home", ThingStates(stamp_ns=2))
    assert site.get(THING_STATES, "home") is None, "it is late, or its new process is not known yet"
    site.set_carrier("home", True)
    assert site.get(THING_STATES, "home") == ThingStates(stamp_ns=2)
