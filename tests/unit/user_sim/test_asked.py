"""Reactions of the person to requests of the localizer, and requests of their own: open loop, at any time."""

import math
from typing import Literal

import pytest

from pointit.geometry import vector
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import AimConfig, UserSimConfig
from tests.unit.user_sim.life import PRECISE, ROOM, Life, thing

LED_2 = ROOM.lamps[1].position_m
STRIPS = PRECISE.model_copy(update={"behaviour": "strips"})


def changed(**fields: object) -> UserSimConfig:
    return PRECISE.model_copy(update=fields)


@pytest.mark.parametrize("state", ["idle", "localizing", "pointing"])
def test_an_anchors_lamp_is_pointed_at_in_every_state(
    state: Literal["idle", "localizing", "pointing"],
) -> None:
    life = Life(STRIPS)
    life.state(state)
    life.run(1.0)
    life.cue("target", target="led_2")
    assert life.error_rad(life.run(3.0), LED_2) < 1e-6
    assert not life.person.goal.closed_loop
    life.cue("localized")
    life.run(1.0)
    assert life.person.goal.key == {"idle": "rest", "localizing": "rest", "pointing": "strips 0"}[state]


@pytest.mark.parametrize("state", ["localizing", "pointing"])
def test_a_moving_robot_is_followed_when_asked(state: Literal["localizing", "pointing"]) -> None:
    life = Life(STRIPS)
    life.state(state)
    life.before_step = lambda: life.objects(thing("robot", "robot", 2.0))
    life.cue("target", target="robot")
    life.run(1.0)
    assert life.person.goal.key == "object robot"
    assert not life.person.goal.closed_loop


def test_who_does_not_mind_the_lamp_lets_the_arm_hang() -> None:
    life = Life(changed(points_when_asked=False))
    life.state("localizing")
    life.cue("target", target="led_2")
    assert vector.elevation(life.ray(life.run(3.0))) < math.radians(-60.0)
    life.state("pointing")
    life.cue("target", target="led_2")
    life.run(1.0)
    assert life.person.goal.key == "rest"


def show_cursor_off(life: Life, off_rad: float) -> None:
    """Show at every step the cursor `off_rad` to the left of where the person points."""
    target = thing("a", "red", 2.0)
    life.light(off_rad=off_rad)
    life.before_step = lambda: life.objects(target)


def test_what_a_cursor_taught_is_not_carried_to_a_lamp_without_one() -> None:
    life = Life(PRECISE)
    life.state("pointing")
    show_cursor_off(life, math.radians(15.0))
    azimuth = vector.azimuth(life.ray(life.run(6.0)))
    straight = vector.subtract(thing("a", "red", 2.0).position_m, life.eyes_m)
    assert math.degrees(azimuth - vector.azimuth(straight)) == pytest.approx(-15.0, abs=1.0)
    life.cue("target", target="led_2")
    assert life.error_rad(life.run(3.0), LED_2) < 1e-6


@pytest.mark.parametrize(("off_deg", "presses"), [(0.0, 0), (4.0, 0), (15.0, 1)])
def test_a_cursor_that_stays_off_makes_the_person_press_twice(off_deg: float, presses: int) -> None:
    life = Life(changed(anchor_when_off_deg=8.0))
    life.state("pointing")
    show_cursor_off(life, math.radians(off_deg))
    life.run(12.0)
    assert len(life.doubles) == presses
    life.run(15.0)
    assert len(life.doubles) == 2 * presses  # it did not help


def test_a_cursor_that_is_never_off_long_does_not() -> None:
    life = Life(changed(anchor_when_off_deg=8.0))
    life.state("pointing")
    show_cursor_off(life, math.radians(15.0))
    life.run(2.5)
    show_cursor_off(life, 0.0)
    life.run(20.0)
    assert life.doubles == []


def test_a_lost_cursor_is_off() -> None:
    life = Life(changed(anchor_when_off_deg=20.0, behaviour="strips"))
    life.state("pointing")
    life.run(10.0)
    assert len(life.doubles) == 1


def test_by_default_nobody_presses_twice() -> None:
    life = Life(PRECISE)
    life.state("pointing")
    show_cursor_off(life, math.radians(30.0))
    life.run(120.0)
    assert life.doubles == []


def test_an_anchor_every_minute() -> None:
    life = Life(changed(anchor_every_s=60.0, behaviour="rest"))
    life.state("localizing")
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


def test_no_second_anchor_is_asked_for_while_one_goes_on() -> None:
    life = Life(changed(anchor_every_s=5.0))
    life.state("pointing")
    life.cue("target", target="led_2")
    life.run(20.0)
    assert life.doubles == []


def test_a_given_bias_is_the_persons_whatever_their_skill() -> None:
    for skill in (0.0, 1.0):
        aim = AimConfig(
            skill=skill,
            elevation_bias_deg=10.0,
            elevation_error_reach_sd_deg=0.0,
            azimuth_error_reach_sd_deg=0.0,
            bent_arm_share=0.0,
        )
        life = Life(changed(aim=aim))
        life.state("localizing")
        life.cue("target", target="led_2")
        azimuth, elevation = life.error(life.run(3.0), LED_2)
        assert azimuth == pytest.approx(0.0, abs=0.01)
        assert elevation == pytest.approx(10.0, abs=0.01)
