"""Values that must be there."""

from typing import TypeVar

T = TypeVar("T")


def known(value: T | None) -> T:
    """Return `value`; fail if there is none."""
    assert value is not None
    return value
