"""Feet that shift: about their place, seldom, without a jump."""

import numpy as np
import pytest

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.body.standing_position import StandingPosition
from tests.unit.user_sim.life import PRECISE, ROOM, Life

PLACE: Vec3 = (2.0, 0.5, 0.1)
PERIOD_NS = NS_PER_S // 50


def walk(
    sd_m: float, every_s: float, duration_s: float = 2000.0
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    feet = StandingPosition(PLACE, sd_m, every_s, np.random.default_rng(1))
    return np.array([feet.at(7 + i * PERIOD_NS) for i in range(round(duration_s * 50))])


def test_by_default_they_stay() -> None:
    assert np.ptp(walk(0.0, 5.0, 100.0), axis=0).max() == 0.0
    assert PRECISE.stance_shift_sd_m == 0.0


def test_they_stand_about_the_place_with_the_given_spread_and_step_as_often_as_said() -> None:
    spots = walk(0.05, 4.0)
    assert spots[0] == pytest.approx(PLACE)
    assert spots.mean(axis=0) == pytest.approx(PLACE, abs=0.01)
    assert spots[:, :2].std(axis=0) == pytest.approx([0.05, 0.05], rel=0.2)
    assert np.ptp(spots[:, 2]) == 0.0
    moves = np.abs(np.diff(spots[:, 0])) > 1e-9
    begins = int((np.diff(moves.astype(int)) == 1).sum())
    assert begins == pytest.approx(2000.0 / 5.0, rel=0.15)  # 4 s and the second that a step takes


def test_no_step_is_a_jump() -> None:
    assert np.abs(np.diff(walk(0.05, 4.0), axis=0)).max() < 0.05 * 4 * 2 / 50 * 2


def test_the_person_points_from_where_they_stand() -> None:
    life = Life(PRECISE.model_copy(update={"stance_shift_sd_m": 0.3, "stance_shift_every_s": 2.0}))
    life.state("localizing")
    life.cue("target", target="led_2")
    life.run(3.0)
    errors = [life.error_rad(life.run(0.5), ROOM.lamps[1].position_m) for _ in range(40)]
    assert np.degrees(np.ptp(errors)) > 1.0  # `life` reckons from the place itself
