"""Mistakes that can be planted in the product, to see how many seeds it takes to find each.

Each is a patch of one function or constant, applied in the child process that runs a seed.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pointit.runtime.service import carrier
from tests.simulation.promises import promise
from tests.simulation.promises.promise import Promise


@dataclass(frozen=True)
class Mistake:
    """A mistake, and the promise that it breaks first in most seeds."""

    text: str
    breaks: Promise
    plant: Callable[[], object]


def _carry_out_late() -> None:
    carrier.MAX_ACT_AGE_S = 600.0


MISTAKES: dict[str, Mistake] = {
    "late-acts": Mistake("an act that arrives late is carried out", promise.NOT_LATE, _carry_out_late),
}
