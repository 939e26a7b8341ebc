"""From messages to what people did: pointing acts and selections."""

from typing import Any

from pointit.conversion.acts import Act, ActDetector, SelectionRow
from pointit.schemas import Cursor, Hover, SelectionEvent, TrackedObject, TrackedObjects
from tests.unit.conversion.session import BEGAN_NS, at


def hover(found: ActDetector, begin_s: float, end_s: float, object_id: str, user: str = "anna") -> None:
    for tick in range(round(begin_s * 50), round(end_s * 50) + 1):
        found.on_hover(user, Hover(stamp_ns=at(tick / 50), object_id=object_id, miss_rad=0.01, progress=0.5))


def event(time_s: float, what: str, object_id: str, user: str = "anna", **more: Any) -> SelectionEvent:
    return SelectionEvent.model_validate(
        {"stamp_ns": at(time_s), "event": what, "object_id": object_id, "user": user, **more}
    )


def acts(found: ActDetector) -> list[tuple[str, str, float, float, str]]:
    found.end()
    return [(act.user, act.object_id, act.begin_s, act.duration_s, act.outcome) for act in found.acts]


def only_act(found: ActDetector) -> Act:
    found.end()
    (act,) = found.acts
    return act


def only_selection(found: ActDetector) -> SelectionRow:
    found.end()
    (row,) = found.selections
    return row


def test_an_act_lasts_as_long_as_the_cursor_is_on_the_object() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    hover(found, 1.52, 2.0, "b")
    assert acts(found) == [("anna", "a", 1.0, 0.5, "none"), ("anna", "b", 1.52, 0.48, "none")]


def test_a_short_slip_off_the_object_does_not_end_an_act_and_a_long_one_does() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.2, "a")
    hover(found, 1.22, 1.4, "")
    hover(found, 1.42, 2.0, "a")
    hover(found, 2.02, 2.5, "")
    hover(found, 2.52, 3.0, "a")
    assert acts(found) == [("anna", "a", 1.0, 1.0, "none"), ("anna", "a", 2.52, 0.48, "none")]


def test_an_act_ends_when_hovers_stop() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.2, "a")
    hover(found, 9.0, 9.2, "a")
    assert [act[2:4] for act in acts(found)] == [(1.0, 0.2), (9.0, 0.2)]


def test_people_point_at_the_same_time() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.2, "a")
    hover(found, 1.0, 1.2, "a", user="ben")
    assert {act[0] for act in acts(found)} == {"anna", "ben"}


def test_an_act_has_its_outcome_kind_distance_and_surface() -> None:
    found = ActDetector(BEGAN_NS)
    box = TrackedObject(id="a", kind="red", position_m=(1.0, 0.0, 0.0))
    found.on_objects("conveyor", TrackedObjects(stamp_ns=at(0.0), objects=(box,)))
    for tick in range(3):
        cursor = Cursor(
            stamp_ns=at(1.0), surface="belt", surface_id="b1", point_m=(1.0, 0.0, 0.0), range_m=2.0 + tick
        )
        found.on_cursor("anna", cursor)
        found.on_hover("anna", Hover(stamp_ns=at(1.0 + tick / 10), object_id="a", miss_rad=0.3 - tick / 10))
    found.on_event(event(1.25, "selected", "a", cause="dwell", confidence=0.9))
    act = only_act(found)
    assert (act.object_kind, act.surface, act.surface_id) == ("red", "belt", "b1")
    assert (act.outcome, act.outcome_after_s, act.cause, act.confidence) == ("selected", 0.25, "dwell", 0.9)
    assert act.range_m == 3.5  # the first cursor came before the act
    assert act.miss_rad is not None
    assert round(act.miss_rad, 9) == 0.1


def test_an_event_just_after_the_act_is_its_outcome_and_one_long_after_is_not() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    hover(found, 1.52, 1.9, "b")
    found.on_event(event(1.6, "refused", "a"))
    found.on_event(event(5.0, "selected", "b"))
    assert [act[4] for act in acts(found)] == ["refused", "none"]


def test_a_second_outcome_on_the_same_object_is_another_act() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    found.on_event(event(1.5, "selected", "a"))
    hover(found, 1.52, 2.5, "a")
    found.on_event(event(2.5, "deselected", "a"))
    assert [act[2:] for act in acts(found)] == [(1.0, 1.5, "selected"), (1.5, 1.0, "deselected")]


def test_what_somebody_else_does_is_no_outcome() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    found.on_event(event(1.4, "selected", "a", user="ben"))
    assert only_act(found).outcome == "none"


def test_a_selection_has_the_pointing_before_it_and_its_end() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    found.on_event(event(1.5, "selected", "a", kind="red", cause="dwell"))
    found.on_event(event(4.0, "deselected", "a", user="ben"))
    row = only_selection(found)
    assert (row.user, row.object_id, row.object_kind, row.cause) == ("anna", "a", "red", "dwell")
    assert (row.selected_s, row.pointed_s, row.kept_s) == (1.5, 0.5, 2.5)
    assert (row.ended_by, row.ended_s, row.ended_user) == ("deselected", 4.0, "ben")


def test_a_dispatched_object_has_its_bay() -> None:
    found = ActDetector(BEGAN_NS)
    found.on_event(event(1.5, "selected", "a"))
    found.on_event(event(4.0, "dispatched", "a", bay="2"))
    row = only_selection(found)
    assert (row.ended_by, row.bay, row.ended_user, row.pointed_s) == ("dispatched", "2", "", None)


def test_what_is_taken_over_ends_one_selection_and_begins_another() -> None:
    found = ActDetector(BEGAN_NS)
    found.on_event(event(1.0, "selected", "a"))
    found.on_event(event(2.0, "selected", "a", user="ben"))
    found.end()
    assert [(row.user, row.ended_by, row.ended_user) for row in found.selections] == [
        ("anna", "deselected", "ben"),
        ("ben", "recording", ""),
    ]


def test_the_end_of_an_object_that_was_not_selected_is_no_selection() -> None:
    found = ActDetector(BEGAN_NS)
    found.on_event(event(1.0, "left", "a"))
    found.on_event(event(1.0, "refused", "a"))
    found.end()
    assert found.selections == []
