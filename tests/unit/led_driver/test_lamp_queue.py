"""The queue for lamps by example: localizations of people, and who may use which lamps."""

import pytest

from pointit.schemas import NS_PER_S, LampLeases, Localization
from pointit.schemas.codec import decode, encode
from pointit.services.led_driver.picture.lamp_queue import MAX_PEOPLE, LampQueue

S = NS_PER_S
LEFT, RIGHT, BOTH = ("led_0", "led_1"), ("led_1", "led_2"), ("led_0", "led_1", "led_2")


def news(
    since_ns: int, lamps: tuple[str, ...] = LEFT, *, phase: str = "sampling", ahead: tuple[str, ...] = ()
) -> Localization:
    points = phase == "sampling" and not ahead and bool(lamps)
    return Localization.model_validate(
        {
            "stamp_ns": 1,
            "phase": phase,
            "target_id": lamps[0] if points else "",
            "since_ns": since_ns,
            "ahead": ahead,
            "lamps": lamps,
        }
    )


def order(queue: LampQueue) -> dict[str, tuple[str, ...]]:
    return {lease.user: lease.ahead for lease in queue.service().leases}


def test_the_earliest_request_is_served_and_all_others_of_its_lamps_wait_in_order() -> None:
    queue = LampQueue(60 * S)
    for user, since_ns in (("zoe", 20), ("ben", 10), ("anna", 20)):
        queue.on_localization(user, news(since_ns), S)
    assert order(queue) == {"ben": (), "anna": ("ben",), "zoe": ("ben", "anna")}
    assert queue.service().targets == {"led_0"}
    queue.on_localization("ben", news(10, phase="solved"), S)
    for user in ("anna", "zoe"):  # have not heard yet that ben has ended
        queue.on_localization(user, news(20, ahead=("ben",)), S)
    assert order(queue) == {"anna": (), "zoe": ("anna",)}
    assert queue.service().targets == set()
    queue.on_localization("anna", news(20), S)
    assert queue.service().targets == {"led_0"}


def test_person_who_points_is_not_interrupted_by_a_machine_whose_clock_is_behind() -> None:
    queue = LampQueue(60 * S)
    queue.on_localization("anna", news(20), S)
    queue.on_localization("ben", news(5, ahead=("anna",)), S)
    assert order(queue) == {"anna": (), "ben": ("anna",)}
    assert queue.service().targets == {"led_0"}


def test_leases_of_a_large_room_can_be_read() -> None:
    queue, lamps = LampQueue(60 * S), tuple(f"lamp_{index:04}" for index in range(500))
    for index in range(MAX_PEOPLE):
        queue.on_localization(f"person_{index:02}", news(index, lamps), S)
    leases = LampLeases(stamp_ns=1, leases=queue.service().leases)
    assert decode(LampLeases, encode(leases)) == leases


def test_people_with_different_lamps_are_served_side_by_side() -> None:
    queue = LampQueue(60 * S)
    for user, lamps in (("anna", ("led_8", "led_9")), ("ben", LEFT), ("carl", ("led_2",)), ("dora", RIGHT)):
        queue.on_localization(user, news(7, lamps), S)
    assert order(queue) == {"anna": (), "ben": (), "carl": (), "dora": ("ben", "carl")}
    assert queue.service().targets == {"led_8", "led_0", "led_2"}


@pytest.mark.parametrize("after_s", [3.0, -5.0], ids=["silent for too long", "the clock was set back"])
def test_silent_people_leave_the_queue(after_s: float) -> None:
    queue = LampQueue(60 * S)
    queue.on_localization("anna", news(7), 10 * S)
    queue.on_localization("robin", news(7, ()), 10 * S)  # follows a robot, and says nothing while it stands
    assert queue.next_expiry_ns() == 13 * S
    queue.expire(13 * S - 1)
    assert order(queue) == {"anna": ()}
    queue.expire(10 * S + round(after_s * S))
    assert order(queue) == {}
    assert queue.is_in_use == (after_s > 0)
    queue.expire(70 * S)
    assert not queue.is_in_use
    assert queue.next_expiry_ns() is None


def test_people_who_leave_free_their_lamps() -> None:
    queue = LampQueue(60 * S)
    queue.on_localization("anna", news(7), S)
    queue.on_localization("ben", news(8, ahead=("anna",)), S)
    queue.leave("anna")
    queue.leave("anna")
    assert order(queue) == {"ben": ()}


def test_a_lamp_that_another_version_lights_itself_is_left_to_it() -> None:
    queue = LampQueue(60 * S)
    queue.on_localization("anna", news(7, ()).model_copy(update={"target_id": "led_0"}), S)
    assert queue.service().targets == set()


def test_people_without_number_are_not_all_remembered() -> None:
    queue = LampQueue(60 * S)
    for number in range(2 * MAX_PEOPLE):
        queue.on_localization("anna", news(7), S)
        queue.on_localization(f"u{number}", news(number + 8), S)
    assert len(order(queue)) == MAX_PEOPLE
    assert "anna" in order(queue)
