"""Reactions of the person to requests of the localizer, and requests of their own: open loop, at any time."""

import math

import pytest

from pointit.geometry import vector
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import AimConfig
from tests.unit.user_sim.life import PRECISE, ROOM, Life, State, living, thing

LED_2 = ROOM.lamps[1].position_m


@pytest.mark.parametrize("state", ["idle", "localizing", "pointing"])
def test_arm_points_at_an_anchors_lamp_in_every_state(state: State) -> None:
    life = living(state, behaviour="strips")
    life.run(1.0)
    life.cue("target", target="led_2")
    assert life.error_rad(life.run(3.0), LED_2) < 1e-6
    assert not life.person.goal.closed_loop
    life.cue("localized")
    life.run(1.0)
    assert life.person.goal.key == {"idle": "rest", "localizing": "rest", "pointing": "strips 0"}[state]


def show_cursor_off(life: Life, off_rad: float) -> None:
    target = thing("a", "red", 2.0)
    life.light(off_rad=off_rad)
    life.before_step = lambda: life.objects(target)


def test_correction_is_not_carried_to_a_lamp_without_a_cursor() -> None:
    life = living("pointing")
    show_cursor_off(life, math.radians(15.0))
    azimuth = vector.azimuth(life.ray(life.run(6.0)))
    straight = vector.subtract(thing("a", "red", 2.0).position_m, life.eyes_m)
    assert math.degrees(azimuth - vector.azimuth(straight)) == pytest.approx(-15.0, abs=1.0)
    life.cue("target", target="led_2")
    assert life.error_rad(life.run(3.0), LED_2) < 1e-6


@pytest.mark.parametrize(("off_deg", "presses"), [(0.0, 0), (4.0, 0), (15.0, 1)])
def test_person_presses_twice_when_the_cursor_stays_off(off_deg: float, presses: int) -> None:
    life = living("pointing", anchor_when_off_deg=8.0)
    show_cursor_off(life, math.radians(off_deg))
    life.run(12.0)
    assert len(life.doubles) == presses
    life.run(15.0)
    assert len(life.doubles) == 2 * presses  # it did not help


def test_anchor_is_requested_every_minute() -> None:
    life = living("localizing", anchor_every_s=60.0, behaviour="rest")
    life.run(30.0)
    life.state("pointing")
    life.run(4.0)
    for _ in range(3):
        life.run(56.5)
        life.cue("target", target="led_2")
        life.run(3.5)
        life.cue("localized")

    assert [round(at_ns / NS_PER_S) for at_ns in life.doubles] == [90, 150, 210]
    assert life.now_ns == round(214.0 * NS_PER_S)
    assert life.presses == []

    life.state("idle")
    life.run(2.0)
    life.state("pointing")
    life.run(58.0)
    assert len(life.doubles) == 3  # the minute counts from the start


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
def test_pitch_offset_is_corrected_within_seconds_by_the_cue(bias_deg: float) -> None:
    life, found_s = lost(bias_deg)
    assert found_s < 5.0
    assert len(life.past) == 1
    assert ("raise" if bias_deg < 0.0 else "lower") in life.past[0].text


def test_large_pitch_offset_is_not_corrected_without_the_cue() -> None:
    assert math.isinf(lost(-20.0, is_told=False)[1])


@pytest.mark.parametrize("off_deg", [50.0, -60.0])
def test_azimuth_offset_is_corrected_by_the_mark_alone(off_deg: float) -> None:
    assert lost(0.0, off_deg, is_told=False)[1] < 5.0
