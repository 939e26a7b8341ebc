"""Way of an AGV, which is handed out node by node."""

import math
from collections import deque
from collections.abc import Iterable

from pointit.vda5050.map_velocity import SAME_M

Point = tuple[float, float]

MAX_POINTS = 1000
"""Maximum number of way-points."""


class Route:
    """Way-points ahead of the nodes that were handed out."""

    def __init__(self) -> None:
        self._ahead: deque[Point] = deque()

    def __bool__(self) -> bool:
        """Return True if there is a way ahead."""
        return bool(self._ahead)

    @property
    def end(self) -> Point | None:
        """Return the last way-point, or None if there is no way ahead."""
        return self._ahead[-1] if self._ahead else None

    def replace(self, points: Iterable[Point]) -> None:
        """Forget the way ahead, and go along `points`, the first 1000 of them."""
        self._ahead.clear()
        for point in points:
            if len(self._ahead) < MAX_POINTS:
                self._ahead.append(point)

    def next_node(self, start: Point, step_m: float) -> Point | None:
        """Return the place of the next node behind one at `start`, `step_m` away at most.

        Way-points are nodes, and the line to a way-point that is farther away is divided evenly. Returns None
        at the end of the way.
        """
        while self._ahead:
            to = self._ahead[0]
            away_m = math.dist(start, to)
            if away_m > step_m:
                part = 1.0 / math.ceil(away_m / step_m)
                return (start[0] + part * (to[0] - start[0]), start[1] + part * (to[1] - start[1]))
            self._ahead.popleft()
            if away_m > SAME_M:
                return to
        return None
