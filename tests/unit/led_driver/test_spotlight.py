"""A moving head: angles at which its beam meets a point, motion, ownership, channels, and what it sends."""

import asyncio
import math
import random
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.schemas import Cursor
from pointit.services.led_driver.output.pose_fit import fit_pose
from pointit.services.led_driver.output.spotlight import (
    DARK,
    HOME,
    Angles,
    Beam,
    BeamAim,
    BeamOwnership,
    BeamState,
    Fixture,
    HeadLimits,
    HeadMounting,
    Spotlight,
    SpotlightConfig,
    moved,
)
from pointit.testing import UdpDevice
from pointit_lab.devices.contracts.led import e131_frames
from tests.support import there
from tests.support.bench import until
from tests.support.running_source import Health
from tests.unit.led_driver.driving import receiver

RED = (255, 0, 0)
BLUE = (0, 0, 255)
WIDE = HeadLimits(math.radians(540), math.radians(270), math.radians(180), math.radians(90))
HANGING = HeadMounting.from_degrees((0.0, 0.0, 3.0), 0.0, 0.0, 180.0)
metres = st.floats(-10, 10)
degrees = st.floats(-180, 180)
mountings = st.builds(HeadMounting.from_degrees, st.tuples(metres, metres, metres), degrees, degrees, degrees)
points = st.tuples(metres, metres, metres)
reached = st.builds(Angles, st.floats(-4.7, 4.7), st.floats(-2.3, 2.3))


@given(mountings, points, reached)
def test_beam_at_the_angles_of_a_point_meets_it(mounting: HeadMounting, point_m: Vec3, start: Angles) -> None:
    way_m = vector.subtract(point_m, mounting.position_m)
    assume(vector.norm(way_m) > 0.01)
    angles = mounting.angles(point_m, start, WIDE)
    if angles is None:  # behind the base, where the head cannot turn to
        assert vector.angle_between(way_m, mounting.beam(HOME)) > WIDE.tilt_range_rad / 2 - 1e-9
        return
    assert WIDE.allow(angles)
    assert vector.angle_between(mounting.beam(angles), way_m) < 1e-6


@given(reached, st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_nearby_points_are_reached_by_a_small_turn(start: Angles, pan: float, tilt: float) -> None:
    assume(abs(start.tilt_rad) > 0.2)
    near = Angles(start.pan_rad + pan, start.tilt_rad + tilt)
    assume(WIDE.allow(near))
    angles = there(HANGING.angles(vector.add(HANGING.position_m, HANGING.beam(near)), start, WIDE))
    assert angles.pan_rad == pytest.approx(near.pan_rad, abs=1e-6)
    assert angles.tilt_rad == pytest.approx(near.tilt_rad, abs=1e-6)


def test_hanging_head_points_down_and_around() -> None:
    down = there(HANGING.angles((0.0, 0.0, 0.0), Angles(0.7, 0.3), WIDE))
    assert (down.pan_rad, down.tilt_rad) == pytest.approx((0.7, 0.0))  # any pan will do, and it stays
    aside = there(HANGING.angles((2.0, 0.0, 3.0), HOME, WIDE))
    assert (aside.pan_rad, aside.tilt_rad) == pytest.approx((0.0, math.pi / 2))
    assert HANGING.angles((0.0, 0.0, 9.0), HOME, WIDE) is None


@given(reached, reached, st.lists(st.floats(0.0, 0.5), max_size=8))
def test_motion_keeps_both_axes_speeds_and_arrives_in_time(
    start: Angles, end: Angles, steps: list[float]
) -> None:
    angles = start
    for step_s in steps:
        after = moved(angles, end, WIDE, step_s)
        assert abs(after.pan_rad - angles.pan_rad) <= WIDE.pan_speed_radps * step_s + 1e-9
        assert abs(after.tilt_rad - angles.tilt_rad) <= WIDE.tilt_speed_radps * step_s + 1e-9
        angles = after
    assert moved(angles, end, WIDE, WIDE.duration_s(start, end) + 1e-9) == end


def test_beam_is_dark_while_it_must_turn_far() -> None:
    beam = Beam(HANGING, WIDE, math.radians(20))
    beam.aim((2.0, 0.0, 3.0), RED, 0.0)
    assert beam.state(0.0) == BeamState(HOME, DARK)
    assert beam.state(0.5).color == DARK
    lit = beam.state(0.9)  # 9° before the target at 90° a second
    assert (lit.color, beam.moves) == (RED, True)
    assert beam.state(1.0).angles.tilt_rad == pytest.approx(math.pi / 2)
    assert not beam.moves


def test_beam_stays_and_is_dark_without_a_point_in_reach() -> None:
    beam = Beam(HANGING, WIDE)
    beam.aim((2.0, 0.0, 3.0), RED, 0.0)
    half = beam.state(0.5).angles
    beam.aim(None, RED, 0.5)
    assert beam.state(3.0) == BeamState(half, DARK)
    assert beam.in_reach
    beam.aim((0.0, 0.0, 9.0), RED, 3.0)
    assert beam.state(4.0) == BeamState(half, DARK)
    assert not beam.in_reach


def test_beam_belongs_to_who_began_to_point_last() -> None:
    people = BeamOwnership()
    assert people.aim is None
    people.set_cursor("ann", (1, 0, 0), RED)
    people.set_cursor("bob", (2, 0, 0), BLUE)
    people.set_cursor("ann", (3, 0, 0), RED)  # she goes on
    assert people.aim == BeamAim("bob", (2, 0, 0), BLUE)
    people.set_cursor("bob", None, BLUE)
    assert people.aim == BeamAim("ann", (3, 0, 0), RED)
    people.set_cursor("ann", None, RED)
    assert people.aim is None


def test_beam_of_a_named_person_follows_nobody_else() -> None:
    people = BeamOwnership("ann")
    people.set_cursor("bob", (2, 0, 0), BLUE)
    assert people.aim is None
    people.set_cursor("ann", (1, 0, 0), RED)
    assert people.aim == BeamAim("ann", (1, 0, 0), RED)


def slots_of(angles: Angles, **values: Any) -> bytes:
    return Fixture(SpotlightConfig.model_validate(values)).slots(BeamState(angles, RED))


def test_channels_are_those_of_the_manual_behind_the_address() -> None:
    values = slots_of(Angles(math.radians(135), math.radians(-135)), address=11, fixed_channels={9: 200})
    assert values[10:19] == bytes((0xBF, 0xFF, 0, 0, 255, 255, 0, 0, 200))
    assert len(values) == 512
    assert not any(values[:10] + values[19:])


def test_axis_is_rounded_without_fine_channel_and_mirrored_if_inverted() -> None:
    channels = {
        "pan": 2,
        "pan_fine": 0,
        "tilt": 1,
        "tilt_fine": 0,
        "dimmer": 3,
        "red": 0,
        "green": 0,
        "blue": 0,
    }
    quarter = Angles(math.radians(135), math.radians(67.5))
    assert slots_of(quarter, channels=channels)[:4] == bytes((191, 191, 255, 0))
    assert slots_of(quarter, channels=channels, invert_pan=True)[:2] == bytes((191, 64))


@pytest.mark.parametrize(
    "values",
    [
        {"universe": 0},
        {"protocol": "artnet", "universe": 40000},
        {"host": "multicast"},
        {"address": 510},
        {"fixed_channels": {5: 0}},
        {"fixed_channels": {9: 256}},
        {"channels": {"dimmer": 0, "red": 0}},
    ],
)
def test_impossible_fixtures_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SpotlightConfig.model_validate(values)


@asynccontextmanager
async def shining(device: UdpDevice) -> AsyncGenerator[Spotlight]:
    """Yield a hanging head 3 m above the room's origin, which has turned 90° within 50 ms."""
    spotlight = Spotlight(
        SpotlightConfig(host=device.host, port=device.port, tilt_range_deg=360, tilt_speed_degps=2000),
        NullHealth(),
    )
    work = asyncio.create_task(spotlight.run())
    yield spotlight
    work.cancel()
    await asyncio.wait({work})


def cursor(point_m: Vec3 | None) -> Cursor:
    return Cursor(stamp_ns=1, surface="none", point_m=point_m)


THERE = bytes((0x80, 0, 0xBF, 0xFF))
"""Pan 0, and 90° of a range of 360° of tilt."""


def newest(device: UdpDevice) -> bytes:
    return (e131_frames(bytes(device.received)) or [bytes(512)])[-1]


async def test_beam_follows_the_cursor_and_is_dark_without_one() -> None:
    async with receiver() as device:
        async with shining(device) as spotlight:
            spotlight.show_cursor("ann", cursor((2.0, 0.0, 3.0)), RED)
            await until(lambda: newest(device)[:8] == THERE + bytes((255, 255, 0, 0)))
            spotlight.show_cursor("ann", cursor(None), RED)
            await until(lambda: newest(device)[:8] == THERE + bytes(4))
            spotlight.show_cursor("ann", cursor((2.0, 0.0, 3.0)), RED)
            await until(lambda: newest(device)[:5] == THERE + bytes((255,)))
        await until(lambda: [packet[112] for packet in device.datagrams[-4:]] == [0, 0x40, 0x40, 0x40])
        assert all(packet[126:134] == THERE + bytes(4) for packet in device.datagrams[-4:])


async def test_cursor_out_of_reach_is_named_until_it_is_back() -> None:
    told = Health()
    spotlight = Spotlight(SpotlightConfig(host="head"), told)
    spotlight.show_cursor("ann", cursor((0.0, 0.0, 9.0)), RED)
    assert "cursor of ann" in told.warnings["reach head"]
    spotlight.show_cursor("ann", cursor((1.0, 0.0, 0.0)), RED)
    assert not told.warnings


LAMPS = ((0.0, 0.0, 0.5), (4.0, 0.3, 1.0), (3.5, 3.0, 0.0), (0.4, 3.2, 2.0))
SEEDS = range(6)


def mounting(chance: random.Random) -> HeadMounting:
    """Return a fixture about two metres around the room's middle, which stands, hangs or is on a wall."""
    place = (chance.uniform(0, 4), chance.uniform(0, 4), chance.uniform(1.0, 4.0))
    base = chance.choice((0.0, 90.0, 180.0))
    return HeadMounting.from_degrees(
        place, chance.uniform(-180, 180), chance.uniform(-15, 15), base + chance.uniform(-15, 15)
    )


def pointed(
    truth: HeadMounting, places: tuple[Vec3, ...], chance: random.Random, noise_rad: float
) -> list[Angles]:
    unlimited = HeadLimits(math.radians(540), math.tau, 1.0, 1.0)
    found = [truth.angles(place, HOME, unlimited) for place in places]
    assert None not in found
    return [
        Angles(each.pan_rad + chance.gauss(0, noise_rad), each.tilt_rad + chance.gauss(0, noise_rad))
        for each in found
        if each is not None
    ]


def turn_rad(a: HeadMounting, b: HeadMounting) -> float:
    w = rotation.multiply(rotation.inverse(a.world_from_fixture), b.world_from_fixture)[3]
    return 2.0 * math.acos(min(abs(w), 1.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_head_pose_is_fitted_from_four_places_despite_pointing_errors(seed: int) -> None:
    chance = random.Random(seed)
    truth = mounting(chance)
    fit = fit_pose(pointed(truth, LAMPS, chance, math.radians(0.2)), LAMPS)
    assert (fit.is_unique, fit.is_mirrored) == (True, False)
    assert fit.error_rad < math.radians(0.6)
    found = HeadMounting.from_degrees(fit.position_m, fit.yaw_deg, fit.pitch_deg, fit.roll_deg)
    assert math.dist(found.position_m, truth.position_m) < 0.15
    assert turn_rad(found, truth) < math.radians(3.0)
    for place in ((2.0, 2.0, 0.0), (1.0, 3.0, 1.0)):  # where nobody pointed
        way = vector.subtract(place, truth.position_m)
        angles = there(found.angles(place, HOME, HeadLimits(math.radians(540), math.tau, 1.0, 1.0)))
        assert vector.angle_between(truth.beam(angles), way) * vector.norm(way) < 0.05


@pytest.mark.parametrize("seed", SEEDS[:3])
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
