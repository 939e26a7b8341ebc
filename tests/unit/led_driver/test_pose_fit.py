"""The pose of a moving head from places that its beam was pointed at."""

import math
import random

import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.services.led_driver.output.spotlight.head import HOME, Angles, Limits, Mounting
from pointit.services.led_driver.output.spotlight.pose_fit import FittedPose, fit_pose

LAMPS = ((0.0, 0.0, 0.5), (4.0, 0.3, 1.0), (3.5, 3.0, 0.0), (0.4, 3.2, 2.0))
SEEDS = range(20)


def mounting(chance: random.Random) -> Mounting:
    """Return a fixture about two metres around the room's middle, which stands, hangs or is on a wall."""
    place = (chance.uniform(0, 4), chance.uniform(0, 4), chance.uniform(1.0, 4.0))
    base = chance.choice((0.0, 90.0, 180.0))
    return Mounting.from_degrees(
        place, chance.uniform(-180, 180), chance.uniform(-15, 15), base + chance.uniform(-15, 15)
    )


def pointed(
    truth: Mounting, places: tuple[Vec3, ...], chance: random.Random, noise_rad: float
) -> list[Angles]:
    unlimited = Limits(math.radians(540), math.tau, 1.0, 1.0)
    found = [truth.angles(place, HOME, unlimited) for place in places]
    assert None not in found
    return [
        Angles(each.pan_rad + chance.gauss(0, noise_rad), each.tilt_rad + chance.gauss(0, noise_rad))
        for each in found
        if each is not None
    ]


def fitted(fit: FittedPose) -> Mounting:
    return Mounting.from_degrees(fit.position_m, fit.yaw_deg, fit.pitch_deg, fit.roll_deg)


def turn_rad(a: Mounting, b: Mounting) -> float:
    w = rotation.multiply(rotation.inverse(a.world_from_fixture), b.world_from_fixture)[3]
    return 2.0 * math.acos(min(abs(w), 1.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_pose_is_found_from_four_places_pointed_at_to_a_fifth_of_a_degree(seed: int) -> None:
    chance = random.Random(seed)
    truth = mounting(chance)
    fit = fit_pose(pointed(truth, LAMPS, chance, math.radians(0.2)), LAMPS)
    assert (fit.is_unique, fit.is_mirrored) == (True, False)
    assert fit.error_rad < math.radians(0.6)
    found = fitted(fit)
    assert math.dist(found.position_m, truth.position_m) < 0.15
    assert turn_rad(found, truth) < math.radians(3.0)
    for place in ((2.0, 2.0, 0.0), (1.0, 3.0, 1.0)):  # where nobody pointed
        way = vector.subtract(place, truth.position_m)
        angles = found.angles(place, HOME, Limits(math.radians(540), math.tau, 1.0, 1.0))
        assert angles is not None
        assert vector.angle_between(truth.beam(angles), way) * vector.norm(way) < 0.05


@pytest.mark.parametrize("seed", SEEDS[:6])
def test_three_places_give_the_pose_or_say_that_another_fits(seed: int) -> None:
    chance = random.Random(seed)
    truth = mounting(chance)
    fit = fit_pose(pointed(truth, LAMPS[:3], chance, 0.0), LAMPS[:3])
    assert fit.error_rad < 1e-4
    assert not fit.is_unique or math.dist(fit.position_m, truth.position_m) < 0.01


def test_pan_that_turns_the_other_way_is_recognised() -> None:
    chance = random.Random(4)
    truth = mounting(chance)
    fit = fit_pose([each.mirrored() for each in pointed(truth, LAMPS, chance, 0.0)], LAMPS)
    assert fit.is_mirrored
    assert math.dist(fit.position_m, truth.position_m) < 0.01


def test_wrong_place_shows_in_the_error() -> None:
    chance = random.Random(1)
    angles = pointed(mounting(chance), LAMPS, chance, 0.0)
    wrong = (*LAMPS[:3], (2.0, 5.0, 0.0))
    assert fit_pose(angles, wrong).error_rad > math.radians(2.0)


def test_two_places_are_too_few() -> None:
    with pytest.raises(ValueError, match="3 needed"):
        fit_pose([HOME, HOME], LAMPS[:2])
