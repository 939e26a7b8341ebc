"""Reaches of people who hear the names of things and see no light, around the selector's own engine."""

import math
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Announced, ButtonEvent, Cursor, SelectionEvent, Step
from pointit.services.pui.tracked_objects import PERIOD_S, TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.announcer import AnnounceConfig
from pointit.services.selector.methods.estimate import EstimateConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import Output
from pointit_lab.evaluation.things.listening_reach import AnnounceWay, ListenerModel, ListeningReach
from pointit_lab.evaluation.things.reach import RATE_HZ
from pointit_lab.evaluation.things.things import (
    EYES_M,
    LIMIT_S,
    PERSON,
    START_NS,
    Result,
    ThingRow,
    point_beside,
)

FIRST_SEED = 200_000
"""First seed for claims. The prototype used 1000 to 1099, 5000 to 12999 and 100000 to 107999."""
AWAY_M = (1.5, 3.5)
"""Range of distances of people from the things, m."""
ANNOUNCED_ROWS = tuple(
    ThingRow(name=name, count=count, levels=levels, size_m=size_m, apart_m=apart_m, away_m=2.5, lit=False)
    for name, levels, count, size_m, apart_m in (
        ("4 things 0.7 m apart", 1, 4, 0.4, 0.7),
        ("6 things 0.4 m apart", 1, 6, 0.23, 0.4),
        ("8 things 0.25 m apart", 1, 8, 0.15, 0.25),
        ("shelf of 3 rows of 5, 0.4 m apart", 3, 5, 0.23, 0.4),
    )
)
WAVES = ("among", "nothing")
"""Points of people who mean nothing: among the things, or beside them."""
WAVE_RAD = (math.radians(35.0), math.radians(20.0))
"""Largest azimuth and elevation of points among the things. So `estimate` without names fires 216 times in 30
min, and with names and dwell 271 times, at 1 to 4 s for each point: the prototype had 209 and 258."""


def announced_config(way: AnnounceWay) -> SelectorConfig:
    """Return the parameters of the selector for people who hear names."""
    confirm: Literal["dwell", "press"] = "dwell" if way == "names+dwell" else "press"
    announce = AnnounceConfig(people=(PERSON,), confirm=confirm)
    return SelectorConfig.model_validate(
        {"method": "estimate", "estimate": EstimateConfig(announce=announce)}
    )


class Wrist(Protocol):
    """A wrist whose person's pose is found, with errors."""

    def cursor(self, direction_w: Vec3, now_ns: int) -> Cursor:
        """Return the cursor of a person who truly points towards `direction_w`."""
        ...

    def on_announced(self, announced: Announced) -> None:
        """Process the name that is spoken to the person."""
        ...

    def on_selection(self, event: SelectionEvent) -> None:
        """Process a selection of the person."""
        ...


class AnnouncedSite:
    """An engine, its things, and one listening listener."""

    def __init__(self, row: ThingRow, way: AnnounceWay) -> None:
        self.environment = row.environment()
        self.positions_m: dict[str, Vec3] = {one.id: one.center_m for one in self.environment.things}
        columns = row.count
        self.cells = {name: (at // columns, -(at % columns)) for at, name in enumerate(self.positions_m)}
        """Row, and column from left to right, of each thing: the first is the rightmost."""
        self._engine = SelectionEngine(announced_config(way), lambda _record: None)
        self._engine.on_map(self.environment)
        self._listed_s = -math.inf
        self.wrist: Wrist | None = None
        """Wrist by whose pose the cursor is found. None: the pose is exact but for the error of the reach."""

    def select(self, listener: ListeningReach, goal: str, begun_s: float = 0.0) -> Result:
        """Return the end of a reach for `goal` that begins at `begun_s`."""
        for index in range(round(LIMIT_S * RATE_HZ)):
            event = self.advance(listener, index / RATE_HZ, begun_s)
            if event is not None:
                end: Literal["right", "wrong"] = "right" if event.object_id == goal else "wrong"
                return Result(end, index / RATE_HZ, event.confidence)
        return Result("nothing", LIMIT_S, None)

    def advance(self, listener: ListeningReach, time_s: float, begun_s: float = 0.0) -> SelectionEvent | None:
        """Process one cursor, the steps and the press of the listener. Return a selection, if there is one.

        `time_s` is the person's time, `begun_s` that of its beginning.
        """
        now_ns = START_NS + round((begun_s + time_s) * NS_PER_S)
        if begun_s + time_s - self._listed_s >= PERIOD_S:
            self._engine.on_objects(TRACKER, listing(self.environment, now_ns))
            self._listed_s = begun_s + time_s
            self._engine.tick(now_ns)
        direction = listener.direction(time_s)
        if self.wrist is None:
            cursor = Cursor(stamp_ns=now_ns, origin_m=EYES_M, direction=direction)
        else:
            cursor = self.wrist.cursor(direction, now_ns)
        outputs: list[Output] = self._engine.on_cursor(PERSON, cursor)
        steps, is_pressed = listener.act(time_s)
        for by in steps:
            outputs += self._engine.on_step(PERSON, Step(stamp_ns=now_ns, by=1 if by > 0 else -1))
        if is_pressed:
            outputs += self._engine.on_button(PERSON, ButtonEvent(stamp_ns=now_ns))
        selected = None
        for _, message in outputs:
            if isinstance(message, Announced) and message.object_id:
                listener.hear(time_s, message.object_id)
                if self.wrist is not None:
                    self.wrist.on_announced(message)
            elif isinstance(message, SelectionEvent) and message.event == "selected":
                selected = message
                if self.wrist is not None:
                    self.wrist.on_selection(message)
        return selected


def announced_reaches(way: AnnounceWay, piece: tuple[ThingRow, int, int]) -> list[Result]:
    """Return the results of one person each, for `count` seeds from the first on."""
    row, first, count = piece
    return [announced_reach(row, way, seed) for seed in range(first, first + count)]


def announced_reach(row: ThingRow, way: AnnounceWay, seed: int, model: ListenerModel | None = None) -> Result:
    """Return the result of one person's reach for one thing of `row`, at a random distance."""
    rng = np.random.default_rng([seed, row.count, row.levels])
    site = AnnouncedSite(replace(row, away_m=float(rng.uniform(*AWAY_M))), way)
    goal = list(site.positions_m)[int(rng.integers(len(site.positions_m)))]
    model = ListenerModel() if model is None else model
    listener = ListeningReach(EYES_M, site.positions_m, goal, rng, way=way, model=model, cells=site.cells)
    return site.select(listener, goal)


def waves(way: AnnounceWay, piece: tuple[str, int, float]) -> int:
    """Return the number of firings for a person who means nothing: among the things, or beside them.

    They hold points of no meaning for a few seconds each; every press is a false one.
    """
    kind, seed, minutes = piece
    rng = np.random.default_rng([seed, 11])
    row = ANNOUNCED_ROWS[0]
    site = AnnouncedSite(row, way)
    fired, begun_s, arm = 0, 0.0, None
    while begun_s < minutes * 60.0:
        azimuth, elevation = (float(rng.uniform(-most, most)) for most in WAVE_RAD)
        among = vector.add(EYES_M, vector.scale(vector.direction(azimuth, elevation), row.away_m))
        point_m = among if kind == "among" else point_beside(row, rng)
        targets_m = {**site.positions_m, "point": point_m}
        arm = ListeningReach(
            EYES_M, targets_m, "point", rng, arm, way=way, model=ListenerModel(), cells=site.cells
        )
        count = round((arm.took_s + float(rng.uniform(1.0, 4.0))) * RATE_HZ)
        for index in range(count):
            fired += site.advance(arm, index / RATE_HZ, begun_s) is not None
        begun_s += count / RATE_HZ
    return fired
