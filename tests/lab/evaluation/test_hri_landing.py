"""Recorded quadrotor landings: errors, times and ways of people; damage is said."""

import json
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets.hri_landing import MOVES, TRAJECTORIES, read_moves
from pointit_lab.evaluation.robots.flight_row import recorded_rows
from tests.support import there

STATES = [[0.0, "STATE_IDLE"], [1.0, "STATE_GOAL"], [9.0, "STATE_LANDING"]]


def write(folder: Path, *moves: dict[str, object], rows: str = "") -> Path:
    """Write a move from (-1, 0) to (1, 0), with a corner at (0, 1), that ends 0.1 m beside the spot."""
    usual: dict[str, object] = {
        "move": 0,
        "subject": "a",
        "mode": "pointing",
        "from_xy": [-1.0, 0.0],
        "to_xy": [1.0, 0.0],
        "states": STATES,
    }
    lines = [json.dumps(usual | move) for move in moves or ({},)]
    (folder / MOVES).write_text("\n".join(lines) + "\n", encoding="utf-8")
    way = "".join(
        f"{number},{row}\n"
        for number in range(len(lines))
        for row in ("0.5,-5,0,1", "1,-1,0,1", "5,0,1,1", "9,1,0.1,0.6", "9.5,7,7,0")
    )
    (folder / TRAJECTORIES).write_text(f"move,t,x,y,z\n{rows or way}", encoding="utf-8")
    return folder


def test_error_time_and_detour_count_from_the_steering_to_the_landing(tmp_path: Path) -> None:
    (move,) = read_moves(write(tmp_path))
    assert (move.error_m, move.time_s) == pytest.approx((0.1, 8.0))
    assert move.detour == pytest.approx((2.0**0.5 + (1.0 + 0.9**2) ** 0.5) / 2.0)


def test_a_move_without_a_landing_is_left_out(tmp_path: Path) -> None:
    moves = read_moves(write(tmp_path, {"states": STATES[:2]}, {"move": 1, "subject": "b"}))
    assert [move.subject for move in moves] == ["b"]


def test_rows_are_those_of_the_devices_that_were_recorded(tmp_path: Path) -> None:
    rows = recorded_rows(write(tmp_path, {}, {"move": 1, "mode": "joystick"}, {"move": 2}))
    assert [(row.who, row.n, row.people) for row in rows] == [
        ("people, pointing", 2, 1),
        ("people, joystick", 1, 1),
    ]
    assert rows[0].error_m is None
    assert there(rows[0].ordered_error_m).median == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("move", "rows", "said"),
    [
        ({"move": 7}, "", "move 7 has no way"),
        ({"to_xy": [-1.0, 0.0]}, "", "has no way from spot to spot"),
        ({"mode": "mouse"}, "", "line 1: mode"),
        ({"subject": "all"}, "", "is reserved"),
        ({"states": [[9.0, "STATE_GOAL"], [1.0, "STATE_LANDING"]]}, "", "time goes backwards"),
        ({}, "0,1,-1,0,1\n0,9,1,0,1\n0,5,1,0,1\n", "line 4, column 't': time goes backwards"),
        ({}, "0,1,x,0,1\n", "column 'x'"),
    ],
)
def test_damage_is_refused_with_its_line(
    tmp_path: Path, move: dict[str, object], rows: str, said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        read_moves(write(tmp_path, move, rows=rows))
