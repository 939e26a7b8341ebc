"""Limits at a router over minutes: who is let in again, who only reads slowly."""

import pytest

from pointit.access.limits import BURST, HOLD_S, MAX_HZ, MIN_UNREAD, PATIENCE, Connection, Limits

ANNA = Connection(identity="lab/anna", session="a1", address="tls/10.0.0.7:40000")
ROLES = {"lab/anna": "user"}


def look(limits: Limits, now_s: float, rate_hz: float = 0.0) -> bool:
    """Look once. Return True if the connection is cut."""
    cut, told = limits.excess([ANNA], ROLES, {"lab/anna": rate_hz}, now_s)
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


def test_identity_that_flooded_is_let_in_again_when_it_has_ended_to() -> None:
    limits = Limits()
    assert look(limits, 0.0, MAX_HZ + 10 * BURST)
    for second in range(1, int(HOLD_S)):
        assert look(limits, float(second))
    for second in range(int(HOLD_S), 200):
        assert not look(limits, float(second), MAX_HZ / 2.0)
