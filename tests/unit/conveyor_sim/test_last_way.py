"""Until when a package can be sent to another bay: it can by then, and it cannot after."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.maps.file import load_map
from pointit.schemas import BeltLink, Environment, SelectionEvent, TrackedObject
from pointit.services.conveyor_sim.plant import Plant
from tests.unit.conveyor_sim.rooms import CROSS, FORK, RING, S, belt, plant, room

SHIPPED = load_map("conveyor", 0)
TAIL = room(FORK.belts, FORK.links, b3="main")
"""A room without the bay of selected packages."""
TWO_WAYS = room(RING.belts, RING.links, b1="out", b3="west")
ROUND = room(
    [
        belt("loop", (0, 2), (0, 0), (4, 0), (4, 4), (0, 4), (0, 2.3)),
        belt("in", (2.2, -3), (2.2, -0.3)),
        belt("out", (2, 0.3), (2, 3)),
        belt("off", (1.5, -0.3), (1.5, -3)),
    ],
    [
        BeltLink(source="in", target="loop", target_position_m=4.2),
        BeltLink(source="loop", target="loop"),
        BeltLink(source="loop", source_position_m=4.0, target="out"),
        BeltLink(source="loop", source_position_m=3.5, target="off"),
    ],
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


def go(belts: Plant, seconds: float) -> list[SelectionEvent]:
    events: list[SelectionEvent] = []
    for _ in range(round(seconds * S / STEP_NS)):
        events += belts.step(belts.now_ns + STEP_NS)
    return events


def test_it_is_told_at_the_present_speed_until_the_junctions_zone_begins() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    first = until_s(belts, name)
    assert first is not None
    assert 2.4 / 0.5 <= first <= 3.0 / 0.5  # the diverter is 3 m along, its zone begins before it
    go(belts, 2.0)
    assert until_s(belts, name) == pytest.approx(first, abs=1e-6)  # a time, not what is left of it
    belts.set_speed(1.0)
    assert until_s(belts, name) == pytest.approx(2.0 + (first - 2.0) / 2.0, abs=1e-6)
    belts.set_speed(0.0)
    assert until_s(belts, name) is None
    belts.set_speed(0.5)
    go(belts, 5.0)
    assert until_s(belts, name) == 0.0
    belts.set_speed(0.0)
    assert until_s(belts, name) == 0.0  # it stands behind the diverter


def test_there_is_no_limit_while_the_belt_runs_backwards() -> None:
    belts = plant(FORK, feeder={"sequence": []})
    name = belts.add("red", "main", 0.3)
    go(belts, 2.0)
    belts.set_speed(-0.5)
    assert until_s(belts, name) is None


def test_in_the_zone_of_a_turn_behind_a_bay_it_is_decided_where_the_bays_belt_ends() -> None:
    turn = room(
        [belt("x", (0, 0), (4, 0)), belt("y", (4.2, 0.2), (4.2, 4))],
        [BeltLink(source="x", target="y")],
        b1="x",
        b3="y",
    )
    belts = plant(turn, feeder={"sequence": []})
    name = belts.add("red", "x", 0.3)
    belts.select({name: "anna"}, 0)
    go(belts, 7.8)  # 3.9 m: let into the zone on its way to bay 1, which ends before the turn
    belts.select({}, belts.now_ns)
    assert until_s(belts, name) == pytest.approx(8.0)
    go(belts, 0.1)
    belts.select({name: "anna"}, belts.now_ns)
    assert [(event.event, event.bay) for event in go(belts, 1.0)] == [("dispatched", "1")]


def test_way_round_prolongs_the_time_to_change_the_bay() -> None:
    belts = plant(SHIPPED, feeder={"sequence": []})
    name = belts.add("red", "part_e", 0.3)
    go(belts, 18.5)  # past the diverter of bay 1, before the junction that leads round
    until = until_s(belts, name)
    assert until is not None
    assert until > 18.5


def test_where_nothing_is_decided_there_is_no_limit() -> None:
    chain = plant(room(FORK.belts, FORK.links), feeder={"sequence": []})
    assert until_s(chain, chain.add("red", "main", 0.3)) is None  # no bays
    tail = plant(TAIL, feeder={"sequence": []})
    name = tail.add("red", "main", 0.3)
    assert until_s(tail, name) is None  # no bay of selected packages
    tail.select({name: "anna"}, 0)
    assert [event.event for event in go(tail, 20.0)] == ["dispatched"]


ROOMS: dict[str, tuple[Environment, tuple[str, ...]]] = {
    "fork": (FORK, ("main",)),
    "cross": (CROSS, ("w",)),
    "ring": (TWO_WAYS, ("in", "south")),
    "round": (ROUND, ("in",)),
    "shipped": (SHIPPED, ("part_e", "part_h")),
}


@pytest.mark.parametrize("where", sorted(ROOMS))
@pytest.mark.parametrize("is_selected", [False, True])
def test_a_change_is_in_time_until_the_very_moment_that_was_told_and_too_late_from_then_on(
    where: str, *, is_selected: bool
) -> None:
    environment, entries = ROOMS[where]
    belts = plant(environment, feeder={"sequence": []})
    other = plant(environment, feeder={"sequence": []})
    name = belts.add("red", entries[0], 0.3)
    before, after = ({name: "anna"}, {}) if is_selected else ({}, {name: "anna"})
    belts.select(before, 0)
    seen: set[bool] = set()

    def outcome(at_ns: int) -> list[tuple[str, bool]]:
        """Return the events of a change at `at_ns`, and True for each package that leaves at bay 1."""
        other.skip_time(belts.now_ns)
        other.restore(belts.snapshot())
        other.step(at_ns)
        other.select(after, at_ns)
        return [(e.event, e.bay == "1") for e in other.step(at_ns + 60 * S)]

    in_time, too_late = [("dispatched", not is_selected)], [("refused", False), ("dispatched", is_selected)]
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


@given(
    where=st.sampled_from(sorted(ROOMS)),
    steps=st.lists(
        st.tuples(st.sampled_from(["add", "toggle", "speed", "wait"]), st.integers(0, 99)),
        min_size=8,
        max_size=30,
    ),
)
def test_what_changes_in_time_leaves_by_its_bay_and_what_changes_too_late_does_not(
    where: str, steps: list[tuple[str, int]]
) -> None:
    environment, entries = ROOMS[where]
    belts = plant(environment, feeder={"sequence": []})
    owners: dict[str, str] = {}
    sent: dict[str, bool] = {}
    events: list[SelectionEvent] = []
    names: list[str] = []
    for deed, number in steps:
        if deed == "add" and number < 60:
            try:
                name = belts.add("red", entries[number % len(entries)], 0.3)
            except Exception:  # noqa: BLE001, S112 - another one is in the way
                continue
            names.append(name)
            sent[name] = False
        elif deed == "speed":
            belts.set_speed((0.0, 0.2, 0.5, 1.0)[number % 4])
        elif deed == "toggle" and names:
            name = names[number % len(names)]
            tracked = listed(belts, name)
            if tracked is None:
                continue
            until = tracked.bay_until_ns
            is_in_time = until is None or until > belts.now_ns
            if is_in_time:
                sent[name] = not sent[name]
            elif until == 0:
                was = owners.get(name)
                belts.select({n: u for n, u in owners.items() if n != name} | ({} if was else {name: "anna"}),
                             belts.now_ns)  # fmt: skip
                refused = belts.step(belts.now_ns)
                assert ("refused", name) in {(e.event, e.object_id) for e in refused}
            owners = {n: "anna" for n, is_sent in sent.items() if is_sent}
            belts.select(owners, belts.now_ns)
            events += belts.step(belts.now_ns)
        events += belts.step(belts.now_ns + STEP_NS * (1 + number % 50))
    belts.set_speed(0.5)
    events += belts.step(belts.now_ns + 90 * S)
    assert {e.event for e in events} <= {"dispatched"}
    assert {e.object_id: e.bay == "1" for e in events} == {
        n: sent[n] for n in sent if listed(belts, n) is None
    }
    assert all(bool(e.user) == (e.bay == "1") for e in events)
