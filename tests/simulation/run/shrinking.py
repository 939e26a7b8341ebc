"""The fewest faults of a seed that still break a promise."""

from collections.abc import Callable, Sequence

from tests.simulation.faults.fault import Fault


def shrink(faults: Sequence[Fault], breaks: Callable[[Sequence[Fault]], bool]) -> list[Fault]:
    """Leave out halves, quarters and single faults as long as `breaks` of the rest is True."""
    kept = list(faults)
    size = max(1, len(kept) // 2)
    while True:
        fewer = _without_part(kept, size, breaks)
        if fewer is not None:
            kept = fewer
            size = max(1, min(size, len(kept) // 2))
        elif size > 1:
            size //= 2
        else:
            return kept


def _without_part(
    faults: list[Fault], size: int, breaks: Callable[[Sequence[Fault]], bool]
) -> list[Fault] | None:
    """Return `faults` without the first `size` in a row that are not needed, or None if all are."""
    for first in range(0, len(faults), size):
        fewer = faults[:first] + faults[first + size :]
        if breaks(fewer):
            return fewer
    return None
