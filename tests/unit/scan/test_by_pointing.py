"""Positions by pointing."""

import asyncio
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.maps.point import CORNERS, PointingSession, target_name
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import NoMessageError, RefusedError
from pointit.scan.by_pointing import TargetRay, box_of, locate, pointing_of, screen_of
from pointit.scan.result import pointed_text
from pointit.schemas import ButtonEvent, PointingRay, UserPose
from pointit.schemas.topics import BUTTON, POSE, RAY
from tests.support.bench import memory_bench

EYES: tuple[Vec3, ...] = ((-1.5, 0.0, 1.6), (1.5, 0.0, 1.6), (0.0, -1.0, 1.6))
LAMPS: dict[str, Vec3] = {"a": (-0.5, 2.0, 1.0), "b": (0.4, 2.2, 1.9), "c": (0.0, 1.5, 0.5)}


def pointed(lamp: Vec3, eyes: Vec3, azimuth_rad: float = 0.0, elevation_rad: float = 0.0) -> Vec3:
    """Return the direction from `eyes` to `lamp` with errors."""
    x, y, z = np.subtract(lamp, eyes)
    azimuth = math.atan2(y, x) + azimuth_rad
    elevation = math.atan2(z, math.hypot(x, y)) + elevation_rad
    level = math.cos(elevation)
    return (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))


def survey(places: int, bias: tuple[float, float] = (0.0, 0.0), people: int = 1) -> list[TargetRay]:
    """Return rays to all lamps from the first `places` places."""
    return [
        TargetRay(name, f"p{person}", str(place), eyes, pointed(lamp, eyes, *bias))
        for person in range(people)
        for place, eyes in enumerate(EYES[:places])
        for name, lamp in LAMPS.items()
    ]


@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08))
def test_persons_common_bias_is_found_and_removed(azimuth: float, elevation: float) -> None:
    found = locate(survey(3, (azimuth, elevation)))
    for name, lamp in LAMPS.items():
        assert math.dist(found[name].position_m, lamp) < max(0.01, 2 * found[name].sigma_m)


def test_places_60_degrees_apart_suffice_and_nearer_need_a_third() -> None:
    assert not locate(survey(2))["a"].reason
    near = [
        TargetRay("a", "p", str(x), (x, 0.0, 1.6), pointed(LAMPS["a"], (x, 0.0, 1.6))) for x in (0.0, 0.5)
    ]
    assert "third place" in locate(near)["a"].reason


def test_one_place_is_not_enough() -> None:
    assert "one place only" in locate(survey(1))["a"].reason


def test_sigma_falls_with_a_further_place() -> None:
    assert locate(survey(3))["a"].sigma_m < locate(survey(2))["a"].sigma_m


def test_rays_to_different_things_are_noticed() -> None:
    rays = survey(2)
    rays[0] = TargetRay("a", "p0", "0", EYES[0], pointed((3.0, 2.0, 3.0), EYES[0]))
    assert locate(rays)["a"].reason


def test_nothing_pointed_at_is_refused() -> None:
    with pytest.raises(RefusedError):
        locate([])


def test_a_ray_is_turned_into_the_room_by_the_pose() -> None:
    ray = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
    pose = UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=math.pi / 2)
    found = pointing_of("a", "anna", "1", [ray], pose)
    assert found.origin_m == pytest.approx((1.0, 2.0, 1.6))
    assert found.direction == pytest.approx((0.0, 1.0, 0.0))


def test_box_is_located_by_three_top_corners_and_one_below() -> None:
    yaw = math.radians(30)
    along = np.array([math.cos(yaw), math.sin(yaw)])
    across = np.array([-math.sin(yaw), math.cos(yaw)])
    corners: list[Vec3] = [
        (float(x), float(y), z)
        for (x, y), z in (
            (0 * along, 1.0),
            (0.8 * along, 1.0),
            (0.8 * along + 0.4 * across, 1.0),
            (0 * along, 0.2),
        )
    ]
    box = box_of(corners)

    assert sorted(box.size[:2]) == pytest.approx([0.4, 0.8], abs=0.01)
    assert box.size[2] == pytest.approx(0.8)
    assert box.yaw_deg % 90 == pytest.approx(30, abs=0.2)


def test_a_table_is_level_and_a_screen_upright() -> None:
    assert screen_of([(0, 0, 0.75), (1.2, 0, 0.77), (1.2, 0.6, 0.74)]).normal == pytest.approx((0, 0, 1))
    screen = screen_of([(0, 2, 1.0), (1.2, 2.05, 1.02), (1.2, 2.0, 1.7)])
    assert screen.normal[2] == pytest.approx(0.0)
    assert sorted(screen.size or ()) == pytest.approx([0.7, 1.2], abs=0.03)


@pytest.mark.parametrize("corners", [[], [(0, 0, 0)] * 4, [(0, 0, 0), (1, 0, 0), (2, 0, 0)]])
def test_corners_that_span_nothing_are_refused(corners: list[Vec3]) -> None:
    for made in (box_of, screen_of):
        with pytest.raises(RefusedError):
            made(corners)


async def test_session_asks_for_places_until_the_map_is_complete() -> None:
    async with memory_bench() as bench:
        told: list[str] = []
        place = -1

        def stand() -> None:
            nonlocal place
            place += 1
            x, y, _ = EYES[place]
            bench.put(POSE, UserPose(stamp_ns=place + 1, position_m=(x, y, 0.0), yaw_rad=0.0), "anna")

        def obey(text: str) -> None:
            told.append(text)
            if "another position" in text:
                stand()
            elif "point at" in text:
                lamp = next(lamp for name, lamp in LAMPS.items() if f"at {name} " in text)
                loop = asyncio.get_running_loop()
                ray = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 1.6), direction=pointed(lamp, EYES[place]))
                loop.call_later(0.01, bench.put, RAY, ray, "anna")
                loop.call_later(0.02, bench.put, BUTTON, ButtonEvent(stamp_ns=1), "anna")

        session = PointingSession(bench.bus, "anna", obey)
        stand()
        found = await session.run(list(LAMPS), CORNERS["lamp"])
        assert sum("point at" in text for text in told) == 6
        text = pointed_text({name: [found[name]] for name in LAMPS}, "lamp")
        assert text.startswith('lamps:\n  "a": {position: [')
        assert not any(each.reason for each in found.values())
        assert math.dist(found["a"].position_m, LAMPS["a"]) < 0.01


async def test_a_session_says_what_is_missing() -> None:
    async with memory_bench() as bench:
        session = PointingSession(bench.bus, "anna", lambda _text: session.press())
        with pytest.raises(NoMessageError, match="no pose"):
            await session.run(["a"], CORNERS["lamp"])
        bench.put(POSE, UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0), "anna")

        def press_soon(_text: str) -> None:
            asyncio.get_running_loop().call_later(0.01, session.press)

        session = PointingSession(bench.bus, "anna", press_soon)
        with pytest.raises(NoMessageError, match="no rays"):
            await session.run(["a"], CORNERS["lamp"])


def test_corners_have_names_of_their_own() -> None:
    assert [target_name("shelf", n, CORNERS["box"]) for n in range(2)] == ["shelf.1", "shelf.2"]
    assert target_name("door", 0, CORNERS["lamp"]) == "door"
