"""Selecting by pointing: the three methods, confirmation, what is shown, times that are odd."""

import pytest

from pointit.schemas import ButtonEvent
from tests.unit.selector.room import Room, at, package, pointing

METHODS = ("gauge", "hold", "fraction")


@pytest.mark.parametrize("method", METHODS)
def test_cursors_farther_apart_than_the_longest_gap_select_nothing(method: str) -> None:
    room = Room(package("a", 5.0), method=method, longest_gap_s=0.05)
    room.stay(3.0, 5.0, anna=5.0)
    assert room.told == []


@pytest.mark.parametrize(
    ("method", "after_s", "rate_hz"), [("gauge", 0.5, 25.0), ("hold", 0.8, 100.0), ("fraction", 0.8, 25.0)]
)
def test_staying_selects_once_and_coming_back_deselects(method: str, after_s: float, rate_hz: float) -> None:
    room = Room(package("a", 5.0), method=method)
    room.stay(5.0, rate_hz, anna=5.0)
    assert room.told == [("selected", "a", "anna")]
    assert (room.events[0].stamp_ns - at(0)) / 1e9 == pytest.approx(after_s, abs=0.14)
    assert room.owners == {"a": "anna"}
    room.stay(1.0, rate_hz, anna=8.0)
    room.stay(3.0, rate_hz, anna=5.0)
    assert room.told[1:] == [("deselected", "a", "anna")]
    assert room.owners == {}
    assert [(event.cause, event.kind) for event in room.events] == [("dwell", "red")] * 2


def test_sweeping_over_objects_selects_nothing() -> None:
    room = Room(*(package(str(x), float(x)) for x in range(1, 10)))
    room.stay(8.0, 100.0, anna=lambda time_s: 1.0 + time_s)  # 1 m/s, up to 18 degrees/s
    touched = {hover.object_id for hover in room.hovers["anna"]}
    assert len(touched) == 10  # nine objects, and none
    assert room.events == []


def test_slow_sweep_over_a_long_object_selects_nothing() -> None:
    turning = Room(package("a", 5.0, length_m=3.0))
    passed = Room(package("a", 3.9, speed_mps=1.0, length_m=3.0))
    turning.stay(2.2, 100.0, anna=lambda time_s: 3.9 + time_s)
    passed.stay(2.2, 100.0, anna=5.0)  # the object moves under a ray at rest
    for room in (turning, passed):
        assert {hover.object_id for hover in room.hovers["anna"]} == {"a"}
        assert room.events == []
    resting = Room(package("a", 5.0, length_m=3.0))
    resting.stay(1.0, 100.0, anna=5.0)
    assert resting.told == [("selected", "a", "anna")]


@pytest.mark.parametrize("speed_mps", [0.3, 1.0, 2.0])
def test_moving_object_is_selected_only_by_following_it(speed_mps: float) -> None:
    room = Room(package("a", 3.0, speed_mps=speed_mps))
    room.stay(1.5, 100.0, anna=lambda time_s: 3.0 + speed_mps * time_s, ben=4.0)
    assert room.told == [("selected", "a", "anna")]


@pytest.mark.parametrize("method", METHODS)
def test_progress_is_shown_after_a_moment_and_rises(method: str) -> None:
    room = Room(package("a", 5.0), method=method)
    room.stay(0.45, 100.0, anna=5.0)
    hovers = room.hovers["anna"]
    assert {hover.object_id for hover in hovers} == {"a"}
    early = [hover.progress for hover in hovers if hover.stamp_ns < at(0.14)]
    assert set(early) == {0.0}
    progress = [hover.progress for hover in hovers]
    assert progress == sorted(progress)
    assert progress[-1] > 0.3
    assert {hover.action for hover in hovers} == {"select"}


def test_hover_has_all_fields() -> None:
    room = Room(package("a", 5.0))
    room.stay(1.0, 100.0, anna=5.16)
    room.stay(1.0, 100.0, ben=5.16)
    mine = room.hovers["anna"][-1]
    other = room.hovers["ben"][-1]
    assert (mine.object_id, mine.is_selected, mine.action, mine.taken_by) == ("a", True, "", "")
    assert mine.snapped_position_m == pytest.approx(5.15)
    assert mine.snapped_m == pytest.approx((5.15, 0.0, 0.9))
    assert mine.miss_rad is not None
    assert 0.0 < mine.miss_rad < 0.02
    assert (other.taken_by, other.is_selected) == ("anna", True)
    assert room.hovers["ben"][20].action == "refuse"


@pytest.mark.parametrize("method", METHODS)
def test_staying_deselects_nothing_in_select_only_mode(method: str) -> None:
    room = Room(package("a", 5.0), method=method, mode="select_only")
    room.stay(2.0, 50.0, anna=5.0)
    room.stay(2.0, 50.0, anna=8.0)
    room.stay(2.0, 50.0, anna=5.0)
    assert room.told == [("selected", "a", "anna")]
    assert room.hovers["anna"][-1].action == ""
    assert room.hovers["anna"][-1].progress == 0.0
    assert [
        event.event for event in (room.take(room.selecting.clear("anna", room.now_ns)), room.events)[1]
    ] == ["selected", "deselected"]


def press(room: Room, user: str, time_s: float, gesture: str = "press") -> None:
    button = ButtonEvent.model_validate({"stamp_ns": at(time_s), "gesture": gesture})
    room.take(room.selecting.on_button(user, button))


@pytest.mark.parametrize("method", METHODS)
def test_only_a_press_selects_the_object_hovered_before_with_confirmation(method: str) -> None:
    room = Room(package("a", 5.0), package("b", 6.0), method=method, confirm="press")
    room.stay(2.0, 100.0, anna=5.0)
    assert room.events == []
    assert room.hovers["anna"][-1].progress == 1.0  # ready

    room.stay(0.1, 100.0, anna=6.0)  # the click moved the arm
    press(room, "anna", room.time_s)
    assert room.told == [("selected", "a", "anna")]
    assert room.events[0].cause == "button"

    press(room, "anna", room.time_s)  # the same press again
    assert len(room.events) == 1
    room.stay(1.0, 100.0, anna=6.0)
    press(room, "anna", room.time_s, "double")
    assert len(room.events) == 1

    press(room, "anna", room.time_s)
    assert room.told[1:] == [("selected", "b", "anna")]


def test_slow_devices_press_counts_after_one_of_a_quick_device() -> None:
    room = Room(package("a", 5.0), package("b", 6.0), confirm="press")
    room.stay(1.0, 100.0, anna=5.0)
    slow_s = room.time_s
    room.stay(1.0, 100.0, anna=6.0)
    for _ in range(2):
        press(room, "anna", room.time_s)
        press(room, "anna", slow_s)
    assert room.told == [("selected", "b", "anna"), ("selected", "a", "anna")]


@pytest.mark.parametrize("method", METHODS)
def test_late_and_duplicate_cursors_are_ignored(method: str) -> None:
    plain = Room(package("a", 5.0), method=method)
    plain.stay(1.2, 50.0, anna=5.0)
    odd = Room(package("a", 5.0), method=method)
    for step in range(1, 61):
        odd.time_s = step / 50
        odd.list_objects()
        for late_s, x_m in ((0.0, 5.0), (0.0, 9.0), (0.1, 9.0), (1.9, 9.0)):
            odd.take(odd.selecting.on_cursor("anna", pointing(odd.time_s - late_s, x_m)))
    assert odd.events == plain.events
    assert len(odd.events) == 1


@pytest.mark.parametrize("method", METHODS)
def test_cursors_start_again_when_the_clock_is_set_back(method: str) -> None:
    room = Room(package("a", 5.0), method=method)
    room.stay(0.45, 50.0, anna=5.0)
    room.time_s = -100.0
    room.stay(0.4, 50.0, anna=5.0)
    assert room.events == []
    room.stay(1.0, 50.0, anna=5.0)
    assert room.told == [("selected", "a", "anna")]


def test_stamp_from_the_future_delays_nobody() -> None:
    room = Room(package("a", 5.0))
    room.stay(0.2, 50.0, anna=5.0)
    room.take(room.selecting.on_cursor("anna", pointing(3600.0, 5.0)))
    room.stay(1.5, 50.0, anna=5.0)
    assert room.told == [("selected", "a", "anna")]


@pytest.mark.parametrize("method", METHODS)
def test_cursor_without_a_ray_is_tested_by_distance(method: str) -> None:
    room = Room(package("a", 5.0), method=method)
    for step in range(1, 61):
        room.time_s = step / 50
        room.list_objects()
        bare = pointing(room.time_s, 5.1).model_copy(update={"origin_m": None, "direction": None})
        room.take(room.selecting.on_cursor("anna", bare))
    assert room.told == [("selected", "a", "anna")]
    assert room.events[0].confidence is None
    assert room.hovers["anna"][-1].miss_rad is None
