"""SiteState: which messages of a site are shown, hidden and shown again."""

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

A_POSE = UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0)
A_CURSOR = Cursor(stamp_ns=1)


@pytest.fixture
def changes() -> list[Change]:
    return []


@pytest.fixture
def site(changes: list[Change]) -> SiteState:
    return SiteState(changes.append)


def receive(site: SiteState, topic: Topic[Any], name: str = "", message: Message = A_CURSOR) -> bool:
    return site.take(topic, name, message, 0.0)


def start(site: SiteState, *instances: str) -> None:
    for instance in instances:
        site.set_service(instance, present=True)


def hidden(changes: list[Change]) -> set[tuple[str, str]]:
    return {(change.topic.key, change.name) for change in changes if change.message is None}


def shown_events(changes: list[Change]) -> list[SelectionEvent]:
    return [change.message for change in changes if isinstance(change.message, SelectionEvent)]


def test_messages_end_with_their_last_writer(site: SiteState, changes: list[Change]) -> None:
    start(site, "pui", "selector")
    for topic, name in ((CURSOR, "anna"), (CURSOR, "ben"), (MAP, ""), (SELECTION, ""), (HEALTH, "pui")):
        assert receive(site, topic, name)

    site.set_service("pui", present=False)

    assert hidden(changes) == {(CURSOR.key, "anna"), (CURSOR.key, "ben"), (HEALTH.key, "pui")}
    assert site.former_services == {"pui"}
    assert list(site.all(MAP)) == [""]


def test_messages_stay_while_another_writer_is_present(site: SiteState, changes: list[Change]) -> None:
    start(site, "led-driver", "ros2", "supervisor.anna", "supervisor.ben")
    for topic, name in ((LAMP_COLOR, "l1"), (INTERACTION, "anna"), (INTERACTION, "ben")):
        receive(site, topic, name)

    site.set_service("supervisor.anna", present=False)
    assert hidden(changes) == set(), "ros2 may write it"

    site.set_service("ros2", present=False)
    assert hidden(changes) == {(INTERACTION.key, "anna")}


def test_topics_of_outsiders_do_not_end_with_services() -> None:
    with_writers = {topic for topic in SHOWN if ends_with_writers(topic)}
    assert not {MAP, OBJECTS, POSE, PROFILE, DEPLOYMENT} & with_writers
    assert {CURSOR, HOVER, STRIPS_FRAME, CONVEYOR_STATE, SELECTION} <= with_writers


def test_personal_topics_are_listed() -> None:
    personal = {topic for topic in SHOWN if is_personal(topic)}
    assert personal == {PROFILE, POSE, LOCALIZATION, CURSOR, HOVER, ANNOUNCED, INTERACTION, STEERING}
    assert FEEDBACK not in personal, "what happened, happened"


def test_states_return_with_their_person_late_messages_do_not(site: SiteState, changes: list[Change]) -> None:
    site.set_person("anna", present=True)
    receive(site, POSE, "anna", A_POSE)
    receive(site, CURSOR, "anna")

    site.set_person("anna", present=False)
    receive(site, CURSOR, "anna")  # held up on its way
    assert not site.all(POSE)
    assert not site.all(CURSOR)

    changes.clear()
    site.set_person("anna", present=True)
    assert changes == [Change(POSE, "anna", A_POSE)]

    receive(site, CURSOR, "anna")
    assert site.get(CURSOR, "anna") == A_CURSOR


def test_late_messages_of_ended_service_are_not_shown(site: SiteState) -> None:
    start(site, "pui", "selector")
    receive(site, CURSOR, "anna")
    receive(site, SELECTION, "", Selection(stamp_ns=1))
    site.set_service("pui", present=False)
    receive(site, CURSOR, "anna")
    receive(site, HEALTH, "pui", Health(stamp_ns=1, service="pui", instance="pui", pid=1))
    assert not site.all(CURSOR)
    assert not site.all(HEALTH)
    site.set_service("selector", present=False)
    receive(site, SELECTION, "", Selection(stamp_ns=2))  # the next one's, whose presence is not known yet
    assert not site.all(SELECTION)
    start(site, "selector")
    assert site.get(SELECTION) == Selection(stamp_ns=2)


def test_states_return_with_their_writer(site: SiteState, changes: list[Change]) -> None:
    selection = Selection(stamp_ns=1)
    configuration = Configuration(stamp_ns=1, service="selector", instance="selector")
    start(site, "selector")
    receive(site, SELECTION, "", selection)
    receive(site, CONFIGURATION, "selector", configuration)

    site.set_service("selector", present=False)
    assert not site.all(SELECTION)
    assert not site.all(CONFIGURATION)

    changes.clear()
    start(site, "selector")
    assert changes == [Change(SELECTION, "", selection), Change(CONFIGURATION, "selector", configuration)]

    new_selection = Selection(stamp_ns=2)
    receive(site, SELECTION, "", new_selection)
    assert site.get(SELECTION) == new_selection


def test_report_waits_for_presence_of_its_service(site: SiteState) -> None:
    report = Configuration(stamp_ns=1, service="pui", instance="pui")
    start(site, "pui")
    site.set_service("pui", present=False)

    receive(site, CONFIGURATION, "pui", report)
    assert site.get(CONFIGURATION, "pui") is None

    start(site, "pui")
    assert site.get(CONFIGURATION, "pui") == report


def test_silent_tracker_is_removed_once(site: SiteState, changes: list[Change]) -> None:
    site.take(OBJECTS, "conveyor", A_CURSOR, 0.0)
    site.take(OBJECTS, "robot", A_CURSOR, 2.0)

    site.tick(MAX_TRACKER_AGE_S)
    assert hidden(changes) == set()

    site.tick(MAX_TRACKER_AGE_S + 0.1)
    site.tick(MAX_TRACKER_AGE_S + 0.2)
    removals = [change for change in changes if change.message is None]
    assert removals == [Change(OBJECTS, "conveyor", None, A_CURSOR)]


def test_memory_is_bounded_when_names_never_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_FORMER", 5)
    site = SiteState(max_keys=10)
    users = [f"user{number}" for number in range(20)]

    is_stored = [receive(site, POSE, user, A_POSE) for user in users]
    assert is_stored == [True] * 10 + [False] * 10

    for user in users:
        site.set_person(user, present=False)
    assert not site.all(POSE)
    assert receive(site, POSE, "user0", A_POSE), "forgotten that they have left"
    site.set_person("user9", present=True)
    assert site.get(POSE, "user9") == A_POSE


def selected(**fields: object) -> SelectionEvent:
    """Return a selection of the lamp by anna, which the carrier `home` has to act on."""
    usual = {"stamp_ns": 5, "event": "selected", "object_id": "lamp", "user": "anna", "carriers": ("home",)}
    return SelectionEvent.model_validate(usual | fields)


def outcome(result: str) -> ActOutcome:
    """Return an outcome of `selected()`."""
    text = "no power" if result == "failed" else ""
    usual = {"stamp_ns": 9, "event_ns": 5, "event": "selected", "object_id": "lamp", "user": "anna"}
    return ActOutcome.model_validate(usual | {"result": result, "text": text})


UNDO = selected(event="deselected", reason="not done: no power")


@pytest.mark.parametrize(
    ("results", "expected", "pending"),
    [
        ([], [], 1),
        (["done"], [("selected", "")], 0),
        (["started", "done"], [("selected", "")], 0),
        (["failed"], [("refused", "no power")], 0),
        (["started", "failed"], [("selected", ""), ("refused", "no power")], 0),
        (["done", "done"], [("selected", "")], 0),
    ],
)
def test_event_is_shown_when_its_carriers_report(
    site: SiteState, changes: list[Change], results: list[str], expected: list[tuple[str, str]], pending: int
) -> None:
    receive(site, SELECTION_EVENTS, "", selected())
    for result in results:
        receive(site, OUTCOMES, "", outcome(result))
    if "failed" in results:
        receive(site, SELECTION_EVENTS, "", UNDO.model_copy(update={"carriers": ()}))

    events = shown_events(changes)
    assert [(event.event, event.reason) for event in events] == expected
    assert all((event.stamp_ns, event.carriers) == (5, ()) for event in events)
    assert [change.topic for change in changes].count(OUTCOMES) == len(results)
    assert site.act_results.pending == pending


def test_event_is_shown_when_outcome_came_first(site: SiteState, changes: list[Change]) -> None:
    receive(site, OUTCOMES, "", outcome("done"))
    receive(site, SELECTION_EVENTS, "", selected())

    assert [event.event for event in shown_events(changes)] == ["selected"]
    assert site.act_results.pending == 0


def test_undo_is_not_pending(site: SiteState) -> None:
    receive(site, SELECTION_EVENTS, "", UNDO)

    assert site.act_results.pending == 0


def test_thing_states_end_and_return_with_their_carrier(site: SiteState, changes: list[Change]) -> None:
    receive(site, THING_STATES, "home", ThingStates(stamp_ns=1))
    site.set_carrier("home", present=True)
    site.set_carrier("home", present=False)
    assert hidden(changes) == {(THING_STATES.key, "home")}
    receive(site, THING_STATES, "home", ThingStates(stamp_ns=2))
    assert site.get(THING_STATES, "home") is None, "it is late, or its new process is not known yet"
    site.set_carrier("home", present=True)
    assert site.get(THING_STATES, "home") == ThingStates(stamp_ns=2)
