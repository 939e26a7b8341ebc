"""Lights: DDP and E1.31 decoded by packages of others, Adalight as sketches read it; the search for WLED."""

import asyncio
import contextlib
import functools
import importlib
import random
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Any

import pytest
from zeroconf.asyncio import AsyncZeroconf

import pointit
from pointit.api.site import Site
from pointit.plugins import FoundDevice, Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output.ddp import find_wled, read_info
from pointit.services.led_driver.output.e131 import E131Config, make_e131
from pointit.services.led_driver.outputs import GuardedOutput
from pointit.testing import UdpDevice
from tests.support.bench import background, until
from tests.support.buses import free_udp_port
from tests.support.hostile_server import Chunks, forever, hostile_server
from tests.support.pace import Patience
from tests.support.wled import Packet, announcement, served_info

FRAMES = 40
MIXED = (
    {"strip": "0", "reversed": True, "order": "GRB", "offset": 500},
    {"strip": "1", "first": 100, "offset": 10},
    {"strip": "1", "pixels": 100, "offset": 200},
)


class Controller(UdpDevice):
    """Pixels that are shown whenever a packet tells to."""

    def frames(self) -> list[bytes]:
        """Return all bytes at each push."""
        pixels = bytearray()
        shown = list[bytes]()
        for datagram in self.datagrams:
            packet = Packet.from_bytes(datagram)
            start = packet.header.offset
            end = packet.header.offset + packet.header.length
            assert packet.header.length == len(packet.data) <= 1440
            pixels.extend(bytes(max(0, end - len(pixels))))
            pixels[start:end] = packet.data
            if packet.header.packet_type.push:
                shown.append(bytes(pixels))
        return shown


Pixels = tuple[int, ...]


def mixed(strips: dict[str, list[Pixels]]) -> bytes:
    """Return the bytes that `MIXED` stands for, computed pixel by pixel."""
    pixels: list[Pixels] = [(0, 0, 0)] * 650
    for number in range(150):
        red, green, blue = strips["0"][149 - number]
        pixels[500 + number] = (green, red, blue)
    for number in range(50):
        pixels[10 + number] = strips["1"][100 + number]
    for number in range(100):
        pixels[200 + number] = strips["1"][number]
    return b"".join(map(bytes, pixels))


async def test_published_frames_arrive_pixel_for_pixel_on_two_outputs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    published = Published(monkeypatch)
    first = Controller()
    second = Controller()
    outputs: list[dict[str, object]] = [
        {"kind": "ddp", "host": "127.0.0.1", "port": first.port, "segments": MIXED},
        {
            "kind": "ddp",
            "host": "localhost",
            "port": second.port,
            "segments": [{"strip": "1", "order": "RGBW"}],
        },
    ]
    for device in (first, second):
        await device.plug()
    async with scenario_3(
        outputs, lambda: all(len(set(device.frames())) > FRAMES for device in (first, second))
    ):
        pass

    await until(lambda: not any(any(device.frames()[-1]) for device in (first, second)))
    require_shown(first.frames(), [mixed(strips) for strips in published])
    white = [b"".join(bytes((*pixel, 0)) for pixel in strips["1"]) for strips in published]
    require_shown(second.frames(), white)
    types = {str(Packet.from_bytes(each).header.pixel_config.data_type.name) for each in second.datagrams}
    assert types == {"RGBW"}

    for device in (first, second):
        await device.unplug()
        device.close()


class Published:
    """Frames in their order, without repetitions."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.frames: list[StripsFrame] = []
        show = GuardedOutput.show

        def note(output: GuardedOutput, frame: StripsFrame, age_s: float = 0.0) -> None:
            if self.frames[-1:] != [frame]:
                self.frames.append(frame)
            show(output, frame, age_s)

        monkeypatch.setattr(GuardedOutput, "show", note)

    def __iter__(self) -> Iterator[dict[str, list[Pixels]]]:
        """Yield the pixels of each strip of each frame."""
        for frame in self.frames:
            yield {
                strip.id: [tuple(strip.rgb[at : at + 3]) for at in range(0, len(strip.rgb), 3)]
                for strip in frame.strips
            }


@asynccontextmanager
async def scenario_3(
    outputs: Sequence[Mapping[str, object]], is_enough: Callable[[], bool]
) -> AsyncGenerator[Site]:
    """Run scenario_3 with LED outputs until `is_enough`."""
    plain = [{"gamma": 1.0, **output} for output in outputs]
    async with pointit.run("scenario_3", seed=1, settings={"led-driver.outputs": plain}) as site:
        yield site
        await until(is_enough, 20)
    await asyncio.sleep(0)


def require_shown(shown: Sequence[bytes], published: Sequence[bytes]) -> None:
    """Check that `shown` are some of `published` in their order, each several times, and dark in the end."""
    assert shown, "nothing arrived"
    dark = bytes(len(shown[0]))
    assert shown[-1] == dark
    rest = iter([dark, *published])
    now: bytes | None = next(rest)
    for number, frame in enumerate(shown[:-1]):
        while frame != now:
            now = next(rest, None)
            assert now is not None, f"frame {number} was not published, or not then"


PIXELS = 300
STRIP = Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=PIXELS)
UNIVERSES = (7, 8)
sacn: Any = importlib.import_module("sacn")  # it has no types


class Listener:
    """Slots and states of the universes, as a receiver reports them in its own thread."""

    def __init__(self) -> None:
        self.slots = dict.fromkeys(UNIVERSES, b"")
        self.states: list[tuple[int, str]] = []

    def on_packet(self, packet: Any) -> None:
        self.slots[packet.universe] = bytes(packet.dmxData)

    def on_availability(self, universe: int, changed: str) -> None:
        self.states.append((universe, changed))

    def shows(self, pixels: bytes) -> bool:
        return (self.slots[7][:510] + self.slots[8])[: 3 * PIXELS] == pixels


@asynccontextmanager
async def listening(port: int) -> AsyncGenerator[Listener]:
    listener = Listener()
    receiver = sacn.sACNreceiver(bind_address="127.0.0.1", bind_port=port)
    receiver.register_listener("availability", listener.on_availability)
    for universe in UNIVERSES:
        receiver.register_listener("universe", listener.on_packet, universe=universe)
    receiver.start()
    yield listener
    await asyncio.to_thread(receiver.stop)


async def test_frames_arrive_and_the_end_of_the_stream_is_noticed() -> None:
    port = free_udp_port()
    chance = random.Random(1)
    config = E131Config(host="127.0.0.1", port=port, universe=UNIVERSES[0], gamma=1.0)
    output = make_e131(config, Surroundings.detached())
    output.set_strips([STRIP])
    async with listening(port) as listener:
        async with background(output.run()):
            for _ in range(5):
                shown = chance.randbytes(3 * PIXELS)
                output.show(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=shown),)))
                await until(functools.partial(listener.shows, shown))
        await until(lambda: {(universe, "timeout") for universe in UNIVERSES} <= {*listener.states})
        assert listener.shows(bytes(3 * PIXELS))


@pytest.fixture
def web_port() -> Iterator[int]:
    with served_info() as port:
        yield port


async def write_garbage(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    del reader
    writer.write(b"garbage\r\n\r\n")
    writer.close()


async def write_for_ever(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while not reader.at_eof():
        writer.write(b"H")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(0.1):
                await reader.read()
    writer.close()


INFOS: dict[str, Chunks] = {
    "endless": forever(b"x" * 65536, b"HTTP/1.1 200 OK\r\n\r\n"),
    "endless headers": forever(b"a: b\r\n" * 1000, b"HTTP/1.1 200 OK\r\n"),
    "nested": lambda _: [b"HTTP/1.1 200 OK\r\n\r\n" + b"[" * 60_000],
    "a number": lambda _: [b"HTTP/1.1 200 OK\r\n\r\n" + b"9" * 60_000],
    "a redirect": lambda _: [b"HTTP/1.1 302 Found\r\nLocation: /json/info\r\n\r\n"],
    "no text": lambda _: [b"HTTP/1.1 200 OK\r\n\r\n\xff\xff"],
}


@pytest.mark.parametrize("info", INFOS.values(), ids=INFOS.keys())
async def test_description_of_a_controller_is_read_up_to_its_limit(info: Chunks) -> None:
    with hostile_server(info) as server:
        assert await read_info("127.0.0.1", server.port) is None
        assert await asyncio.to_thread(server.closed.wait, 30)
        assert len(server.requests) == 1
    assert server.sent < 16_000_000


async def test_controller_is_found_beside_others_that_answer_nonsense(web_port: int) -> None:
    async with (
        await asyncio.start_server(write_garbage, "127.0.0.1") as garbage,
        await asyncio.start_server(write_for_ever, "127.0.0.1") as slow,
        AsyncZeroconf() as announcer,
    ):
        ports = {"wled-test": web_port} | {
            f"wled-{name}": server.sockets[0].getsockname()[1]
            for name, server in (("garbage", garbage), ("slow", slow))
        }
        for name, port in ports.items():
            await (await announcer.async_register_service(announcement(name, port)))
        names = {"Kitchen, 120 pixels, WLED 0.15.1", "wled-garbage", "wled-slow"}
        patience = Patience(60.0)
        found = dict[str, FoundDevice]()
        while not names <= found.keys():
            assert not patience.is_over(), found
            found = {each.label: each for each in await find_wled(3.0)}
    kitchen = found["Kitchen, 120 pixels, WLED 0.15.1"]
    assert kitchen.address in ("127.0.0.1", "wled-test.local")
    assert kitchen.details == {"pixels": 120, "version": "0.15.1"}
