"""Lamps from two places of which only the walk between them is known."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.scan.paced import locate_paced
from pointit.scan.paced_model import FIRST, SECOND, USUAL_M, PacedRay, PacedRoom, paced_ray

EYES_M = 1.6
SECOND_M = (0.2, 2.1)
LAMPS: dict[str, Vec3] = {
    "desk": (3.0, 0.5, 0.9),
    "shelf": (2.4, -1.6, 1.9),
    "door": (3.5, 2.4, 2.1),
    "floor": (1.8, 1.2, 0.4),
}


def angles(lamp: Vec3, place_m: tuple[float, float]) -> tuple[float, float]:
    """Return azimuth and elevation of a lamp as seen from the eyes at a place."""
    x, y, z = lamp[0] - place_m[0], lamp[1] - place_m[1], lamp[2] - EYES_M
    return math.atan2(y, x), math.atan2(z, math.hypot(x, y))


def press(name: str, place: str, azimuth: float, elevation: float, reach: float | None = None) -> PacedRay:
    """Return a press in the direction of two angles."""
    level = math.cos(elevation)
    direction = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    return paced_ray(name, place, (0.0, 0.0, EYES_M), direction, reach)


def presses(
    *,
    drift: float = 0.0,
    azimuth_bias: float = 0.0,
    elevation_bias: float = 0.0,
    at_second: Mapping[str, str] = {},
) -> list[PacedRay]:
    """Return a press at each lamp from both places; `at_second`: lamps that are mistaken there."""
    rays: list[PacedRay] = []
    for place, place_m in ((FIRST, (0.0, 0.0)), (SECOND, SECOND_M)):
        for name in LAMPS:
            seen = at_second.get(name, name) if place == SECOND else name
            azimuth, elevation = angles(LAMPS[seen], place_m)
            turn = azimuth_bias + (drift if place == SECOND else 0.0)
            rays.append(press(name, place, azimuth + turn, elevation + elevation_bias))
    return rays


def direction_errors(
    room: PacedRoom, place_m: tuple[float, float], mapped_m: tuple[float, float]
) -> list[float]:
    """Return the error (°) of each direction in the map as seen from a place, after the best yaw."""
    off: list[tuple[float, float]] = []
    for name, lamp in LAMPS.items():
        azimuth, elevation = angles(lamp, place_m)
        in_map = angles(room.targets[name].position_m, mapped_m)
        off.append((math.remainder(in_map[0] - azimuth, math.tau), in_map[1] - elevation))
    yaw = float(np.median([each[0] for each in off]))
    return [math.degrees(math.hypot(azimuth - yaw, elevation)) for azimuth, elevation in off]


def test_exact_presses_give_the_shape_of_the_room() -> None:
    room = locate_paced(presses())
    second_m = room.places_m[1]

    assert max(direction_errors(room, (0.0, 0.0), (0.0, 0.0))) < 0.3
    assert max(direction_errors(room, SECOND_M, second_m)) < 0.3
    middle_m = (second_m[0] / 2, second_m[1] / 2)
    assert max(direction_errors(room, (SECOND_M[0] / 2, SECOND_M[1] / 2), middle_m)) < 0.5
    assert not any(target.reason for target in room.targets.values())


def test_drift_on_the_walk_bends_no_direction() -> None:
    room = locate_paced(presses(drift=math.radians(3.0)))
    assert max(direction_errors(room, (0.0, 0.0), (0.0, 0.0))) < 1.0
    assert max(direction_errors(room, SECOND_M, room.places_m[1])) < 1.0


def test_common_error_of_the_person_stays_in_the_map() -> None:
    room = locate_paced(presses(azimuth_bias=math.radians(4.0)))
    azimuth = math.atan2(*room.targets["desk"].position_m[1::-1])
    assert math.degrees(azimuth - angles(LAMPS["desk"], (0.0, 0.0))[0]) == pytest.approx(4.0, abs=0.5)


def test_paced_target_has_plausible_sigmas_of_direction_and_position() -> None:
    target = locate_paced(presses()).targets["desk"]
    assert all(1.0 < math.degrees(sigma) < 4.0 for sigma in target.direction_sigmas_rad)
    assert len(target.direction_sigmas_rad) == 3
    assert 0.2 < target.sigma_m < 1.2


def test_two_swapped_lamps_are_named_with_a_reason() -> None:
    room = locate_paced(presses(at_second={"desk": "shelf", "shelf": "desk"}))
    contradicting = {name for name, target in room.targets.items() if target.reason}
    assert contradicting
    assert contradicting <= {"desk", "shelf"}


def test_one_wrong_press_is_named_and_no_other_lamp() -> None:
    room = locate_paced(presses(at_second={"shelf": "door"}))
    assert [name for name, target in room.targets.items() if target.reason] == ["shelf"]


def test_press_after_a_short_way_counts_more() -> None:
    rays: list[PacedRay] = []
    for ray in presses():
        if ray.place == FIRST:
            azimuth, elevation = angles(LAMPS[ray.target], (0.0, 0.0))
            wrong = press(ray.target, FIRST, azimuth + math.radians(8.0), elevation, reach=1.0)
            rays += [wrong, press(ray.target, FIRST, azimuth, elevation, reach=0.0)]
    room = locate_paced(rays)
    x, y, _ = room.targets["desk"].position_m
    assert math.degrees(math.atan2(y, x) - angles(LAMPS["desk"], (0.0, 0.0))[0]) < 1.5, "half of 8 is 4"


def test_first_press_after_a_wide_reach_contradicts_no_other() -> None:
    azimuth, elevation = angles(LAMPS["desk"], (0.0, 0.0))
    wide = press("desk", FIRST, azimuth + math.radians(16.0), elevation, reach=1.0)
    rays = [wide, *(replace(ray, azimuth_sigma_rad=0.03) for ray in presses())]
    room = locate_paced(rays)
    assert not any(target.reason for target in room.targets.values())


def test_one_place_gives_directions_at_the_usual_distance() -> None:
    room = locate_paced([ray for ray in presses() if ray.place == FIRST])
    assert room.places_m == ((0.0, 0.0),)
    assert max(direction_errors(room, (0.0, 0.0), (0.0, 0.0))) < 0.2
    for name, target in room.targets.items():
        distance_m = math.hypot(*target.position_m[:2])
        if name == "floor":  # at the usual distance it would be below the floor
            assert distance_m < USUAL_M
            assert target.position_m[2] > 0.1
        else:
            assert distance_m == pytest.approx(USUAL_M, abs=0.05)
            assert target.sigma_m > 1.0
        assert not target.reason


def test_presses_from_the_second_place_alone_are_refused() -> None:
    with pytest.raises(RefusedError, match="first place"):
        locate_paced([ray for ray in presses() if ray.place == SECOND])
