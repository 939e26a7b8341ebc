"""The person's next step in the set-up of a home: one sentence for card and phone, with its choices."""

from pointit.bridges.home_assistant.setup.next_step import MAX_TEXT, NextStep, next_step
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp
from tests.unit.home_assistant.test_setup_progress import LAMPS, SECOND_M, at_place, place_all, point


def shown(progress: SetupProgress, *, is_lit: bool = False, is_waiting: bool = False) -> NextStep:
    step = next_step(progress, is_lit=is_lit, goes_off=False, is_waiting=is_waiting)
    assert step is not None
    return step


def ids(step: NextStep) -> list[str]:
    return [choice.id for choice in step.choices]


def test_turn_names_the_lamp_its_number_and_its_light() -> None:
    progress = at_place()
    step = shown(progress, is_lit=True)
    assert step.text == (
        "Stand where you will point from most. "
        "Point at desk (1 of 3), which is lit, with a straight arm, and press."
    )
    assert ids(step) == ["skip"]
    point(progress)
    step = shown(progress)
    assert step.text == "Point at shelf (2 of 3), with a straight arm, and press."
    assert ids(step) == ["skip", "take_back"]


def test_press_where_another_lamp_was_pressed_asks_about_both() -> None:
    progress = at_place()
    point(progress)
    progress.press(0.17, -0.2, 1.6)
    step = shown(progress)
    assert (
        step.text == "You pointed there for desk. Point elsewhere, then at shelf. Or is it right beside desk?"
    )
    assert ids(step) == ["beside", "mistaken"]
    assert [choice.label for choice in step.choices] == ["Right beside it", "desk was wrong"]


def test_walk_is_asked_for_with_its_choices() -> None:
    progress = at_place()
    for _ in LAMPS:
        point(progress)
    step = shown(progress)
    assert step.text.startswith("Walk about two metres to your left")
    assert ids(step) == ["walk", "stay", "take_back"]
    progress.walk()
    for _ in LAMPS:
        point(progress, from_m=(0.0, 0.2))
    progress.on_room(progress.fit())
    assert shown(progress).text.startswith("That was less than a step")


def test_home_that_does_not_answer_is_waited_for() -> None:
    assert shown(at_place(), is_waiting=True) == NextStep(
        "Wait: your home does not answer. It goes on by itself."
    )


def test_lamps_are_tried_until_the_home_is_ready() -> None:
    progress = at_place()
    place_all(progress)
    progress.on_room(progress.fit())
    for name in ("desk", "shelf", "door"):
        step = shown(progress)
        assert step.text == f"Point elsewhere, then at {name}, and stay on it. Did it switch?"
        assert ids(step) == ["met", "other", "skip"]
        progress.meet()
    assert ids(shown(progress)) == ["finish"]


def test_changed_zero_is_found_at_a_place_by_a_lamp() -> None:
    progress = at_place()
    progress.on_epoch(1)
    place_all(progress)
    progress.on_epoch(2)
    step = shown(progress)
    assert step.text.startswith("Stand at your second place. Point at ")
    assert SECOND_M


def test_long_names_leave_room_for_the_sentence() -> None:
    progress = SetupProgress()
    progress.choose([ChosenLamp(id="light.a", label="Lamp " * 40)], ())
    progress.take_hand("phone", "anna")
    assert len(shown(progress).text) <= MAX_TEXT


def test_cards_without_an_arm_have_no_next_step() -> None:
    assert next_step(SetupProgress(), is_lit=False, goes_off=False, is_waiting=False) is None
