"""OLA receives what the outputs for E1.31 and Art-Net send, pixel for pixel, and answers a search."""

import asyncio
import functools
import math
import random
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager
from typing import Any

import pytest
import pytest_asyncio

import pointit
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.plugins import GROUPS, Surroundings
from pointit.schemas import Cursor, Strip, StripFrame, StripsFrame
from pointit.schemas.base import Rgb
from pointit.services.led_driver.output import artnet
from pointit.services.led_driver.output.artnet import find_nodes
from pointit.services.led_driver.output.spotlight import Angles, Spotlight, SpotlightConfig
from pointit.services.led_driver.output.udp_output import UdpOutput
from tests.devices.ola import ARTNET_AT, Ola, running_ola
from tests.support.bench import background

STRIPS = (
    Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=150),
    Strip(id="b", line_m=((0, 0, 0), (1, 0, 0)), pixels=151),
)
FIRST = 510
"""Bytes of the first universe, 170 pixels."""
UNIVERSES = {"e131": (1, 2), "artnet": (ARTNET_AT, ARTNET_AT + 1)}
"""OLA's universes of the outputs' first two."""
SHOWN = 12


@pytest.fixture(scope="module")
def addresses() -> Generator[tuple[str, str, str]]:
    with running_ola() as made:
        yield made


@pytest_asyncio.fixture
async def ola(addresses: tuple[str, str, str]) -> AsyncGenerator[Ola]:
    made = Ola(*addresses)
    yield made
    await made.close()


@asynccontextmanager
async def sending(kind: str, **parameters: Any) -> AsyncGenerator[UdpOutput]:
    plugin = GROUPS["led-output"].get(kind)
    config = plugin.config.model_validate({"gamma": 1.0, **parameters})
    output: UdpOutput = plugin.make(config, Surroundings.detached())
    output.set_strips(STRIPS)
    async with background(output.run()):
        yield output


def frame(chance: random.Random) -> StripsFrame:
    pixels = [StripFrame(id=strip.id, rgb=chance.randbytes(3 * strip.pixels)) for strip in STRIPS]
    return StripsFrame(stamp_ns=1, strips=tuple(pixels))


def begins(wanted: bytes, slots: bytes) -> bool:
    return slots.startswith(wanted)


def is_dark(slots: bytes) -> bool:
    return not any(slots)


@pytest.mark.parametrize("kind", ["e131", "artnet", "multicast"])
async def test_frames_arrive_pixel_for_pixel_and_the_last_is_dark(ola: Ola, kind: str) -> None:
    chance = random.Random(kind)
    parameters = {"host": ola.address}
    if kind == "multicast":
        kind = "e131"
        parameters = {"host": "multicast", "interface": ola.gate}
    first, second = UNIVERSES[kind]
    async with sending(kind, **parameters) as output:
        for _ in range(SHOWN):
            shown = frame(chance)
            output.show(shown)
            pixels = b"".join(strip.rgb for strip in shown.strips)
            await ola.until(first, functools.partial(begins, pixels[:FIRST]))
            await ola.until(second, functools.partial(begins, pixels[FIRST:]))

    for universe in (first, second):
        await ola.until(universe, is_dark)


async def test_beam_of_a_moving_head_follows_the_scenario_3_cursor(
    ola: Ola, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = SpotlightConfig(
        host=ola.address, universe=3, position_m=(2.0, 1.0, 3.0), pan_speed_degps=2000,
        tilt_speed_degps=2000, dark_beyond_deg=1.0,
    )  # fmt: skip
    cursors_m: list[Vec3] = []
    show_cursor = Spotlight.show_cursor

    def record(head: Spotlight, user: str, cursor: Cursor | None, color: Rgb) -> None:
        if cursor is not None and cursor.point_m is not None:
            cursors_m.append(cursor.point_m)
        show_cursor(head, user, cursor, color)

    monkeypatch.setattr(Spotlight, "show_cursor", record)
    outputs = [config.model_dump(mode="json", exclude_defaults=True) | {"kind": "spotlight"}]
    seen = set[bytes]()
    async with pointit.run("scenario_3", seed=1, settings={"led-driver.outputs": outputs}):
        async with asyncio.timeout(90):
            while len(seen) < SHOWN:
                seen.add((await ola.until(3, lambda slots: slots[4:5] == b"\xff"))[:4])
    for slots in seen:
        beam = config.mounting.beam(angles_of(slots, config))
        ways = [vector.subtract(point_m, config.position_m) for point_m in cursors_m]
        assert min(vector.angle_between(beam, way) for way in ways) < math.radians(1.1)
    slots = await ola.until(3, lambda slots: is_dark(slots[4:]))
    assert any(slots[:4])  # the head stays where it is


def angles_of(slots: bytes, config: SpotlightConfig) -> Angles:
    pan, tilt = (int.from_bytes(slots[at : at + 2], "big") / 0xFFFF - 0.5 for at in (0, 2))
    return Angles(pan * math.radians(config.pan_range_deg), tilt * math.radians(config.tilt_range_deg))


async def test_search_finds_a_node_with_its_outputs(ola: Ola, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(artnet, "broadcast_addresses", lambda: [ola.broadcast])
    (found,) = await find_nodes(2.0)
    assert found.address == ola.address
    assert found.label == "OLA in a test, universes 0, 1, 2"
