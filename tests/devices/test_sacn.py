"""The package sacn receives what the output for E1.31 sends to one address."""

import asyncio
import functools
import importlib
import random
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

from pointit.plugins import Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output.dmx.e131 import E131Config, make_e131
from tests.support.bench import until
from tests.support.buses import free_udp_port

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
    port, chance = free_udp_port(), random.Random(1)
    config = E131Config(host="127.0.0.1", port=port, universe=UNIVERSES[0], gamma=1.0)
    output = make_e131(config, Surroundings.detached())
    output.set_strips([STRIP])
    async with listening(port) as listener:
        task = asyncio.create_task(output.run())
        for _ in range(5):
            shown = chance.randbytes(3 * PIXELS)
            output.show(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=shown),)))
            await until(functools.partial(listener.shows, shown))
        task.cancel()
        await asyncio.wait({task})
        await until(lambda: {(universe, "timeout") for universe in UNIVERSES} <= {*listener.states})
        assert listener.shows(bytes(3 * PIXELS))
