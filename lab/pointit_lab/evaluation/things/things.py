"""Reaches for things in rooms: how often the right one fires, a wrong one, or none, and how soon."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, Hover, SelectionEvent, Thing
from pointit.services.pui.things import PERIOD_S, TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit_lab.evaluation.things.reach import RATE_HZ, Reach

EYES_M: Vec3 = (0.0, 0.0, 1.64)
LIMIT_S = 8.0
"""Time after which a reach counts as nothing."""
PERSON = "person"
START_NS = 1_000 * NS_PER_S


@dataclass(frozen=True, kw_only=True)
class Row:
    """Boxes in a row before a person."""

    name: str
    count: int
    size_m: float
    apart_m: float
    away_m: float
    height_m: float = 1.4
    lit: bool = True

    def environment(self) -> Environment:
        """Return the map."""
        return Environment(
            stamp_ns=0,
            name=self.name,
            things=tuple(
                Thing(
                    id=f"t{index}",
                    center_m=(self.away_m, (index - (self.count - 1) / 2.0) * self.apart_m, self.height_m),
                    size_m=(self.size_m, self.size_m, self.size_m),
                    lamp=f"t{index}" if self.lit else "",
                )
                for index in range(self.count)
            ),
        )


ROWS = tuple(
    Row(name=f"{name}, {'light' if lit else 'no light'}", lit=lit, count=count, size_m=a, apart_m=b, away_m=c)
    for name, count, a, b, c in (
        (".4 m boxes .7 m apart, 2.6 m away", 4, 0.4, 0.7, 2.6),
        (".15 m boxes .2 m apart, 1.5 m away", 5, 0.15, 0.2, 1.5),
    )
    for lit in (True, False)
)


@dataclass(frozen=True)
class Result:
    """How one reach ended."""

    end: Literal["right", "wrong", "nothing"]
    took_s: float
    confidence: float | None


def reach(row: Row, config: SelectorConfig, seed: int) -> Result:
    """Return the result of one person's reach for one thing of `row`."""
    rng = np.random.default_rng([seed, row.count])
    environment = row.environment()
    goal = environment.things[int(rng.integers(row.count))].id
    person = Reach(EYES_M, {each.id: each.center_m for each in environment.things}, goal, rng)
    engine = SelectionEngine(config, lambda _record: None)
    engine.on_map(environment)
    listed_s = -math.inf
    for time_s in _times():
        now_ns = START_NS + round(time_s * NS_PER_S)
        if time_s - listed_s >= PERIOD_S:
            engine.on_objects(TRACKER, listing(environment, now_ns))
            listed_s = time_s
        if row.lit:
            person.correct(time_s)
        cursor = Cursor(stamp_ns=now_ns, origin_m=EYES_M, direction=person.direction(time_s))
        for output in engine.on_cursor(PERSON, cursor):
            if isinstance(output.message, Hover):
                person.see(time_s, output.message.object_id or None)
            elif isinstance(output.message, SelectionEvent) and output.message.event == "selected":
                end: Literal["right", "wrong"] = "right" if output.message.object_id == goal else "wrong"
                return Result(end, time_s, output.message.confidence)
    return Result("nothing", LIMIT_S, None)


def _times() -> Iterator[float]:
    return (index / RATE_HZ for index in range(round(LIMIT_S * RATE_HZ)))
