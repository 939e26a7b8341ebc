"""Order of the messages of an AGV, by their timestamps."""

import pytest

from pointit.vda5050 import TimestampCheck


@pytest.mark.parametrize(
    ("stamps_s", "expected"),
    [
        ([1.0, 2.0, 1.5, 2.0, 3.0], [True, True, False, True, True]),
        ([1.0, 1.0, 2.0, 2.0], [True] * 4),  # a clock of whole seconds
        ([None] * 3, [True] * 3),
        ([5.0, None, 4.0], [True] * 3),
        ([9000.0, 9001.0, 3.0, 4.0], [True] * 4),  # its clock is set back
    ],
)
def test_late_messages_are_ignored_and_no_clock_freezes_an_agv(
    stamps_s: list[float | None], expected: list[bool]
) -> None:
    check = TimestampCheck()
    assert [check.is_new(each) for each in stamps_s] == expected


def test_any_message_is_new_after_a_restart() -> None:
    check = TimestampCheck()
    check.is_new(5.0)
    check.forget()
    assert check.is_new(4.0)
