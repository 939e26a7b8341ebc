"""The maker's own client and messages of watches."""

import asyncio
import contextlib
import json
import math
import random
import socket
import subprocess
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard

import pytest
from bumble.controller import Controller
from bumble.link import LocalLink
from bumble.transport.tcp_server import open_tcp_server_transport_with_socket

from pointit.geometry.rotation import Quaternion, normalized
from pointit.runtime.virtual_time import run_virtually
from pointit.services.imu_bridge.ble.touch_sdk import TOUCH_SDK
from pointit.services.imu_bridge.ble.touch_sdk_messages import (
    OUTPUT,
    decode_update,
    encode_client_info,
    encode_haptic,
)
from pointit.services.imu_bridge.sources import Press, RawReading, Reading, StepGesture
from pointit_lab.devices.wrists.touch_sdk_watch import DISCONNECT, SimulatedTouchSdkWatch
from tests.devices.ble_session import worn
from tests.devices.bumble_wrist import BumbleWrist, virtual_device
from tests.support.bench import until

HERE = Path(__file__).parent
SAMPLES = 200
PINCH = "12020801"
CLOCKWISE = "2a0b08ffffffffffffffffff01"
COUNTERCLOCKWISE = "2a020801"
EVENTS = {20: PINCH, 50: CLOCKWISE, 51: COUNTERCLOCKWISE, 52: CLOCKWISE, 90: PINCH, 120: PINCH + CLOCKWISE}
"""Events that are added to messages, by their number."""
VIBRATION = "0a0a0801150000003f18ac02"
Line = list[Any]


def orientations() -> list[Quaternion]:
    source = random.Random(3)
    return [normalized(tuple(source.gauss(0.0, 1.0) for _ in range(4))) for _ in range(SAMPLES)]  # pyrefly: ignore[bad-argument-type]


def messages(watch: SimulatedTouchSdkWatch) -> list[bytes]:
    """Return messages with one frame each, since the maker's client needs one; some with an event."""
    return [
        watch.frame(each) + bytes.fromhex(EVENTS.get(number, ""))
        for number, each in enumerate(orientations())
    ]


class MakerClient:
    """Lines that the maker's client has printed."""

    def __init__(self) -> None:
        self.lines: list[Line] = []

    def of(self, name: str) -> list[Line]:
        return [line[1:] for line in self.lines if line[0] == name]


@asynccontextmanager
async def maker_client(
    python: Path, watch: SimulatedTouchSdkWatch
) -> AsyncGenerator[tuple[BumbleWrist, MakerClient]]:
    """Run the maker's client beside a watch, which does not advertise yet."""
    link = LocalLink()
    wrist = BumbleWrist(await virtual_device(link, watch.name), watch)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        transport = await open_tcp_server_transport_with_socket(listener)
        Controller("maker", transport.source, transport.sink, link=link, public_address="F0:F1:F2:F3:F4:F5")
        process = await asyncio.create_subprocess_exec(
            f"{python}", f"{HERE / 'maker_client.py'}", f"{port}", stdout=asyncio.subprocess.PIPE
        )
        client = MakerClient()
        reading = asyncio.create_task(read(process.stdout, client))
        try:
            yield wrist, client
        finally:
            await wrist.vanish()
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
            await reading
            await transport.close()
            await wrist.device.power_off()


async def read(stream: asyncio.StreamReader | None, client: MakerClient) -> None:
    assert stream is not None
    async for line in stream:
        client.lines.append(json.loads(line))


async def play(wrist: BumbleWrist, sent: Sequence[bytes]) -> None:
    for message in sent:
        await wrist.send(OUTPUT, message)
        await asyncio.sleep(0.005)


async def our_items(kind: type[Any], parameters: dict[str, object], sent: Sequence[bytes]) -> list[Any]:
    """Return the readings, presses and steps of our source."""
    watch = SimulatedTouchSdkWatch("pending")
    async with worn(TOUCH_SDK, watch, parameters=parameters) as session:
        await session.until(lambda: bool(watch.inputs))
        await play(session.wrist, sent)
        await session.until(lambda: len(session.of(kind)) == len(sent))
        return [item for _, item in session.items if isinstance(item, kind | Press | StepGesture)]


async def test_makers_client_and_our_source_agree_sample_by_sample(
    touch_sdk_python: Path,
) -> None:
    watch = SimulatedTouchSdkWatch("pending", hand="left")
    sent = messages(watch)
    async with maker_client(touch_sdk_python, watch) as (wrist, client):
        await wrist.appear()
        await until(lambda: wrist.is_subscribed, what="a subscription")
        assert len(watch.inputs) == 1  # it introduces itself before
        await play(wrist, sent)
        await until(lambda: len(client.of("sensors")) == SAMPLES, what=lambda: f"{len(client.lines)} lines")
        await until(lambda: [each.hex() for each in watch.inputs[1:]] == [VIBRATION] * 3, what="vibrations")
        assert client.of("connect") == [[2, 74, [454.0, 454.0]]]
        assert len(client.of("tap")) == 3
        directions = [direction for (direction,) in client.of("rotary")]
    theirs = sorted(client.of("sensors"), key=lambda line: int(line[3]))

    def ours(kind: type[Any], **parameters: object) -> list[Any]:
        found: list[Any] = []

        async def run() -> None:
            found.extend(await our_items(kind, parameters, sent))

        run_virtually(run())
        return found

    items = await asyncio.to_thread(ours, Reading)
    readings = [each for each in items if isinstance(each, Reading)]
    for (_, _, orientation, unix_ms), reading in zip(theirs, readings, strict=True):
        assert reading.world_from_sensor == pytest.approx(orientation, abs=1e-6)
        assert reading.device_time_ns == unix_ms * 1_000_000
    assert sum(isinstance(each, Press) for each in items) == len(client.of("tap"))
    assert [each.by for each in items if isinstance(each, StepGesture)] == directions
    raw = await asyncio.to_thread(ours, RawReading, orientation="fusion")
    for (rate, acceleration, _, _), item in zip(theirs, filter(is_raw, raw), strict=True):
        assert [*item.angular_velocity_radps] == rate
        assert [*item.acceleration_mps2] == acceleration
        assert math.hypot(*acceleration) == pytest.approx(9.80665, abs=1e-4)


def is_raw(item: object) -> TypeGuard[RawReading]:
    return isinstance(item, RawReading)


async def test_the_makers_client_ends_a_declined_connection_and_comes_again(touch_sdk_python: Path) -> None:
    watch = SimulatedTouchSdkWatch("pending")
    async with maker_client(touch_sdk_python, watch) as (wrist, client):
        await wrist.appear()
        for count in (1, 2):
            await until(partial(is_connected_again, wrist, count), what="a subscription")
            await wrist.send(OUTPUT, DISCONNECT)
        await until(partial(is_connected_again, wrist, 3), what="a third connection")
        await play(wrist, messages(watch)[:3])
        await until(lambda: len(client.of("sensors")) == 3, what="sensors")
        assert len(watch.inputs) == 1  # it introduces itself once only


def is_connected_again(wrist: BumbleWrist, count: int) -> bool:
    """Return True if the connection number `count` is subscribed to notifications."""
    return wrist.connections == count and wrist.is_subscribed


VALID = 10_000
DAMAGED = 20_000


def lines(python: Path, *arguments: str) -> list[Any]:
    """Return the lines that `maker_messages.py` prints."""
    command = (f"{python}", f"{HERE / 'maker_messages.py'}", *arguments)
    done = subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def text_of(content: object) -> str:
    """Return `content` as a text that tells -0 from 0 and is equal for two NaN."""
    return json.dumps(content, sort_keys=True)


@pytest.mark.timeout(600)
def test_messages_decode_as_the_makers_or_raise_value_error_if_damaged(
    touch_sdk_python: Path,
) -> None:
    messages = lines(touch_sdk_python, "1", f"{VALID}", f"{DAMAGED}")
    assert len(messages) == VALID + DAMAGED
    assert all(content is not None for _, content in messages[:VALID])

    both = 0
    for data, content in messages[:VALID]:
        assert text_of(asdict(decode_update(bytes.fromhex(data)))) == text_of(content), data

    for data, content in messages[VALID:]:
        try:
            decoded = asdict(decode_update(bytes.fromhex(data)))
        except ValueError:
            continue
        if content is not None:
            both += 1
            assert text_of(decoded) == text_of(content), data
    assert both > DAMAGED / 20


def test_inputs_are_byte_for_byte_those_of_the_makers_classes(touch_sdk_python: Path) -> None:
    encoders: dict[str, Callable[..., bytes]] = {"haptic": encode_haptic, "client_info": encode_client_info}
    for data, name, arguments in lines(touch_sdk_python, "inputs"):
        assert encoders[name](*arguments).hex() == data
