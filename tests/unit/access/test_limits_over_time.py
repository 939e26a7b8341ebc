"""Limits at a router over minutes: who is let in again, whose keys are forgotten, who only reads slowly."""

import pytest

from pointit.access.limits import HOLD_S, KEYS_S, MAX_KEYS, MIN_UNREAD, PATIENCE, Connection, Limits

ANNA = Connection(identity="lab/anna", session="a1", address="tls/10.0.0.7:40000")
ROLES = {"lab/anna": "user"}


def look(limits: Limits, now_s: float, *keys: str) -> bool:
    """Look once. Return True if the connection is cut."""
    cut, told = limits.excess([ANNA], ROLES, {}, now_s, {"lab/anna": keys})
    assert (cut, list(told)) in (([], []), ([ANNA], ["lab/anna"]))
    return bool(cut)


def test_little_that_waits_is_no_sign_of_a_stuck_reader() -> None:
    limits = Limits()
    for _ in range(2 * PATIENCE):
        assert limits.stuck({ANNA: 1000}) == {}
    for _ in range(PATIENCE - 1):
        assert limits.stuck({ANNA: MIN_UNREAD}) == {}
    assert list(limits.stuck({ANNA: MIN_UNREAD})) == ["lab/anna"]


@pytest.mark.parametrize("change", [-1, 1])
def test_backlog_that_grows_or_shrinks_is_of_a_slow_reader(change: int) -> None:
    limits = Limits()
    for number in range(4 * PATIENCE):
        assert limits.stuck({ANNA: 4_000_000 + change * number}) == {}


def test_looks_at_which_a_backlog_stands_still_count_in_a_row() -> None:
    limits = Limits()
    for waits in (900_000, 900_000, 800_000, 800_000, 900_000, 900_000):
        assert limits.stuck({ANNA: waits}) == {}
    assert list(limits.stuck({ANNA: 900_000})) == ["lab/anna"]


def test_keys_that_are_not_written_any_more_are_forgotten() -> None:
    """A person who is shown many lamps in five minutes, a few each second."""
    limits, few = Limits(), MAX_KEYS // 100
    for second in range(300):
        assert not look(limits, float(second), *(f"leds/{second}_{number}/color" for number in range(few)))


def test_keys_count_for_as_long_as_readers_keep_them() -> None:
    half = [f"leds/{number}/color" for number in range(MAX_KEYS // 2)]
    other = [f"leds/x{number}/color" for number in range(MAX_KEYS // 2 + 1)]
    for span_s, is_cut in ((KEYS_S, True), (KEYS_S + 1.0, False)):
        limits = Limits()
        assert not look(limits, 0.0, *half)
        assert look(limits, span_s, *other) == is_cut


def test_identity_that_made_up_names_is_let_in_again_when_it_has_ended_to() -> None:
    limits = Limits()
    assert look(limits, 0.0, *(f"leds/x{number}/color" for number in range(MAX_KEYS + 1)))
    for second in range(1, int(HOLD_S)):
        assert look(limits, float(second))
    for second in range(int(HOLD_S), 200):
        assert not look(limits, float(second), "imu/anna")
