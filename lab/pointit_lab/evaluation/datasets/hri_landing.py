"""`hri_landing`: people fly a quadrotor from spot to spot and land it, by pointing and with a joystick."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.recordings.json_lines import Line, check_samples, read_lines
from pointit_lab.evaluation.recordings.table_file import Array, Table, check_text, read_table

NAME = "hri_landing"
MOVES, TRAJECTORIES = "moves.jsonl", "trajectories.csv"

STEERING, LANDING = "STATE_GOAL", "STATE_LANDING"
"""States from which the person steers, and with which the robot begins to land."""

_Coordinate = Annotated[float, Field(ge=-1e3, le=1e3)]


class _Move(Line):
    move: int
    subject: str
    mode: Literal["joystick", "pointing"]
    from_xy: tuple[_Coordinate, _Coordinate]
    to_xy: tuple[_Coordinate, _Coordinate]
    states: tuple[tuple[Annotated[float, Field(ge=0, le=3600)], str], ...]

    def began_s(self, state: str) -> float | None:
        """Return the time of the first `state`, or None."""
        return next((at_s for at_s, name in self.states if name == state), None)


@dataclass(frozen=True, kw_only=True)
class LandingTrial:
    """One move of a person from spot to spot, up to the landing, whose descent is not recorded."""

    subject: str
    mode: Literal["joystick", "pointing"]
    error_m: float
    """Horizontal distance of the robot from the spot as it begins to land. The spots are not in the source,
    but inferred from the medians of the landings."""
    time_s: float
    """Time of steering. By pointing, it includes holding still for 3.2 s, which orders the landing."""
    detour: float
    """Flown way, horizontally, divided by the distance of the spots."""


def read_moves(folder: Path) -> list[LandingTrial]:
    """Return all moves in `folder` that end with a landing, in the order of the file.

    Raises:
        ConfigError: If a file is missing or damaged; names line, field and value.
    """
    path = folder / MOVES
    moves = list(read_lines(path, _Move))
    table = read_table(folder / TRAJECTORIES, numbers=("move", "t", "x", "y"))
    samples = _by_move(table)
    trials: list[LandingTrial] = []
    for line, move in moves:
        check_text(f"{path}, line {line}, 'subject'", move.subject)
        check_samples(path, line, tuple(at_s for at_s, _ in move.states))
        begun_s, landed_s = move.began_s(STEERING), move.began_s(LANDING)
        if begun_s is None or landed_s is None:
            continue
        flown = samples.get(move.move)
        steered = None if flown is None else flown[(flown[:, 0] >= begun_s) & (flown[:, 0] <= landed_s)]
        distance_m = math.dist(move.from_xy, move.to_xy)
        if steered is None or len(steered) < 2 or distance_m == 0.0:
            raise ConfigError(
                f"{path}, line {line}: move {move.move} has no way from spot to spot in {TRAJECTORIES}; "
                "take the line out"
            )
        way_m = float(np.sum(np.hypot(*np.diff(steered[:, 1:], axis=0).T)))
        trials.append(
            LandingTrial(
                subject=move.subject,
                mode=move.mode,
                error_m=math.dist(steered[-1, 1:].tolist(), move.to_xy),
                time_s=landed_s - begun_s,
                detour=way_m / distance_m,
            )
        )
    return trials


def _by_move(table: Table) -> dict[int, Array]:
    """Return time and position (n x 3: t, x, y) of each move."""
    rows, numbers = table.vectors("t", "x", "y"), table.numbers["move"]
    found: dict[int, Array] = {}
    for number in dict.fromkeys(numbers.tolist()):
        of_it = np.flatnonzero(numbers == number)
        times_s = rows[of_it, 0]
        if np.any(np.diff(times_s) < 0.0):
            row = int(of_it[int(np.argmax(np.diff(times_s) < 0.0)) + 1])
            raise table.refuse(row, f"column 't': time goes backwards in move {number:g}; cut it there")
        found[int(number)] = rows[of_it]
    return found
