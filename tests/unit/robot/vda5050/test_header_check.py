"""Order of the messages of an AGV, whatever it counts."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.vda5050.agv_messages import HeaderCheck


def test_messages_that_come_late_or_twice_are_told_from_those_of_a_restarted_agv() -> None:
    check = HeaderCheck()
    ids = (5, 6, 6, 5, 7, 500, 400)
    assert [check.is_new(each) for each in ids] == [True, True, False, False, True, True, False]
    assert check.is_new(2), "it counts from the start"
    check.forget()
    last = 2**32 - 1
    assert [check.is_new(each) for each in (last, 0, last)] == [True, True, False]
    check.forget()
    assert check.is_new(0)


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        # id and time, s
        ([(0, None)] * 5, [True] * 5),  # a constant id
        ([(None, None)] * 3, [True] * 3),  # none
        ([(0, 50.0)] * 4, [True] * 4),  # a constant id and a constant time
        ([(None, 1.0), (None, 2.0), (None, 1.5), (None, 2.0), (None, 3.0)], [True, True, False, True, True]),
        ([(0, 1.0), (0, 2.0), (0, 1.5), (0, 2.0), (0, 3.0)], [True, True, False, True, True]),
        ([(0, 1.0), (0, 1.0), (0, 2.0), (0, 2.0), (0, 2.0)], [True] * 5),  # a clock of whole seconds
        ([(None, 1.0), (None, 1.0), (None, 2.0), (None, 2.0)], [True] * 4),
        ([(58, 1.0), (59, 2.0), (1, 3.0), (2, 4.0), (1, 3.0)], [True, True, True, True, False]),  # restart
        ([(58, 1.0), (59, 2.0), *[(58, 1.0)] * 6], [True, True, *[False] * 6]),  # late by their time
        (
            [(58, None), (59, None), (1, None), (2, None), (3, None), (4, None)],
            [True, True, False, False, True, True],
        ),
        ([(58, 9000.0), (59, 9001.0), (60, 3.0), (61, 4.0)], [True] * 4),  # its clock is set back
        ([(7, 9000.0), (7, 9001.0), (7, 3.0), (7, 4.0)], [True] * 4),
        ([(900, 9000.0), (901, 9001.0), (1, 3.0), (2, 4.0)], [True] * 4),  # restart without a clock
        ([(5, 50.0), (6, 50.0), (6, 50.0), (5, 50.0), (7, 50.0)], [True, True, False, False, True]),
        ([(5, 1.0), (7, 3.0), (6, 2.0), (8, 4.0)], [True, True, False, True]),
    ],
)
def test_late_and_repeated_messages_are_ignored_and_no_counter_freezes_an_agv(
    headers: list[tuple[int | None, float | None]], expected: list[bool]
) -> None:
    check = HeaderCheck()
    assert [check.is_new(*each) for each in headers] == expected


@given(st.lists(st.tuples(st.none() | st.integers(0, 200), st.none() | st.floats(0, 1e10)), max_size=30))
def test_whatever_an_agv_counts_it_is_heard_again_soon(
    headers: list[tuple[int | None, float | None]],
) -> None:
    check = HeaderCheck()
    for each in headers:
        check.is_new(*each)
    newest = max((time or 0.0 for _, time in headers), default=0.0)
    assert any(check.is_new(0, newest + late_s) for late_s in (1.0, 2.0, 3.0)), "its time rises"
    check.is_new(150, None)
    assert any(check.is_new(number, None) for number in (1, 2, 3)), "it counts from the start"
