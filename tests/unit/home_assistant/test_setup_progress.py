"""The cards of a home as a state machine."""

import math

import pytest

from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp, StoredSetup
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas.home import HomePlace

EYES_M = 1.6
SECOND_M = (0.2, 2.0)
LAMPS: dict[str, Vec3] = {
    "light.desk": (3.0, 0.5, 0.9),
    "light.shelf": (2.4, -1.6, 1.9),
    "light.door": (3.5, 2.4, 2.1),
}
CHOSEN = tuple(ChosenLamp(id=name, label=name.partition(".")[2]) for name in LAMPS)


def at_place() -> SetupProgress:
    progress = SetupProgress()
    progress.connect("http://127.0.0.1:8123")
    progress.on_connected()
    progress.choose(CHOSEN, tuple(LAMPS))
    progress.take_hand("phone", "anna")
    return progress


def killed(progress: SetupProgress) -> SetupProgress:
    """Return the progress that a new process restores from the stored state."""
    return SetupProgress(StoredSetup.model_validate_json(progress.state.model_dump_json()))


def point(
    progress: SetupProgress, lamp: str = "", *, zero_rad: float = 0.0, from_m: tuple[float, float] = (0, 0)
) -> str:
    """Press while pointing at a lamp, that of the card by default. Return its id."""
    assert progress.target is not None
    name = lamp or progress.target[0]
    x, y, z = LAMPS[name][0] - from_m[0], LAMPS[name][1] - from_m[1], LAMPS[name][2] - EYES_M
    progress.press(math.atan2(y, x) - zero_rad, math.atan2(z, math.hypot(x, y)), EYES_M)
    if progress.beside and lamp:
        progress.confirm()  # a person who insists on the wrong lamp
    return name


def place_all(progress: SetupProgress, zero_rad: float = 0.0) -> None:
    for _ in LAMPS:
        point(progress, zero_rad=zero_rad)
    progress.walk()
    for _ in LAMPS:
        point(progress, zero_rad=zero_rad, from_m=SECOND_M)


def assert_directions(progress: SetupProgress, limit_deg: float = 1.0) -> None:
    for placed in progress.state.placed:
        azimuth = math.atan2(placed.position_m[1], placed.position_m[0])
        known = math.atan2(LAMPS[placed.lamp][1], LAMPS[placed.lamp][0])
        assert abs(math.degrees(azimuth - known)) < limit_deg, placed.lamp


def test_five_steps_place_all_lamps() -> None:
    progress = at_place()
    place_all(progress)
    assert progress.is_complete

    progress.on_room(progress.fit())

    assert progress.state.step == "try"
    assert {each.lamp for each in progress.state.placed} == set(LAMPS)
    assert_directions(progress)
    assert progress.pose is not None, "the person stands at the second place"
    assert math.dist(progress.pose[0], SECOND_M) < 0.5


def test_killed_process_goes_on_at_each_step() -> None:
    progress = killed(SetupProgress())
    assert progress.state.step == "connect"
    progress.connect("http://127.0.0.1:8123")
    progress.on_connected()
    progress = killed(progress)
    assert progress.state.step == "choose"
    progress.choose(CHOSEN, tuple(LAMPS))
    progress = killed(progress)
    assert progress.state.step == "hand"
    progress.take_hand("phone", "anna")
    progress = killed(progress)
    assert progress.target == ("light.desk", "")
    point(progress)
    point(progress)

    progress = killed(progress)
    assert (progress.is_aligning, progress.place) == (True, "A")
    assert progress.target == ("light.shelf", ""), (
        "the arm has moved less before its press than before the first"
    )
    point(progress, zero_rad=2.0)
    assert progress.target == ("light.door", "")
    point(progress, zero_rad=2.0)
    progress.walk()
    for _ in LAMPS:
        point(progress, zero_rad=2.0, from_m=SECOND_M)
    progress.on_room(progress.fit())
    assert killed(progress).state.step == "try"
    assert_directions(progress, limit_deg=2.0)  # the zero was found by one press: 3.5° of standard deviation
    progress.finish()
    assert killed(progress).state.step == "done"


def test_new_yaw_zero_is_found_by_an_earlier_lamp() -> None:
    progress = at_place()
    progress.on_epoch(1)
    point(progress)
    progress.on_epoch(2)
    assert progress.is_aligning
    assert point(progress, zero_rad=-1.5) == "light.desk"
    assert not progress.is_aligning
    assert point(progress, zero_rad=-1.5) == "light.shelf"
    assert progress.state.presses[1].azimuth_rad == pytest.approx(math.atan2(-1.6, 2.4))


def test_new_yaw_zero_at_place_two_is_found_at_place_one() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    progress = killed(progress)
    assert progress.place == "A"
    point(progress, zero_rad=1.0)
    assert progress.place == "B"


def test_press_is_taken_back_across_the_walk() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    progress.take_back()
    assert (progress.place, progress.target) == ("A", ("light.door", ""))


def test_wrong_lamp_is_asked_for_once_more_then_left_out() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    for wrong in ("light.door", "light.desk", "light.door"):  # the shelf comes first there
        point(progress, wrong, from_m=SECOND_M)
    progress.on_room(progress.fit())
    assert progress.target == ("light.shelf", "")
    assert "was it another lamp" in progress.reasons["light.shelf"]

    point(progress, "light.door", from_m=SECOND_M)
    progress.on_room(progress.fit())
    assert progress.is_complete
    progress.on_room(progress.fit())
    assert set(progress.state.left_out) == {"light.shelf"}
    assert {each.lamp for each in progress.state.placed} == {"light.desk", "light.door"}


def test_right_lamp_after_a_wrong_press_is_placed() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    for wrong in ("light.door", "light.desk", "light.door"):  # the shelf comes first there
        point(progress, wrong, from_m=SECOND_M)
    progress.on_room(progress.fit())
    point(progress, from_m=SECOND_M)
    assert not progress.beside
    progress.on_room(progress.fit())
    assert not progress.state.left_out
    assert_directions(progress)


def test_lamps_at_the_second_place_come_as_they_stand() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    assert [point(progress, from_m=SECOND_M) for _ in LAMPS] == ["light.shelf", "light.desk", "light.door"]


def test_lamps_after_wide_movements_come_once_more_as_they_stand() -> None:
    progress = at_wide_room()
    first = [point_at(progress) for _ in WIDE_ROOM]
    assert first == list(WIDE_ROOM)
    assert progress.is_again
    assert not progress.may_walk

    again = [point_at(progress, error_deg=error_deg) for error_deg in (8.0, -8.0, 8.0, -8.0)]
    assert again == ["light.a", "light.c", "light.d", "light.b"], (
        "not light.e, which is near the one before it"
    )
    assert progress.may_walk
    assert len(killed(progress).state.presses) == 9


def test_person_who_points_well_repeats_three_lamps() -> None:
    progress = at_wide_room()
    for _ in WIDE_ROOM:
        point_at(progress)
    for _ in range(3):
        point_at(progress, error_deg=1.0)
    assert progress.may_walk
    progress.take_back()
    assert not progress.may_walk
    assert progress.target == ("light.d", "")


WIDE_ROOM = {"light.a": -80.0, "light.b": 60.0, "light.c": -50.0, "light.d": 5.0, "light.e": 40.0}
"""Azimuths, degrees."""


def at_wide_room() -> SetupProgress:
    progress = SetupProgress()
    progress.choose(tuple(ChosenLamp(id=name) for name in WIDE_ROOM), ())
    progress.take_hand("phone", "anna")
    return progress


def point_at(progress: SetupProgress, *, error_deg: float = 0.0) -> str:
    """Press while pointing at the lamp of the card, beside it by an error. Return its id."""
    assert progress.target is not None
    name, _ = progress.target
    progress.press(math.radians(WIDE_ROOM[name] + error_deg), 0.0, EYES_M)
    return name


def test_one_place_suffices_when_the_person_stays() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.stay()
    progress.on_room(progress.fit())
    assert progress.state.places_m == ((0.0, 0.0),)
    assert_directions(progress)


def test_mouse_gets_lamps_side_by_side() -> None:
    progress = at_place()
    progress.take_hand("mouse", "anna")
    assert progress.state.step == "try"
    azimuths = [math.atan2(each.position_m[1], each.position_m[0]) for each in progress.state.placed]
    assert azimuths == sorted(azimuths, reverse=True)


def test_heading_after_a_restart_is_found_by_a_placed_lamp() -> None:
    progress = at_place()
    place_all(progress)
    progress.on_room(progress.fit())
    progress.finish()

    progress = killed(progress)
    assert progress.is_aligning
    point(progress, zero_rad=0.7)
    assert progress.pose is not None
    assert progress.pose[1] == pytest.approx(0.7, abs=0.03)


def test_strip_is_placed_by_its_ends() -> None:
    progress = SetupProgress()
    progress.without_home()
    progress.choose([ChosenLamp(id="strip:shelf")], ("strip:shelf",))
    progress.take_hand("phone", "anna")
    assert progress.target == ("strip:shelf", "first")
    progress.press(0.3, 0.0, EYES_M)
    assert progress.target == ("strip:shelf", "last")


def test_placing_again_keeps_the_placed_lamps_until_it_is_complete() -> None:
    progress = at_place()
    place_all(progress)
    progress.on_room(progress.fit())
    progress.go("place")
    assert progress.target == ("light.desk", "")
    assert len(progress.state.placed) == len(LAMPS)


@pytest.mark.parametrize("act", ["walk", "stay", "take_back", "skip", "finish", "start_aligning"])
def test_act_at_the_wrong_time_is_refused_and_changes_nothing(act: str) -> None:
    progress = SetupProgress()
    before = progress.state
    with pytest.raises(RefusedError):
        getattr(progress, act)()
    assert progress.state == before


def test_step_is_refused_without_its_previous_steps() -> None:
    progress = SetupProgress()
    for step in ("hand", "place", "try", "done"):
        with pytest.raises(RefusedError):
            progress.go(step)
    progress.go("choose")


def test_second_press_without_moving_the_arm_asks_before_it_counts() -> None:
    progress = at_place()
    point(progress, "light.desk")
    x, y, z = LAMPS["light.desk"]
    desk = (math.atan2(y, x), math.atan2(z - EYES_M, math.hypot(x, y)))
    for _ in range(3):
        progress.press(*desk, EYES_M)
        assert (progress.beside, len(progress.state.presses)) == ("light.desk", 1)
    assert progress.target == ("light.shelf", "")
    assert point(progress) == "light.shelf", "a press elsewhere needs no answer"
    assert (progress.beside, len(progress.state.presses)) == ("", 2)


def test_lamp_right_beside_another_one_counts_when_the_person_says_so() -> None:
    progress = at_place()
    point(progress, "light.desk")
    progress.press(0.2, -0.2, EYES_M)
    progress.confirm()
    assert [press.lamp for press in progress.state.presses] == ["light.desk", "light.shelf"]
    with pytest.raises(RefusedError):
        progress.confirm()


def test_lamp_counts_when_the_arm_went_elsewhere_and_came_back() -> None:
    progress = at_place()
    point(progress, "light.desk")
    for _ in range(2):
        progress.press(0.17, -0.2, EYES_M)
        progress.on_arm((0.0, 1.0, 0.0))
    assert len(progress.state.presses) == 2


def test_wrong_earlier_press_is_replaced_and_its_lamp_comes_again() -> None:
    progress = at_place()
    progress.press(*press_angles("light.shelf"), EYES_M)  # at the turn of the desk
    progress.press(*press_angles("light.shelf"), EYES_M)
    progress.replace_beside()
    assert [press.lamp for press in progress.state.presses] == ["light.shelf"]
    assert progress.target == ("light.desk", "")


def press_angles(lamp: str) -> tuple[float, float]:
    """Return azimuth and elevation of a lamp as seen from the first place."""
    x, y, z = LAMPS[lamp]
    return math.atan2(y, x), math.atan2(z - EYES_M, math.hypot(x, y))


@pytest.mark.parametrize("place", ["A", "B"])
def test_one_placed_lamp_is_pointed_at_again_from_either_place(place: HomePlace) -> None:
    progress = at_place()
    place_all(progress)
    progress.on_room(progress.fit())
    assert progress.state.step == "try"

    progress.repeat("light.desk", place)
    assert (progress.state.step, progress.place, progress.target) == ("place", place, ("light.desk", ""))
    point(progress, from_m=(0.0, 0.0) if place == "A" else SECOND_M)
    assert progress.is_complete, "nothing else comes again"
    progress.on_room(progress.fit())
    assert progress.state.step == "try"
    assert_directions(progress, limit_deg=2.0)


def test_lamp_is_not_repeated_from_where_nobody_has_pointed() -> None:
    progress = at_place()
    with pytest.raises(RefusedError):
        progress.repeat("light.desk", "A")
    point(progress)
    with pytest.raises(RefusedError):
        progress.repeat("light.desk", "B")
    with pytest.raises(RefusedError):
        progress.repeat("light.none", "A")


def test_walk_of_less_than_a_step_is_noticed_and_made_again() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    for _ in LAMPS:
        point(progress, from_m=(0.05, 0.2))
    progress.on_room(progress.fit())
    assert (progress.state.step, progress.state.is_short_walk, progress.target) == ("place", True, None)

    progress.walk()
    assert not progress.state.is_short_walk
    for _ in LAMPS:
        point(progress, from_m=SECOND_M)
    progress.on_room(progress.fit())
    assert progress.state.step == "try"
    assert_directions(progress)


def test_person_may_stay_after_less_than_a_step() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    for _ in LAMPS:
        point(progress, from_m=(0.05, 0.2))
    progress.on_room(progress.fit())
    progress.stay()
    progress.on_room(progress.fit())
    assert (progress.state.step, progress.state.places_m) == ("try", ((0.0, 0.0),))


def test_lamps_are_tried_in_turn_and_exchanged_or_pointed_at_again() -> None:
    progress = at_place()
    place_all(progress)
    progress.on_room(progress.fit())
    assert progress.tried_lamp == "light.desk"
    progress.meet()
    assert progress.tried_lamp == "light.shelf"
    before = {placed.lamp: placed.position_m for placed in progress.state.placed}
    progress.correct("light.door")
    after = {placed.lamp: placed.position_m for placed in progress.state.placed}
    assert (after["light.shelf"], after["light.door"]) == (before["light.door"], before["light.shelf"])
    assert progress.tried_lamp == "light.shelf", "it is tried at its new place"
    progress.skip()
    assert progress.tried_lamp == "light.door"
    progress.correct("")
    assert (progress.state.step, progress.target) == ("place", ("light.door", ""))


def test_presses_that_look_exchanged_name_both_lamps() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    progress.walk()
    others = {"light.desk": "light.shelf", "light.shelf": "light.desk"}
    for _ in LAMPS:
        assert progress.target is not None
        name = progress.target[0]
        point(progress, others.get(name, name), from_m=SECOND_M)
    progress.on_room(progress.fit())
    assert progress.reasons["light.desk"] == "its presses and those at shelf look exchanged"
    assert progress.reasons["light.shelf"] == "its presses and those at desk look exchanged"
