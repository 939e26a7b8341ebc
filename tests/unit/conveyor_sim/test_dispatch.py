"""Selected packages to one bay, the rest to another, on the paper's conveyor."""

import pytest

from pointit.maps.file import load_map
from pointit.schemas import Environment, SelectionEvent, TrackedObject
from pointit.services.conveyor_sim.plant import Plant, UnusableMapError
from tests.unit.conveyor_sim.rooms import CROSS, FORK, RING, S, belt, link, plant, room

SHIPPED = load_map("conveyor", 0)


def go(belts: Plant, until_s: float, owners: dict[str, str] | None = None) -> list[SelectionEvent]:
    events: list[SelectionEvent] = []
    while belts.now_ns < round(until_s * S):
        if owners is not None:
            belts.select(owners)
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


def test_selection_past_the_last_way_is_refused_once() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    go(belts, 7.0)  # 3.5 m: bay 1 is 3 m along
    assert belts.refusals == {name: ""}
    assert go(belts, 7.2, {name: "anna"}) == []
    assert belts.refusals == {name: "it is past its last way to bay 1 and goes on to bay 3"}
    (event,) = go(belts, 20.0, {name: "anna", "another": "bert"})
    assert (event.event, event.user, event.bay) == ("dispatched", "", "3")
    assert belts.state(0).refused == 1
    assert [(bay.bay, bay.count, bay.selected) for bay in belts.state(0).bays] == [("3", 1, 0)]


def test_late_deselection_is_refused_and_may_be_taken_back() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    belts.select({name: "anna"})
    go(belts, 7.0)  # on the side belt
    belts.select({})
    assert belts.refusals[name]
    belts.select({name: "anna"})
    assert not belts.refusals[name]
    belts.select({})
    assert belts.refusals[name]
    belts.select({name: "anna"})
    (event,) = go(belts, 20.0)
    assert (event.event, event.bay, event.user) == ("dispatched", "1", "anna")


def test_departures_of_selected_packages_are_stored_for_late_subscribers() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    chosen = belts.add("red", "main", 0.3)
    late = ""
    other = ""
    belts.select({chosen: "anna"})
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


def test_bay_outside_the_map_is_replaced_by_the_nearest() -> None:
    bays = FORK.model_copy(update={"bays": FORK.bays[1::-1]})
    belts = plant(bays, feeder={"sequence": []}, bay_rest="9")
    name = belts.add("red", "main", 0.3)
    assert bay_of(belts, name) == "1"
    assert until_s(belts, name) is None  # it goes there whether it is selected or not


def test_feeder_on_a_missing_belt_is_reported() -> None:
    with pytest.raises(UnusableMapError, match=r"feeders\.in: map 'hall' has no belt 'x', there are main, "):
        plant(FORK, feeders={"in": {"belt": "x", "sequence": ["red"]}})


TWO_WAYS = room(RING.belts, RING.links, b1="out", b3="west")
ROUND = room(
    [
        belt("loop", (0, 2), (0, 0), (4, 0), (4, 4), (0, 4), (0, 2.3)),
        belt("in", (2.2, -3), (2.2, -0.3)),
        belt("out", (2, 0.3), (2, 3)),
        belt("off", (1.5, -0.3), (1.5, -3)),
    ],
    [link("in", "loop", to_m=4.2), link("loop", "loop"), link("loop", "out", 4.0), link("loop", "off", 3.5)],
    b1="out",
    b3="off",
)
"""A ring on which the way in and both ways out lie in one zone."""
STEP_NS = S // 25


def listed(belts: Plant, name: str) -> TrackedObject | None:
    return next((one for one in belts.tracked(belts.now_ns).objects if one.id == name), None)


def until_s(belts: Plant, name: str) -> float | None:
    tracked = listed(belts, name)
    assert tracked is not None
    return None if tracked.bay_until_ns is None else tracked.bay_until_ns / S


def pass_time(belts: Plant, seconds: float) -> list[SelectionEvent]:
    events: list[SelectionEvent] = []
    for _ in range(round(seconds * S / STEP_NS)):
        events += belts.step(belts.now_ns + STEP_NS)
    return events


def test_last_time_of_a_change_follows_from_the_present_speed() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    first = until_s(belts, name)
    assert first is not None
    assert 2.4 / 0.5 <= first <= 3.0 / 0.5  # the diverter is 3 m along, its zone begins before it

    pass_time(belts, 2.0)
    assert until_s(belts, name) == pytest.approx(first, abs=1e-6)  # a time, not what is left of it
    belts.set_speed(1.0)
    assert until_s(belts, name) == pytest.approx(2.0 + (first - 2.0) / 2.0, abs=1e-6)

    belts.set_speed(0.0)
    assert until_s(belts, name) is None
    belts.set_speed(0.5)
    pass_time(belts, 5.0)
    assert until_s(belts, name) == 0.0

    belts.set_speed(0.0)
    assert until_s(belts, name) == 0.0  # it stands behind the diverter


ROOMS: dict[str, tuple[Environment, tuple[str, ...]]] = {
    "fork": (FORK, ("main",)),
    "cross": (CROSS, ("w",)),
    "ring": (TWO_WAYS, ("in", "south")),
    "round": (ROUND, ("in",)),
    "shipped": (SHIPPED, ("part_e", "part_h")),
}


@pytest.mark.parametrize("where", sorted(ROOMS))
@pytest.mark.parametrize("is_selected", [False, True])
def test_change_is_in_time_until_exactly_the_reported_time(where: str, *, is_selected: bool) -> None:
    environment, entries = ROOMS[where]
    belts = plant(environment, feeder={"sequence": []})
    other = plant(environment, feeder={"sequence": []})
    name = belts.add("red", entries[0], 0.3)
    before, after = ({name: "anna"}, {}) if is_selected else ({}, {name: "anna"})
    belts.select(before)
    seen: set[bool] = set()

    def outcome(at_ns: int) -> list[tuple[bool, bool]]:
        """Return for each package that leaves: a change at `at_ns` was refused; it leaves at bay 1."""
        other.skip_time(belts.now_ns)
        other.restore(belts.snapshot())
        other.step(at_ns)
        other.select(after)
        is_refused = any(other.refusals.values())
        return [(is_refused, e.bay == "1") for e in other.step(at_ns + 60 * S)]

    in_time = [(False, not is_selected)]
    too_late = [(True, is_selected)]
    comes_round = (where, is_selected) == ("ring", False)  # until it leaves
    while (tracked := listed(belts, name)) is not None and belts.now_ns < 60 * S:
        until_ns = tracked.bay_until_ns
        assert outcome(belts.now_ns) == (too_late if until_ns == 0 else in_time)
        if until_ns:
            assert outcome(until_ns - 1) == in_time
            assert outcome(until_ns + STEP_NS) == ([] if comes_round else too_late)
        seen.add(until_ns == 0)
        belts.step(belts.now_ns + 50 * STEP_NS)
    assert seen == (
        {False} if (where, is_selected) == ("ring", False) else {True, False}
    )  # it comes round again
