"""The interaction's life cycle: its ways by example."""

import runpy
from pathlib import Path

import pytest

from pointit.schemas import SelectionManner
from pointit.services.supervisor import transitions
from pointit.services.supervisor.transitions import TABLE
from tests.unit.supervisor import played
from tests.unit.supervisor.played import S, life_cycle, localizing, news, pose, press, sample, shown, told


def test_button_starts_and_stops_pointing_when_the_pose_is_known() -> None:
    cycle = life_cycle()
    assert shown(cycle.begin(0)).next_step == transitions.SET_POSE
    assert shown(cycle.pose(*pose())).next_step == transitions.PRESS
    assert told(cycle.button(*press(1))) == ["pointing", "cue started"]
    assert told(cycle.button(*press(2))) == ["idle", "cue stopped"]
    assert told(cycle.button(*press(3))) == ["pointing", "cue started"]


def test_press_stays_idle_and_shows_the_remedy_without_a_pose() -> None:
    cycle = life_cycle()
    cycle.begin(0)
    outputs = cycle.button(*press(1))
    assert told(outputs) == ["idle", "cue refused"]
    assert shown(outputs).reason == transitions.NO_POSE
    assert "set_pose" in shown(outputs).next_step


def test_localizing_leads_through_the_targets_to_pointing() -> None:
    cycle = life_cycle(localize=True)
    assert shown(cycle.begin(0)).next_step == transitions.PRESS_FOR_LAMP
    outputs = cycle.button(*press(10))
    assert told(outputs) == ["start", "localizing", "cue started"]
    assert shown(outputs).next_step == transitions.WAIT

    cycle.on_start_accepted(cycle.run)
    for index, lamp in enumerate(("led_0", "led_1")):
        sampling = {"target_id": lamp, "target_index": index, "target_count": 2}
        outputs = cycle.localization(*news(11 + index, "sampling", **sampling))
        assert told(outputs) == ["localizing", "cue target"]
        assert shown(outputs).next_step == f"Point at {lamp} and stay on it ({index + 1} of 2)."
        assert cycle.localization(*news(11.5 + index, "sampling", samples=20, **sampling)) == []
    assert cycle.pose(*pose(13)) == []
    assert told(cycle.localization(*news(13, "solved"))) == ["cue localized", "pointing", "cue started"]
    assert told(cycle.button(*press(20))) == ["idle", "cue stopped"]
    assert told(cycle.button(*press(21))) == ["pointing", "cue started"]  # the place is known now


def test_cancelled_start_is_cancelled_again_when_answered_late() -> None:
    cycle = life_cycle(localize=True)
    cycle.begin(0)
    cycle.button(*press(10))
    run = cycle.run
    cycle.button(*press(11))
    assert cycle.run != run  # by which one that is not sent yet is known to be called off
    assert told(cycle.on_start_accepted(run)) == ["cancel"]


def test_hold_rests_from_anywhere_and_localizes_anew_from_there() -> None:
    cycle = life_cycle(localize=True)
    cycle.begin(0)
    cycle.pose(*pose())
    assert told(cycle.button(*press(1))) == ["pointing", "cue started"]
    assert told(cycle.button(*press(2, "hold"))) == ["idle", "cue stopped"]
    assert told(cycle.button(*press(3, "hold"))) == ["start", "localizing", "cue started"]
    assert told(cycle.button(*press(4, "hold"))) == ["cancel", "idle", "cue stopped"]
    known = life_cycle()
    known.pose(*pose())
    assert told(known.button(*press(1, "hold"))) == ["pointing", "cue started"]


def test_hold_alone_ends_pointing_when_a_press_confirms() -> None:
    cycle = life_cycle(localize=True, press_while_pointing="confirms")
    cycle.begin(0)
    assert told(cycle.button(*press(1))) == ["start", "localizing", "cue started"]
    assert told(cycle.button(*press(2))) == ["cancel", "idle", "cue stopped"]
    cycle.pose(*pose())
    assert shown(cycle.button(*press(3))).next_step == transitions.POINT_AND_CONFIRM
    assert cycle.button(*press(4)) == []
    assert cycle.state == "pointing"
    assert told(cycle.button(*press(5, "hold"))) == ["idle", "cue stopped"]


def test_relocalizing_each_time_asks_again_though_the_place_is_known() -> None:
    cycle = life_cycle(localize=True, relocalize_each_time=True)
    cycle.begin(0)
    cycle.pose(*pose())
    assert told(cycle.button(*press(1)))[:2] == ["start", "localizing"]
    cycle.localization(*news(3, "solved"))
    cycle.button(*press(4))
    assert told(cycle.button(*press(5)))[:2] == ["start", "localizing"]


def test_restarted_localizer_gets_the_request_again_until_the_timeout() -> None:
    cycle = localizing()
    first = cycle.run
    outputs = cycle.localization(*news(20, "idle"))
    assert told(outputs) == ["start", "localizing"]
    assert cycle.run == first + 1
    assert cycle.on_start_failed(first, "too late", 20 * S) == []
    assert cycle.localization(*news(20, "idle")) == []
    cycle.on_start_accepted(cycle.run)
    assert cycle.localization(*news(21, "sampling", target_id="led_0")) != []
    cycle.imu(*sample(69))
    outputs = cycle.tick(70 * S)
    assert told(outputs) == ["cancel", "idle", "cue refused"]
    assert shown(outputs).reason == transitions.too_long(60.0)


def test_forty_lamps_may_take_longer_than_one() -> None:
    cycle = localizing()
    now_s = 10.0
    for index in range(40):
        now_s += 3.0
        cycle.imu(*sample(now_s))
        sampling = {"target_id": f"led_{index}", "target_index": index, "target_count": 40}
        cycle.localization(*news(now_s, "sampling", **sampling))
        assert cycle.tick(round(now_s * S)) == []
    cycle.imu(*sample(now_s + 59))
    assert cycle.tick(round((now_s + 59) * S)) == []
    cycle.localization(*news(now_s + 59, "sampling", target_id="led_0", target_count=40))  # back: no progress
    assert told(cycle.tick(round((now_s + 60) * S))) == ["cancel", "idle", "cue refused"]


def test_idle_localizer_after_a_new_pose_is_a_success() -> None:
    cycle = localizing()
    cycle.pose(*pose(15))
    assert told(cycle.localization(*news(15, "idle"))) == ["cue localized", "pointing", "cue started"]


def test_silent_wrist_ends_localizing_before_the_timeout() -> None:
    cycle = localizing()
    assert cycle.deadline_ns == 13 * S
    outputs = cycle.tick(13 * S)
    assert told(outputs) == ["cancel", "idle", "cue refused"]
    assert "Is the wristband on" in shown(outputs).reason


DOCS = Path(__file__).parents[3] / "docs"


def test_document_shows_the_table_of_transitions() -> None:
    page = runpy.run_path(str(DOCS / "pictures/life_cycle.py"))["page"]
    is_same = (DOCS / "explanation/life_cycle.md").read_text(encoding="utf-8") == page()
    assert is_same, "run: python docs/pictures/life_cycle.py"


def test_rows_of_the_table_are_all_reachable() -> None:
    for stage, rows in TABLE.items():
        for index, row in enumerate(rows):
            for event in row.events:
                before = [other for other in rows[:index] if event in other.events]
                assert not any(set(other.conditions) <= set(row.conditions) for other in before), (stage, row)


def test_attempts_can_be_ended_by_the_person_and_time_out() -> None:
    for stage, rows in TABLE.items():
        leaving = {event for row in rows if row.then in ("idle", "before") for event in row.events}
        if stage not in ("idle", "pointing"):
            assert leaving >= {"press", "double", "hold", "silent", "timeout"}


@pytest.mark.parametrize(
    ("manner", "press", "step"),
    [
        ({"by": "press"}, "confirm", transitions.POINT_AND_CONFIRM),
        ({"by": "stay"}, "", transitions.STAY),
        (
            {"by": "stay", "pressed": ("kettle",), "pressed_count": 1},
            "confirm",
            "For kettle, press the button.",
        ),
        (
            {"by": "stay", "pressed": ("a", "b"), "pressed_count": 5},
            "confirm",
            "For a, b and 3 more, press the button.",
        ),
    ],
)
def test_next_step_and_press_follow_the_manner_of_selection(
    manner: dict[str, object], press: str, step: str
) -> None:
    cycle = life_cycle(press_while_pointing="confirms")
    cycle.begin(0)
    assert shown(cycle.pose(*pose())).press == "start"

    begun = shown(cycle.button(*played.press(1)))
    assert (begun.next_step, begun.press) == (transitions.POINT_AND_CONFIRM, "confirm"), "without a selector"
    outputs = cycle.manner(SelectionManner.model_validate({"stamp_ns": 0, **manner}), 2 * S)
    now = shown(outputs) if outputs else begun
    assert step in now.next_step
    assert now.press == press

    named = {**manner, "names_by": "press"}
    cycle.manner(SelectionManner.model_validate({"stamp_ns": 0, **named}), 3 * S)
    heard = shown(cycle.hear_names(4 * S))
    assert (heard.next_step, heard.press) == (transitions.PRESS_AT_NAME, "confirm")

    ending = life_cycle()
    ending.pose(*pose())
    assert shown(ending.button(*played.press(1))).press == "stop"
    assert ending.manner(SelectionManner.model_validate({"stamp_ns": 0, **manner}), 2 * S) == []


def test_advice_is_the_next_step_while_the_person_points() -> None:
    cycle = life_cycle(press_while_pointing="confirms")
    cycle.pose(*pose())
    assert cycle.advise("Press to take the box.", 1 * S)[:1] == []
    begun = shown(cycle.button(*played.press(1)))
    assert (begun.next_step, begun.is_advised) == ("Press to take the box.", True)
    other = shown(cycle.advise("Press to put it down.", 2 * S))
    assert (other.next_step, other.is_advised, other.press) == ("Press to put it down.", True, "confirm")
    rests = shown(cycle.button(*played.press(3, "hold")))
    assert (rests.next_step, rests.is_advised) == (transitions.PRESS, False)


def test_advice_ends_with_its_service_and_the_previous_returns() -> None:
    cycle = life_cycle(press_while_pointing="confirms")
    cycle.pose(*pose())
    cycle.button(*played.press(1))
    cycle.advise("Press to take the box.", 2 * S, "arm")
    cycle.advise("Press to open the door.", 2 * S, "door")

    ended = shown(cycle.end_advice("door", 3 * S))
    assert (ended.next_step, ended.is_advised) == ("Press to take the box.", True)

    assert cycle.end_advice("arm", 4 * S, "of earlier") == [], "it says something else by now"
    taken_back = shown(cycle.end_advice("arm", 4 * S, "Press to take the box."))
    assert (taken_back.next_step, taken_back.is_advised) == (transitions.POINT_AND_CONFIRM, False)

    assert cycle.end_advice("nobody", 5 * S) == []
