"""Names of things that are spoken to people: when and in which order, presses, steps to neighbours."""

import math
from typing import Any, Literal

import pytest

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    Announced,
    ButtonEvent,
    Claim,
    Cursor,
    Environment,
    Feedback,
    SelectionEvent,
    Step,
    Thing,
)
from pointit.schemas.topics import ANNOUNCED, CURSOR, OBJECTS, STEP
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine, ShardEngine
from pointit.services.selector.selection_publisher import OutgoingMessage
from tests.support.bench import ManualClock
from tests.unit.selector.room import at
from tests.unit.selector.served import served

EYES: Vec3 = (0.0, 0.0, 1.6)
RATE_HZ = 50


def box(name: str, y_m: float, z_m: float = 1.4, label: str = "") -> Thing:
    return Thing(id=name, label=label, center_m=(2.6, y_m, z_m), size_m=(0.2, 0.2, 0.2))


SHELF = (
    box("left", 0.7),
    box("middle", 0.0, label="Middle box"),
    box("right", -0.7),
    box("below", -0.7, 0.8),
)


class Listener:
    """An engine, and a person to whom names are spoken."""

    engine: SelectionEngine | ShardEngine

    def __init__(
        self, *things: Thing, people: str = "anna", is_shard: bool = False, **announce: str | float
    ) -> None:
        method = {"method": "estimate", "estimate": {"announce": {"people": [people], **announce}}}
        if is_shard:
            self.engine = ShardEngine(SelectorConfig.model_validate({**method, "people": [people]}))
            self.engine.has_arbiter = True
        else:
            self.engine = SelectionEngine(SelectorConfig.model_validate(method), lambda _record: None)
        self.room = Environment(stamp_ns=0, name="room", things=things or SHELF)
        self.engine.on_map(self.room)
        self.time_s = 0.0
        self.can_step = False
        """True once a message has told that names are spoken to the person; it has no name itself."""
        self.announced: list[tuple[float, str, str]] = []
        """Times, s, ids and labels of later messages."""
        self.events: list[tuple[str, str]] = []
        self.claims: list[str] = []
        """Objects that a shard claims to toggle."""
        self.cues: list[str] = []

    def point(
        self, azimuth_deg: float, seconds: float, user: str = "anna", elevation_deg: float = -4.4
    ) -> None:
        ray = vector.direction(math.radians(azimuth_deg), math.radians(elevation_deg))
        for _ in range(round(seconds * RATE_HZ)):
            self.time_s += 1.0 / RATE_HZ
            now_ns = at(self.time_s)
            self.take(self.engine.on_objects(TRACKER, listing(self.room, now_ns)))
            self.take(self.engine.on_cursor(user, Cursor(stamp_ns=now_ns, origin_m=EYES, direction=ray)))

    def press(self, user: str = "anna") -> list[tuple[str, str]]:
        before = len(self.events)
        self.take(self.engine.on_button(user, ButtonEvent(stamp_ns=at(self.time_s))))
        return self.events[before:]

    def step(self, by: int, to: Literal["beside", "row", "here"] = "beside", user: str = "anna") -> str:
        """Step, and return what was announced at once."""
        before = len(self.announced)
        self.take(self.engine.on_step(user, Step(stamp_ns=at(self.time_s), by=1 if by > 0 else -1, to=to)))
        return self.announced[-1][1] if len(self.announced) > before else ""

    def take(self, outputs: list[OutgoingMessage]) -> None:
        for _, message in outputs:
            if isinstance(message, Announced):
                assert message.began_ns in {0, message.stamp_ns}
                if not self.can_step:
                    assert (message.object_id, message.label, message.began_ns) == ("", "", 0)
                    self.can_step = True
                    continue
                time_s = round((message.stamp_ns - at(0.0)) / 1e9, 3)
                self.announced.append((time_s, message.object_id, message.label))
            elif isinstance(message, SelectionEvent):
                self.events.append((message.event, message.object_id))
            elif isinstance(message, Claim) and message.wish == "toggle":
                self.claims.append(message.object_id)
            elif isinstance(message, Feedback) and message.cue == "refused":
                self.cues.append(message.text)


def test_name_is_spoken_twice_during_a_hover_which_selects_nothing() -> None:
    room = Listener()
    room.point(0.0, 6.0)
    (first_s, *first), (second_s, *second) = room.announced
    assert first == second == ["middle", "Middle box"]
    assert first_s == pytest.approx(0.22, abs=0.15)
    assert second_s - first_s == pytest.approx(1.5, abs=0.03)
    assert not room.events


def test_name_ends_when_the_hover_changes_and_the_next_follows() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    room.point(-15.0, 1.0)
    room.point(60.0, 1.0)
    assert [name for _, name, _ in room.announced] == ["middle", "", "right", ""]


def test_names_end_when_the_cursors_end() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    room.take(room.engine.tick(at(room.time_s + 0.9)))
    assert room.announced[-1][1] == "middle"
    room.take(room.engine.tick(at(room.time_s + 1.1)))
    assert room.announced[-1][1] == ""
    room.take(room.engine.tick(at(room.time_s + 1.7)))
    assert [name for _, name, _ in room.announced] == ["middle", ""]


def test_at_most_five_names_are_sent_in_a_second() -> None:
    room = Listener()
    for index in range(60):
        room.point(15.0 * (index % 3 - 1), 0.1)
        room.step(1 if index % 2 else -1)
    times = [time_s for time_s, _, _ in room.announced]
    assert len(times) > 10
    assert all(sum(since <= time < since + 1.0 - 1e-6 for time in times) <= 5 for since in times)


def test_unnamed_people_get_no_names_and_select_by_staying() -> None:
    room = Listener(people="bert")
    room.point(0.0, 2.0)
    assert not room.can_step
    assert not room.announced
    assert room.step(1) == ""
    assert room.events == [("selected", "middle")]
    assert not room.cues


@pytest.mark.parametrize("people", ["anna", "*"])
def test_names_are_spoken_to_the_named_people_or_all(people: str) -> None:
    room = Listener(people=people)
    room.point(0.0, 1.0)
    assert room.announced[0][1] == "middle"
    assert not room.events


@pytest.mark.parametrize("method", ["estimate", "gauge"])
def test_press_selects_the_thing_whose_name_could_be_understood(method: str) -> None:
    room = Listener()
    room.point(0.0, 0.1)
    room.engine.use(SelectorConfig(method=method))
    room.point(0.0, 0.5)
    assert room.press() == []
    assert room.cues == ["wait for the name"]
    room.point(0.0, 0.5)
    assert room.press() == [("selected", "middle")]


@pytest.mark.parametrize(
    ("announce", "moves", "is_confirmed"),
    [
        pytest.param({}, [(0.0, 1.2), (-15.0, 0.3)], True, id="the press moves the arm"),
        pytest.param({}, [(0.0, 1.2), (-15.0, 0.7)], False, id="long after the hover"),
        pytest.param(
            {}, [(0.0, 2.2), (-15.0, 0.3), (0.0, 1.3)], True, id="spoken again after the one beside it"
        ),
        pytest.param({"confirm_within_s": 10.0}, [(0.0, 8.0)], True, id="the time is a parameter"),
    ],
)
def test_press_confirms_a_name_that_was_spoken_in_time(
    announce: dict[str, Any], moves: list[tuple[float, float]], *, is_confirmed: bool
) -> None:
    room = Listener(**announce)
    for azimuth_deg, seconds in moves:
        room.point(azimuth_deg, seconds)
    assert room.press() == [("selected", "middle")] * is_confirmed
    assert room.cues == ["wait for the name"] * (not is_confirmed)


@pytest.mark.parametrize("is_stepping", [False, True])
@pytest.mark.parametrize("waits_s", [2.6, 30.0])
def test_late_press_repeats_the_name_and_the_next_one_confirms(
    waits_s: float,
    is_stepping: bool,
) -> None:
    room = Listener()
    room.point(0.0, 1.0)
    name = "right" if is_stepping else "middle"
    if is_stepping:
        assert room.step(1) == name
    room.point(0.0, waits_s)
    names = len(room.announced)
    assert room.press() == []
    assert room.cues == ["wait for the name"]
    room.point(0.0, 0.1)
    assert [each for _, each, _ in room.announced[names:]] == [name]
    room.point(0.0, 0.6)
    assert room.press() == [("selected", name)]
    assert len(room.announced) == names + 1


def test_focused_thing_is_announced_again_after_a_gap_without_cursors() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    assert room.step(1) == "right"
    room.point(0.0, 1.9)  # the name, and its repetition
    room.time_s += 0.6
    room.point(0.0, 0.9)
    assert [name for _, name, _ in room.announced] == ["middle", "right", "right", "right"]
    assert room.press() == [("selected", "right")]


def test_late_press_that_moves_the_arm_cuts_no_name_off() -> None:
    room = Listener()
    room.point(0.0, 4.0)
    room.point(-15.0, 0.1)
    while room.announced[-1][1] != "right":
        room.point(-15.0, 0.02)
    names = len(room.announced)
    assert room.press() == []
    room.point(-15.0, 0.7)
    assert len(room.announced) == names
    assert room.press() == [("selected", "right")]


def test_press_is_ignored_when_the_person_does_not_point() -> None:
    room = Listener()
    assert room.press() == []
    room.point(0.0, 1.2)
    room.time_s += 5.0
    assert room.press() == []
    assert not room.cues


def test_staying_selects_after_1_6_s_without_a_button() -> None:
    room = Listener(confirm="dwell")
    room.point(0.0, 1.4)
    assert not room.events
    room.point(0.0, 0.8)
    assert room.events == [("selected", "middle")]
    assert room.press() == []
    assert not room.cues


def test_steps_stop_at_both_ends_of_the_row() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    assert room.step(1) == "right"
    room.point(0.0, 0.3)
    assert room.step(1) == "right"  # spoken once more
    room.point(0.0, 0.3)
    assert room.step(-1) == "middle"
    room.point(0.0, 0.3)
    assert room.step(-1) == "left"
    room.point(0.0, 0.3)
    assert "below" not in {name for _, name, _ in room.announced}


def test_home_repeats_name_and_place_and_down_changes_the_row() -> None:
    room = Listener()
    room.point(-15.0, 1.0)
    assert room.step(1, "here") == "right"
    assert room.announced[-1][2] == "right, 3 of 3, upper row"
    room.point(-15.0, 2.0)
    assert room.announced[-1][2] == "right"  # as it is repeated
    for by, name in ((1, "below"), (1, "below"), (-1, "right")):
        assert room.step(by, "row") == name
        room.point(-15.0, 0.3)


def test_press_selects_the_focused_thing_once_its_name_is_understood() -> None:
    room = Listener()
    room.point(0.0, 2.0)
    room.step(1)
    room.point(0.0, 0.3)
    assert room.press() == []
    room.point(0.0, 0.5)
    assert room.press() == [("selected", "right")]


def test_focus_stays_until_the_ray_has_turned() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    room.step(1)
    room.point(10.0, 1.0)
    assert room.announced[-1][1] == "right"
    room.point(16.0, 1.0)
    assert room.announced[-1][1] == "left"


def test_step_from_nothing_leads_to_the_nearest_thing() -> None:
    room = Listener()
    assert not room.can_step
    room.point(40.0, 0.02)
    assert room.can_step
    room.point(40.0, 1.0)
    assert not room.announced
    assert room.step(1) == "left"


def test_person_is_announced_again_when_they_come_back() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    room.take(room.engine.tick(at(room.time_s + 1.1)))
    assert room.announced.pop()[1] == ""
    room.time_s += 1.5
    room.point(40.0, 0.5)
    assert [name for _, name, _ in room.announced] == ["middle", ""]
    assert room.step(1) == "left"


def test_steps_are_ignored_when_the_person_does_not_point() -> None:
    room = Listener()
    assert room.step(1) == ""
    room.point(0.0, 1.0)
    room.time_s += 3.0
    assert room.step(1) == ""


def test_stay_on_the_focused_thing_selects_once_after_2_2_s() -> None:
    room = Listener(confirm="dwell")
    room.point(0.0, 1.0)
    room.step(1)
    room.point(0.0, 2.1)
    assert not room.events
    room.point(0.0, 4.0)
    assert room.events == [("selected", "right")]


def test_names_are_spoken_again_after_a_wrist_clock_set_back() -> None:
    room = Listener()
    room.point(0.0, 1.0)
    room.time_s -= 10.0
    room.point(-15.0, 1.0)
    assert [name for _, name, _ in room.announced] == ["middle", "", "right"]


def test_shard_announces_steps_and_claims_pressed_things() -> None:
    room = Listener(is_shard=True)
    room.point(0.0, 1.2)
    assert room.step(1) == "right"
    room.point(0.0, 0.8)
    assert room.press() == []
    assert [name for _, name, _ in room.announced] == ["middle", "right"]
    assert room.claims == ["right"]


async def test_service_announces_names_and_receives_steps() -> None:
    clock = ManualClock()
    async with served(clock, method="estimate", estimate={"announce": {"people": ["anna"]}}) as site:
        announced = site.bench.collect(ANNOUNCED, "anna")
        ray = vector.direction(0.0, math.radians(-4.4))

        async def point(count: int) -> None:
            for _ in range(count):
                clock.advance(0.04)
                room = Environment(stamp_ns=0, name="room", things=SHELF)
                site.bench.put(OBJECTS, listing(room, clock.now_ns()), TRACKER)
                await site.bench.settle(3)
                site.bench.put(CURSOR, Cursor(stamp_ns=clock.now_ns(), origin_m=EYES, direction=ray), "anna")
                await site.bench.settle(3)

        await point(25)
        site.bench.put(STEP, Step(stamp_ns=clock.now_ns(), by=1), "anna")
        await site.bench.settle(3)
        assert [each.object_id for each in announced] == ["", "middle", "right"]
