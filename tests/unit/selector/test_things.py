"""Things of a room: pointing at them judged by method `estimate`; buttons, switches, presses."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import ButtonEvent, Cursor, Environment, Feedback, Hover, SelectionEvent, SetThing, Thing
from pointit.schemas.selection import RESTORED
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.roles import _done_message
from pointit.services.selector.seen_objects import MAX_SOLIDS, SeenObjects
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import OutgoingMessage
from tests.support import there
from tests.unit.selector.room import MAP, at, package, packages, pointing

EYES: Vec3 = (0.0, 0.0, 1.6)
RATE_HZ = 50


def thing(name: str, y_m: float = 0.0, **fields: Any) -> Thing:
    usual = {"id": name, "center_m": (2.6, y_m, 1.4), "size_m": (0.4, 0.4, 0.4)}
    return Thing.model_validate(usual | fields)


class Things:
    """An engine for a room with things, and people who point at directions."""

    def __init__(self, *things: Thing, **estimate: Any) -> None:
        config = SelectorConfig.model_validate({"method": "estimate", "estimate": estimate})
        self.engine = SelectionEngine(config, lambda _record: None)
        self.room = Environment(stamp_ns=0, name="room", things=things)
        self.time_s = 0.0
        self.events: list[SelectionEvent] = []
        self.hover = Hover(stamp_ns=0)
        self.unclear: list[tuple[str, str]] = []
        """People, and the cues that they get while nothing is selected."""

    def point(
        self, azimuth_deg: float, seconds: float = 2.0, user: str = "anna", *, turning: float = 0.0, **on: Any
    ) -> list[tuple[str, str]]:
        """Point to the left by `azimuth_deg`, turning by so many degrees a second. Return what happened."""
        before = len(self.events)
        for _ in range(round(seconds * RATE_HZ)):
            self.time_s += 1.0 / RATE_HZ
            azimuth_deg += turning / RATE_HZ
            now_ns = at(self.time_s)
            self.take(self.engine.on_objects(TRACKER, listing(self.room, now_ns)))
            ray = vector.direction(math.radians(azimuth_deg), math.radians(-4.4))
            self.take(
                self.engine.on_cursor(user, Cursor(stamp_ns=now_ns, origin_m=EYES, direction=ray, **on))
            )
            self.take(self.engine.tick(now_ns))
        return [(event.event, event.object_id) for event in self.events[before:]]

    def press(self, user: str = "anna", held_s: float = -0.1) -> list[tuple[str, str]]:
        before = len(self.events)
        event = ButtonEvent(stamp_ns=at(self.time_s - held_s), gesture="press")
        self.take(self.engine.on_button(user, event))
        return [(event.event, event.object_id) for event in self.events[before:]]

    def take(self, outputs: list[OutgoingMessage]) -> None:
        for output in outputs:
            if isinstance(output.message, SelectionEvent):
                self.events.append(output.message)
            elif isinstance(output.message, Hover):
                self.hover = output.message
            elif isinstance(output.message, Feedback) and output.message.cue == "refused":
                self.unclear.append((output.user, output.message.text))


def test_button_fires_once_for_each_pointing() -> None:
    room = Things(thing("screws"))
    assert room.point(0.0, 0.9) == []
    assert room.hover.object_id == "screws"
    assert room.hover.progress > 0.7
    assert room.point(0.0, 3.0) == [("selected", "screws"), ("deselected", "screws")]
    assert 0.59 < (room.events[1].stamp_ns - room.events[0].stamp_ns) / 1e9 < 0.65
    assert there(room.events[0].confidence) > 0.7
    assert room.point(60.0, 0.5) == []
    assert room.point(0.0, 3.0, "bert") == [("selected", "screws"), ("deselected", "screws")]
    undone = room.engine.undo("bert", at(room.time_s))
    cues = [output.message.text for output in undone if isinstance(output.message, Feedback)]
    assert cues == ["there is nothing to take back"]


def test_switch_is_on_until_any_person_switches_it_off() -> None:
    room = Things(thing("radio", mode="switch"))
    assert room.point(0.0, 3.0) == [("selected", "radio")]
    assert room.point(0.0, 0.5, "bert") == []
    assert (room.hover.action, room.hover.taken_by) == ("deselect", "")
    assert room.point(0.0, 2.5, "bert") == [("deselected", "radio")]


def test_shown_button_is_not_undone_by_the_next_person() -> None:
    room = Things(thing("kettle", press=True))
    for _ in range(100):
        room.point(0.0, 0.02)
        room.point(0.0, 0.02, "bert")
    assert room.press() == [("selected", "kettle")]
    assert room.press("bert") == []


def test_turned_box_is_hovered_at_its_orientation() -> None:
    across: dict[str, Any] = {"size_m": (0.2, 2.0, 0.2)}
    assert Things(thing("bar", **across)).point(12.0, 3.0)[:1] == [("selected", "bar")]
    assert Things(thing("bar", **across, yaw_rad=math.pi / 2)).point(12.0, 3.0) == []


def test_tracked_object_has_the_mode_of_the_map() -> None:
    def stay(name: str, seconds: float) -> None:
        for _ in range(round(5 * seconds)):
            listed = listing(Environment(stamp_ns=0, name="", things=(thing(name),)), at(room.time_s))
            claimed = listed.objects[0].model_copy(update={"mode": "claim"})
            room.engine.on_objects("camera", listed.model_copy(update={"objects": (claimed,)}))
            room.point(0.0, 0.2)

    room = Things()
    stay("cart", 3.0)
    assert [event.event for event in room.events] == ["selected"], "without the map, it is claimed by staying"

    room = Things()
    cart = thing("cart", is_tracked=True, mode="switch", press=True, label="the cart")
    room.engine.on_map(Environment(stamp_ns=0, name="room", things=(cart,)))
    stay("cart", 3.0)
    assert (room.events, room.hover.object_id) == ([], "cart")
    assert room.press() == [("selected", "cart")]
    assert room.events[-1].kind == "the cart"

    stay("other", 0.2)
    told = [
        output.message for output in room.engine.set_thing("anna", SetThing(thing="cart"), at(room.time_s))
    ]
    assert [each.text for each in told if isinstance(each, Feedback)] == [
        "no button or switch cart is placed"
    ]
    assert [one.id for one in room.engine.selection(at(room.time_s)).objects] == ["cart"]

    stay("other", 40.0)
    assert "cart" not in [one.id for one in room.engine.selection(at(room.time_s)).objects], "it has left"


def test_claimed_thing_stays_with_its_owner() -> None:
    room = Things(thing("crate", mode="claim"))
    assert room.point(0.0, 3.0) == [("selected", "crate")]
    assert room.point(0.0, 3.0, "bert") == [("refused", "crate")]
    assert package("red", 1.0).mode == "claim", "as packages do"


def test_press_selects_only_things_that_want_one() -> None:
    room = Things(thing("screws"))
    room.point(0.0, 0.5)
    assert room.press() == []


@pytest.mark.parametrize("held_s", [0.3, 0.7, 1.4])
def test_late_press_fires_and_shows_the_thing_of_its_start(held_s: float) -> None:
    room = Things(thing("kettle", press=True))
    room.point(0.0, 3.0)
    room.point(20.0, held_s - 0.1)
    assert room.press(held_s=held_s) == [("selected", "kettle")]
    assert room.point(20.0, 0.35) == [], "shown after the press came, too"
    assert room.point(20.0, 0.4) == [("deselected", "kettle")]


def test_thing_has_its_own_dwell_time() -> None:
    room = Things(thing("slow", dwell_s=2.5))
    assert room.point(0.0, 2.4) == []
    assert room.point(0.0, 0.5) == [("selected", "slow")]


@pytest.mark.parametrize("speed_deg_s", [15.0, 30.0, 90.0])
def test_passing_ray_fires_nothing(speed_deg_s: float) -> None:
    room = Things(*[thing(name, y_m) for name, y_m in zip("abc", (-0.7, 0.0, 0.7), strict=True)])
    assert room.point(-45.0, 90.0 / speed_deg_s, turning=speed_deg_s) == []


def test_light_decides_between_two_things() -> None:
    dark = Things(thing("a", 0.25, size_m=(0.2, 0.2, 0.2)), thing("b", -0.25, size_m=(0.2, 0.2, 0.2)))
    assert dark.point(0.3, 5.0) == []
    lit = {"size_m": (0.2, 0.2, 0.2), "lamp": "lamp"}
    room = Things(thing("a", 0.25, **lit), thing("b", -0.25, **lit))
    assert room.point(0.3, 3.0)[:1] == [("selected", "a")]
    assert Things(thing("a", 0.25, **lit), thing("b", -0.25, **lit)).point(40.0, 5.0) == []


def test_steady_cursor_on_a_strip_means_the_strip() -> None:
    on_strip: dict[str, Any] = {"surface": "strip", "surface_id": "s", "point_m": (2.6, 0.8, 1.4)}
    assert Things(thing("a", lamp="lamp")).point(13.0, 6.0, **on_strip) == []
    assert Things(thing("a", lamp="lamp")).point(8.0, 6.0)[:1] == [("selected", "a")]


def test_moving_package_is_selected_by_the_estimate() -> None:
    config = SelectorConfig.model_validate({"method": "estimate"})
    engine = SelectionEngine(config, lambda _record: None)
    engine.on_map(MAP)
    found: list[str] = []
    for index in range(150):
        time_s = index / RATE_HZ
        red = package("red", 3.0 + 0.3 * time_s, speed_mps=0.3)
        engine.on_objects("conveyor", packages(time_s, red, package("far", 9.0)))
        outputs = engine.on_cursor("anna", pointing(time_s, 3.0 + 0.3 * time_s))
        found += [each.message.object_id for each in outputs if isinstance(each.message, SelectionEvent)]
    assert found == ["red"]


@given(
    st.lists(st.tuples(st.floats(-3, 3), st.floats(0.01, 2.0)), min_size=1, max_size=5), st.floats(-60, 60)
)
def test_stated_confidence_is_a_probability(boxes: list[tuple[float, float]], azimuth_deg: float) -> None:
    room = Things(*[thing(f"t{i}", y, size_m=(w, w, w)) for i, (y, w) in enumerate(boxes)])
    room.point(azimuth_deg, 1.6)
    assert all(event.confidence is not None and 0.7 <= event.confidence <= 1.0 for event in room.events[:1])


@given(st.integers(0, 29))
def test_nearest_boxes_of_a_crowd_are_seen(aimed: int) -> None:
    row = tuple(thing(str(index), 0.02 * (index - 15)) for index in range(30))
    seen = SeenObjects(aim="ray")
    room = Environment(stamp_ns=0, name="room", things=row)
    seen.on_map(room)
    seen.update(TRACKER, listing(room, at(0.0)))
    ray = vector.subtract(row[aimed].center_m, EYES)
    length_m = math.hypot(*ray)
    x, y, z = (each / length_m for each in ray)
    view = there(seen.view_from(Cursor(stamp_ns=at(0.0), origin_m=EYES, direction=(x, y, z))))
    names = {int(each.id) for each in view.seen}
    assert len(names) == MAX_SOLIDS
    assert aimed in names
    assert max(abs(name - aimed) for name in names) <= MAX_SOLIDS, "neighbours"


def set_thing(room: Things, name: str, *, on: bool | None = None) -> tuple[list[str], list[str]]:
    """Return the events, and the texts of the cues."""
    outputs = room.engine.set_thing("home", SetThing(thing=name, on=on), at(room.time_s))
    messages = [output.message for output in outputs]
    events: list[str] = [each.event for each in messages if isinstance(each, SelectionEvent)]
    room.take(outputs)
    return events, [each.text for each in messages if isinstance(each, Feedback) and each.cue == "refused"]


def test_programs_switch_switches_and_fire_buttons() -> None:
    room = Things(thing("radio", mode="switch"), thing("screws", 1.0))
    room.point(80.0, 0.1)
    assert set_thing(room, "radio", on=True) == (["selected"], [])
    assert (
        _done_message(room.engine.set_thing("home", SetThing(thing="radio", on=False), at(room.time_s)))
        == "radio deselected"
    )

    set_thing(room, "radio", on=True)
    assert set_thing(room, "radio", on=True) == ([], [])
    assert set_thing(room, "radio") == (["deselected"], [])
    assert set_thing(room, "radio", on=False) == ([], [])
    assert set_thing(room, "screws") == (["selected"], [])
    assert set_thing(room, "screws") == ([], ["screws has just fired: try again in a second"])
    assert set_thing(room, "screws", on=False) == ([], ["screws is a button: it goes off by itself"])
    assert room.point(80.0, 1.0) == [("deselected", "screws")]
    assert set_thing(room, "screws", on=True) == (["selected"], [])


def test_event_of_a_restored_switch_has_the_reason() -> None:
    room = Things(thing("radio", mode="switch"))
    room.point(80.0, 0.1)
    query = SetThing(thing="radio", on=True, is_restored=True)
    told = [output.message for output in room.engine.set_thing("anna", query, at(room.time_s))]
    assert [each.reason for each in told if isinstance(each, SelectionEvent)] == [RESTORED]
    assert [one.id for one in room.engine.selection(at(room.time_s)).objects] == ["radio"]


def test_programs_change_no_owned_or_unknown_thing() -> None:
    room = Things(thing("seat", mode="claim"))
    room.point(80.0, 0.1)
    for name in ("seat", "nothing"):
        assert set_thing(room, name) == ([], [f"no button or switch {name} is placed"])


def test_pointing_person_does_not_undo_the_act_of_a_program() -> None:
    room = Things(thing("radio", mode="switch"))
    assert room.point(0.0, 3.0) == [("selected", "radio")]
    assert set_thing(room, "radio", on=False) == (["deselected"], [])
    assert room.point(0.0, 3.0) == []


def test_indistinguishable_things_are_named_repeatedly_and_do_not_fire() -> None:
    room = Things(thing("screws", 0.16, size_m=(0.2, 0.2, 0.2)), thing("nuts", -0.16, size_m=(0.2, 0.2, 0.2)))
    assert room.point(0.0, 2.0) == []
    assert room.unclear == []
    assert room.point(0.0, 10.0) == []
    texts = {text for _, text in room.unclear}
    assert len(texts) == 1
    assert texts.pop().startswith(("screws or nuts? ", "nuts or screws? "))
    assert len(room.unclear) == 2


def test_single_unsure_thing_has_no_rival() -> None:
    room = Things(thing("screws", 0.0), thing("nuts", 1.5))
    room.point(9.0, 10.0)
    assert room.unclear == []


def test_moved_thing_is_seen_at_its_new_place() -> None:
    room = Things(thing("screws"))
    assert room.point(0.0, 0.2) == []
    assert room.hover.object_id == "screws"
    room.room = room.room.model_copy(update={"things": (thing("screws", 2.6),)})
    room.point(0.0, 0.5)
    assert room.hover.object_id == ""
    assert room.point(45.0, 2.0)[:1] == [("selected", "screws")]


def test_moving_box_is_seen_at_the_time_of_the_ray() -> None:
    seen = SeenObjects(aim="ray")
    box = listing(Environment(stamp_ns=0, name="room", things=(thing("crate"),)), at(0.0))
    (crate,) = box.objects
    moving = crate.model_copy(update={"velocity_mps": (0.0, 1.0, 0.0)})
    seen.update(TRACKER, box.model_copy(update={"objects": (moving,)}))
    for time_s in (0.0, 0.4, 0.8):
        ray = vector.normalized(vector.subtract((2.6, time_s, 1.4), EYES))
        (one,) = there(seen.view_from(Cursor(stamp_ns=at(time_s), origin_m=EYES, direction=ray))).seen
        assert one.outline_m is None
        assert one.center_m == pytest.approx((2.6, time_s, 1.4))


def test_manner_names_things_that_want_a_press_among_those_present() -> None:
    def manner(*things: Thing, **config: Any) -> tuple[str, tuple[str, ...], int]:
        engine = SelectionEngine(
            SelectorConfig.model_validate({"method": "estimate", **config}), lambda _record: None
        )
        engine.on_objects(TRACKER, listing(Environment(stamp_ns=0, name="room", things=things), 0))
        told = engine.manner(0)
        return told.by, told.pressed, told.pressed_count

    screws = thing("screws")
    kettle = thing("kettle", 1.0, press=True, label="the kettle")
    assert manner() == ("stay", (), 0)
    assert manner(screws) == ("stay", (), 0)
    assert manner(screws, kettle) == ("stay", ("the kettle",), 1)
    assert manner(kettle) == ("press", (), 0)
    assert manner(screws, kettle, confirm="press") == ("press", (), 0)
    many = [thing(f"k{n}", 0.1 * n, press=True) for n in range(9)]
    assert manner(screws, *many) == ("stay", ("k0", "k1", "k2", "k3"), 9)


def test_manner_follows_the_map_before_its_things_are_tracked() -> None:
    engine = SelectionEngine(SelectorConfig(), lambda _record: None)
    things = (thing("screws"), thing("kettle", 1.0, press=True, label="the kettle"))
    engine.on_map(Environment(stamp_ns=0, name="room", things=things))
    told = engine.manner(0)
    assert (told.by, told.pressed, told.pressed_count) == ("stay", ("the kettle",), 1)


def test_manner_has_the_gesture_of_people_who_hear_names() -> None:
    for confirm, by in (("press", "press"), ("dwell", "stay")):
        room = Things(thing("screws"), announce={"people": ("anna",), "confirm": confirm})
        assert room.engine.manner(0).names_by is None, "nobody is there yet"
        room.point(0.0, 0.1)
        assert room.engine.manner(0).names_by == by
