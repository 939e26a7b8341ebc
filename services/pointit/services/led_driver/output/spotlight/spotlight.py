"""Output to a moving head, whose beam follows the cursor of a user."""

import asyncio
import math

from pointit.runtime.service.surroundings import HealthSink
from pointit.schemas import Cursor, Environment
from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.datagram_sender import Datagram, DatagramSender, Destination
from pointit.services.led_driver.output.dmx import artnet_protocol, e131_protocol
from pointit.services.led_driver.output.dmx.artnet import ArtnetStream
from pointit.services.led_driver.output.dmx.e131 import E131Stream
from pointit.services.led_driver.output.dmx.stream import RATE_HZ, DmxStream
from pointit.services.led_driver.output.output_health import OutputHealth
from pointit.services.led_driver.output.spotlight.beam import DARK, Beam, BeamOwnership, BeamState, Fixture
from pointit.services.led_driver.output.spotlight.config import SpotlightConfig
from pointit.services.led_driver.output.spotlight.head import Angles
from pointit.services.led_driver.outputs import LedOutput


class DmxHead:
    """A moving head on its universe."""

    def __init__(self, config: SpotlightConfig, health: HealthSink) -> None:
        """Prepare; nothing is opened yet."""
        self._fixture = Fixture(config)
        self._universe = config.universe
        self._stream = _stream(config)
        self._angles = Angles(0.0, 0.0)
        self.health = OutputHealth(health, config.host)
        self._sender = DatagramSender(
            self._stream.destination,
            lambda slots, number: self._stream.frame([(self._universe, slots)], number),
            self.health,
            max_rate_hz=RATE_HZ,
            encode_end=self._end,
        )

    def send(self, state: BeamState) -> None:
        """Send the newest state."""
        self._angles = state.angles
        self._sender.send(self._fixture.slots(state))

    async def run(self) -> None:
        """Send until cancelled, then leave the head where it is, dark."""
        await self._sender.run()

    def _end(self, _slots: bytes, number: int) -> list[Datagram]:
        # a universe of zeros would turn the head to the end of its range
        dark = self._fixture.slots(BeamState(self._angles, DARK))
        return self._stream.end([(self._universe, dark)], number)


class Spotlight:
    """Turns a moving head to the cursor of the person who has the beam."""

    def __init__(self, config: SpotlightConfig, health: HealthSink) -> None:
        """Prepare; nothing is opened yet."""
        self._beam = Beam(config.mounting, config.limits, math.radians(config.dark_beyond_deg))
        self._ownership = BeamOwnership(config.user)
        self._head = DmxHead(config, health)
        self._changed = asyncio.Event()

    def set_map(self, environment: Environment) -> None:
        """Set the map, in which the fixture is not: its pose is configured."""

    def show_cursor(self, user: str, cursor: Cursor | None, color: Rgb) -> None:
        """Follow the `cursor` of `user` in their `color`, if they have the beam. Returns at once."""
        self._ownership.set_cursor(user, None if cursor is None else cursor.point_m, color)
        aim = self._ownership.aim
        now_s = asyncio.get_running_loop().time()
        self._beam.aim(aim.point_m if aim else None, aim.color if aim else DARK, now_s)
        self._changed.set()
        if aim is None or self._beam.in_reach:
            self._head.health.clear("reach")
        else:
            self._head.health.warn(
                "reach",
                f"the beam cannot reach the cursor of {aim.user}: mount it where it can, or correct its pose "
                "and its ranges of pan and tilt",
            )

    async def run(self) -> None:
        """Send until cancelled, then switch the beam off."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._head.run())
            group.create_task(self._follow())

    async def _follow(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._changed.clear()
            self._head.send(self._beam.state(loop.time()))
            if self._beam.moves:
                await asyncio.sleep(1.0 / RATE_HZ)
            else:
                await self._changed.wait()


def _stream(config: SpotlightConfig) -> DmxStream:
    if config.protocol == "artnet":
        return ArtnetStream(config.host, config.port or artnet_protocol.PORT)
    port = config.port or e131_protocol.PORT
    destination = Destination(host=config.host, port=port, interface=config.interface)
    return E131Stream(destination, config.universe)


SPOTLIGHT = LedOutput(
    summary="a moving head (E1.31, Art-Net) whose beam follows the cursor",
    config=SpotlightConfig,
    make=lambda config, around: Spotlight(config, around.health),
    argument="host",
    divided_by="universe",
    example="ADDRESS",
)
