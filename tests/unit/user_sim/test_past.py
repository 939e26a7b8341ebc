"""A person who points past everything finds back: by the cue that says where to, and by the pixel nearest."""

import math

import pytest

from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import AimConfig
from tests.unit.user_sim.life import PRECISE, Life, thing

KIND = "red"


def lost(bias_deg: float, off_deg: float = 0.0, *, is_told: bool = True) -> tuple[Life, float]:
    """Return the life of one who points too high by `bias_deg` and who the system believes turned, and when
    their cursor was on the strip first, s; infinite: never within 20 s."""
    aim = AimConfig(skill=1.0, correction_spread=0.0, content_deg=0.0, elevation_bias_deg=bias_deg)
    life = Life(PRECISE.model_copy(update={"aim": aim, "target_kinds": (KIND,)}))
    life.is_told = is_told
    life.light(off_rad=math.radians(off_deg))
    life.before_step = lambda: life.objects(thing("p1", KIND, 2.5))
    life.state("pointing")
    for _ in range(20 * 5):
        life.run(0.2)
        steady = [cursor.surface == "strip" for cursor in life.cursors[-25:]]
        if len(steady) == 25 and all(steady):
            return life, life.now_ns / NS_PER_S
    return life, math.inf


@pytest.mark.parametrize("bias_deg", [-30.0, -20.0, 20.0, 28.0])
def test_a_pitch_offset_is_taken_out_within_seconds_by_the_cue(bias_deg: float) -> None:
    life, found_s = lost(bias_deg)
    assert found_s < 5.0
    assert len(life.past) == 1
    assert ("raise" if bias_deg < 0.0 else "lower") in life.past[0].text


def test_without_the_cue_it_is_not_found() -> None:
    assert math.isinf(lost(-20.0, is_told=False)[1])


@pytest.mark.parametrize("off_deg", [50.0, -60.0])
def test_a_turn_aside_is_taken_out_by_the_pixel_alone(off_deg: float) -> None:
    assert lost(0.0, off_deg, is_told=False)[1] < 5.0


def test_a_cue_of_pointing_past_does_not_end_pointing() -> None:
    life, _ = lost(-20.0)
    assert life.past
    assert life.person._perception.belief.state == "pointing"
