"""Selected packages to one bay, the rest to another, on the paper's conveyor."""

from collections import Counter

import pytest

from pointit.maps.file import load_map
from pointit.schemas import SelectionEvent
from pointit.services.conveyor_sim.from_map import UnusableMapError
from pointit.services.conveyor_sim.plant import Plant
from tests.unit.conveyor_sim.rooms import FORK, S, plant

SHIPPED = load_map("conveyor", 0)


def go(belts: Plant, until_s: float, owners: dict[str, str] | None = None) -> list[SelectionEvent]:
    events: list[SelectionEvent] = []
    while belts.now_ns < round(until_s * S):
        if owners is not None:
            belts.select(owners, belts.now_ns)
        events += belts.step(belts.now_ns + S // 25)
    return events


def bay_of(belts: Plant, name: str) -> str:
    return next(tracked.bay for tracked in belts.tracked(0).objects if tracked.id == name)


def test_every_entry_reaches_every_bay_that_it_should() -> None:
    for entry, length_m, bays in [("part_e", 0.4, "1234"), ("part_h", 0.4, "1234")]:
        for bay in bays:
            belts = plant(SHIPPED, feeder={"sequence": []}, bay_rest=bay)
            name = belts.add("red", entry, length_m)
            assert bay_of(belts, name) == bay
            (event,) = go(belts, 60.0)
            assert (event.event, event.object_id, event.bay, event.user) == ("dispatched", name, bay, "")


def test_selected_red_ones_leave_at_bay_1_and_all_others_at_bay_3() -> None:
    feeders = {"in": {"belt": "part_e", "probabilities": {"red": 0.4, "blue": 0.6}, "length_m": 0.4}}
    belts = plant(SHIPPED, feeders=feeders, seed=3)
    events: list[SelectionEvent] = []
    for second in range(1, 301):
        events += go(belts, second)
        reds = {t.id: "anna" for t in belts.tracked(0).objects if t.kind == "red"}
        belts.select(reds, belts.now_ns)
    assert {event.event for event in events} == {"dispatched"}
    assert {(event.kind, event.bay, event.user) for event in events} == {
        ("red", "1", "anna"),
        ("blue", "3", ""),
    }
    counted = Counter((event.bay, event.kind) for event in events)
    state = belts.state(belts.now_ns)
    assert {(bay.bay, bay.kind): bay.count for bay in state.bays} == counted
    assert {bay.kind: bay.selected for bay in state.bays} == {"red": counted["1", "red"], "blue": 0}
    assert min(counted.values()) > 10
    assert (state.left, state.fed) == (len(events), len(events) + belts.size)


def test_deselection_in_time_sends_the_package_to_the_other_bay() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    assert bay_of(belts, name) == "3"
    belts.select({name: "anna"}, 0)
    assert bay_of(belts, name) == "1"
    go(belts, 3.0)
    belts.select({}, belts.now_ns)
    (event,) = go(belts, 20.0)
    assert (event.event, event.bay, event.user) == ("dispatched", "3", "")


def test_past_the_point_of_no_return_it_is_refused_once_and_goes_on() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    go(belts, 7.0)  # 3.5 m: bay 1 is 3 m along
    events = go(belts, 7.2, {name: "anna"})
    events += go(belts, 20.0, {name: "anna", "another": "bert"})
    assert [(event.event, event.user) for event in events] == [("refused", "anna"), ("dispatched", "")]
    assert events[0].reason == f"red {name} is past its last way to bay 1 and goes on to bay 3"
    assert events[1].bay == "3"
    assert belts.state(0).refused == 1
    assert [(bay.bay, bay.count, bay.selected) for bay in belts.state(0).bays] == [("3", 1, 0)]


def test_a_deselection_that_comes_too_late_is_refused_too_and_may_be_taken_back() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    belts.select({name: "anna"}, 0)
    go(belts, 7.0)  # on the side belt
    belts.select({}, belts.now_ns)
    (refused,) = go(belts, 7.1)
    assert (refused.event, refused.user) == ("refused", "anna")
    belts.select({name: "anna"}, belts.now_ns)
    assert go(belts, 7.2) == []
    assert [event.event for event in go(belts, 7.3, {})] == ["refused"]  # told again: it was tried again
    belts.select({name: "anna"}, belts.now_ns)
    (event,) = go(belts, 20.0)
    assert (event.event, event.bay, event.user) == ("dispatched", "1", "anna")


def test_late_deselection_leaves_the_package_with_its_user() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("blue", "main", 0.3)
    belts.select({name: "anna"}, 0)
    go(belts, 7.0)
    (refused, event) = go(belts, 20.0, {})
    assert (refused.event, refused.user) == ("refused", "anna")
    assert (event.event, event.bay, event.user) == ("dispatched", "1", "anna")
    assert [(bay.bay, bay.count, bay.selected) for bay in belts.state(0).bays] == [("1", 1, 1)]


def test_departures_of_selected_packages_are_stored_for_late_subscribers() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    chosen, late, other = belts.add("red", "main", 0.3), "", ""
    belts.select({chosen: "anna"}, 0)
    go(belts, 2.0)
    late = belts.add("red", "main", 0.3)
    go(belts, 4.0)
    other = belts.add("red", "main", 0.3)
    go(belts, 9.0)  # the second is at 3.5 m, past the way to bay 1
    events = go(belts, 40.0, {chosen: "anna", late: "anna"})
    gone = {event.object_id: event.stamp_ns for event in events if event.event == "dispatched"}
    assert gone.keys() == {chosen, late, other}
    departures = belts.state(belts.now_ns).departures
    assert [(d.object_id, d.bay, d.user) for d in departures] == [(chosen, "1", "anna"), (late, "3", "")]
    assert [d.stamp_ns for d in departures] == [gone[chosen], gone[late]]
    again = plant(FORK, feeder={"sequence": []})
    again.restore(belts.snapshot())
    assert again.state(0).departures == departures
    again.restore(belts.snapshot() | {"departures": [each.model_dump() for each in departures] * 26})
    assert len(again.state(0).departures) == 50  # no more are told, of however many
    again.reset()
    assert again.state(0).departures == ()


def test_a_bay_that_the_map_does_not_have_is_replaced_by_the_nearest() -> None:
    bays = FORK.model_copy(update={"bays": FORK.bays[1::-1]})
    belts = plant(bays, feeder={"sequence": []}, bay_rest="9")
    name = belts.add("red", "main", 0.3)
    assert bay_of(belts, name) == "1"
    assert until_ns(belts, name) is None  # it goes there whether it is selected or not


def until_ns(belts: Plant, name: str) -> int | None:
    objects = belts.tracked(belts.now_ns).objects
    return next(tracked.bay_until_ns for tracked in objects if tracked.id == name)


def test_reset_sets_the_counts_to_zero() -> None:
    belts = plant(FORK, feeder={"count": 2})
    go(belts, 30.0)
    assert belts.state(0).left == 2
    belts.reset()
    assert (belts.state(0).left, belts.state(0).bays, belts.state(0).refused) == (0, (), 0)


def test_a_feeder_on_a_belt_that_is_not_there_is_said() -> None:
    with pytest.raises(UnusableMapError, match=r"feeders\.in: map 'hall' has no belt 'x', there are main, "):
        plant(FORK, feeders={"in": {"belt": "x", "sequence": ["red"]}})
