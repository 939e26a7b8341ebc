"""The queue for lamps by example: messages of others, and the order that follows."""

import pytest

from pointit.schemas import Localization
from pointit.services.localizer.procedures.lamp_queue import MAX_HEARD, LampQueue

LAMPS = ("led_0", "led_1")
S = 1_000_000_000


def news(phase: str, since_ns: int, target_id: str = "led_0", ahead: tuple[str, ...] = ()) -> Localization:
    return Localization.model_validate(
        {
            "stamp_ns": 1,
            "phase": phase,
            "target_id": "" if ahead or phase != "sampling" else target_id,
            "since_ns": since_ns,
            "ahead": ahead,
        }
    )


def test_the_fresh_who_point_at_these_lamps_count() -> None:
    turns = LampQueue()
    assert not turns.on_localization("ben", news("sampling", 7), 100 * S)
    turns.on_localization("anna", news("sampling", 7), 101 * S)
    turns.on_localization("carl", news("sampling", 3, "robot"), 101 * S)
    assert turns.pointing(LAMPS, 102 * S) == [(7, "anna"), (7, "ben")]
    assert turns.pointing(LAMPS, 103 * S) == [(7, "anna")]  # nothing was heard of ben for too long
    assert turns.pointing(LAMPS, 90 * S) == []  # the clock was set back
    assert turns.on_localization("anna", news("solved", 7), 103 * S)
    assert not turns.on_localization("anna", news("solved", 7), 103 * S)
    assert turns.pointing(LAMPS, 103 * S) == []


def test_who_once_pointed_at_one_of_the_lamps_in_this_localization_has_it_until_the_end() -> None:
    turns = LampQueue("me")
    turns.on_localization("anna", news("sampling", 7, "led_1"), S)
    turns.on_localization("anna", news("sampling", 7, "led_9"), S)
    assert turns.ahead(LAMPS, 9, S) == ("anna",)
    turns.on_localization("anna", news("sampling", 8, "led_9"), S)  # another one
    assert turns.ahead(LAMPS, 9, S) == ()


def test_those_who_point_come_first_then_those_who_asked_earlier() -> None:
    turns = LampQueue("me")
    turns.on_localization("zoe", news("sampling", 50), S)
    turns.on_localization("ben", news("sampling", 20, ahead=("zoe", "anna")), S)
    turns.on_localization("anna", news("sampling", 10, ahead=("zoe",)), S)
    turns.on_localization("late", news("sampling", 40, ahead=("zoe", "anna", "ben", "me")), S)
    assert turns.ahead(LAMPS, 30, S) == ("zoe", "anna", "ben")
    turns.on_localization("zoe", news("solved", 50), 2 * S)
    assert turns.ahead(LAMPS, 30, 2 * S) == ("anna", "ben")  # they have not heard yet
    assert turns.leave("anna")
    assert not turns.leave("anna")
    assert turns.ahead(LAMPS, 30, 2 * S) == ("ben",)
    turns.on_localization("ben", news("idle", 0), 2 * S)
    assert turns.ahead(LAMPS, 30, 2 * S) == ()


def test_those_who_wait_for_other_lamps_are_of_another_queue() -> None:
    turns = LampQueue("me")
    turns.on_localization("anna", news("sampling", 1, "led_8"), S)
    turns.on_localization("ben", news("sampling", 2, ahead=("anna",)), S)
    assert turns.ahead(LAMPS, 30, S) == ()
    turns.on_localization(
        "ben", news("sampling", 2, ahead=("anna", "me")), S
    )  # they say that they share lamps with us
    assert turns.ahead(LAMPS, 30, S) == ("ben",)


@pytest.mark.parametrize(
    ("other", "after_s", "yields"),
    [
        (news("sampling", 10), 0.1, True),
        (news("sampling", 10), 9.0, True),
        (news("sampling", 30), 0.1, False),
        (news("sampling", 20), 0.1, True),  # at the same time: by name
        (news("sampling", 10, ahead=("me",)), 0.1, True),
        (news("sampling", 10, ahead=("me",)), 0.3, False),  # they have waited, so they can wait on
        (news("sampling", 30, ahead=("me",)), 0.1, False),
        (news("sampling", 10, "led_9"), 0.1, False),
    ],
)
def test_yields_to_users_with_earlier_requests(other: Localization, after_s: float, *, yields: bool) -> None:
    turns = LampQueue("me")
    now_ns = 5 * S + round(after_s * S)
    turns.on_localization("anna", other, now_ns)
    assert turns.must_yield_to(LAMPS, 20, 5 * S, now_ns) == (("anna",) if yields else ())


def test_people_and_lamps_without_number_are_not_all_remembered() -> None:
    turns = LampQueue()
    for number in range(2 * MAX_HEARD):
        turns.on_localization(f"u{number}", news("sampling", number), S)
        turns.on_localization("anna", news("sampling", 7, f"lamp_{number}"), S)
    assert len(turns.pointing([*LAMPS, "lamp_0"], S)) == MAX_HEARD
    assert turns.pointing(["lamp_127"], S) == []
