"""IMU sources with one fault each, made from the template, and the test that must catch it."""

import asyncio
import contextlib
import math
import threading
import time
from dataclasses import replace
from typing import Any

from pointit.plugins import Config, Deliver, Quaternion, Reading, Reconnected, Surroundings
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.testing import UdpDevice
from pointit.testing.templates.imu_source import LineSource, SourceConfig, parse
from pointit.testing.templates.imu_source.promises import SourcePromises
from tests.unit.testing_kit.faults import CaughtBy

caught_by = CaughtBy(SourcePromises)


@caught_by("warns", "`run` raised Connection")
@caught_by("reconnects", "raised|returned")
class DiesWithoutDevice(LineSource):
    async def run(self, deliver: Deliver) -> None:
        while True:
            await self._connect_and_read(deliver)


class DatagramSource:
    """Listens by a protocol of asyncio, as sources of datagrams do."""

    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        self._config = config
        self.surroundings = surroundings

    async def run(self, deliver: Deliver) -> None:
        self.surroundings.health.warn("device", "nothing arrives; switch it on")
        loop = asyncio.get_running_loop()
        local = (self._config.host, self._config.port)
        transport, _ = await loop.create_datagram_endpoint(lambda: TrustingProtocol(self, deliver), local)
        try:
            await asyncio.Event().wait()
        finally:
            transport.close()


class TrustingProtocol(asyncio.DatagramProtocol):
    def __init__(self, source: DatagramSource, deliver: Deliver) -> None:
        self._around = source.surroundings
        self._deliver = deliver

    def datagram_received(self, data: bytes, addr: object) -> None:
        del addr
        w, x, y, z = map(float, data.split(b","))
        if abs(math.hypot(w, x, y, z) - 1.0) < 0.1:
            self._around.health.clear("device")
            self._deliver(Reading(self._around.clock.now_ns(), (x, y, z, w)))


class DatagramContract(SourcePromises):
    device = UdpDevice

    def parameters(self, device: UdpDevice) -> dict[str, object]:
        return {"host": device.host, "port": device.program_port}


datagrams_caught_by = CaughtBy(DatagramContract)
datagrams_caught_by("bad_bytes", "a callback raised ValueError: .*, in datagram_received")(DatagramSource)
datagrams_caught_by("warns", "`run` raised OSError: .*ddress already in use")(DatagramSource)


@caught_by("reconnects", "no `Reconnected`")
class ConcealsRestarts(LineSource):
    async def run(self, deliver: Deliver) -> None:
        await super().run(lambda item: None if isinstance(item, Reconnected) else deliver(item))


@caught_by("warns", "no warning said so")
class NeverWarns(LineSource):
    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        super().__init__(config, replace(surroundings, health=NullHealth()))


@caught_by("ends", "raised RuntimeError when it was cancelled")
class RaisesAtItsEnd(LineSource):
    async def run(self, deliver: Deliver) -> None:
        try:
            await super().run(deliver)
        finally:
            raise RuntimeError("lost my temper")


class ChangesReadings(LineSource):
    """Delivers something else than it should."""

    def change(self, reading: Reading) -> Reading:
        raise NotImplementedError

    async def run(self, deliver: Deliver) -> None:
        def changed(item: Any) -> None:
            deliver(self.change(item) if isinstance(item, Reading) else item)

        await super().run(changed)


@caught_by("delivers", "has the stamp 12345")
class StampsWithDeviceTime(ChangesReadings):
    def change(self, reading: Reading) -> Reading:
        return replace(reading, stamp_ns=12345)


@caught_by(
    "delivers", r"was connected and sent .*world_from_sensor=.* was delivered\. .*the order of numbers"
)
class ScalarFirst(ChangesReadings):
    def change(self, reading: Reading) -> Reading:
        x, y, z, w = reading.world_from_sensor
        return replace(reading, world_from_sensor=(w, x, y, z))


@caught_by("delivers", "another thread")
class DeliversFromAThread(LineSource):
    async def run(self, deliver: Deliver) -> None:
        def elsewhere(item: Any) -> None:
            thread = threading.Thread(target=deliver, args=(item,))
            thread.start()
            thread.join()

        await super().run(elsewhere)


class OwnLoop(LineSource):
    """Reads in its own words, as sources that somebody has written in an evening do."""

    async def _connect_and_read(self, deliver: Deliver) -> None:
        reader, writer = await asyncio.open_connection(self._config.host, self._config.port)
        try:
            self._health.clear("device")
            deliver(Reconnected())
            await self.read(reader, deliver)
        finally:
            writer.close()

    async def read(self, reader: asyncio.StreamReader, deliver: Deliver) -> None:
        while line := await reader.readline():
            self.take(line, deliver)

    def take(self, line: bytes, deliver: Deliver) -> None:
        orientation = self.orientation(line)
        if orientation is not None:
            deliver(Reading(self._clock.now_ns(), orientation))

    def orientation(self, line: bytes) -> Quaternion | None:
        return parse(line)


def numbers(line: bytes) -> Quaternion:
    w, x, y, z = map(float, line.split(b","))
    return (x, y, z, w)


@caught_by("bad_bytes", "whose norm is nan")
class LetsNanThrough(OwnLoop):
    def orientation(self, line: bytes) -> Quaternion | None:
        with contextlib.suppress(ValueError):
            orientation = numbers(line)
            return None if abs(math.hypot(*orientation) - 1.0) > 0.1 else orientation
        return None


@caught_by("bad_bytes", "`run` raised ValueError")
class DiesOfBadBytes(OwnLoop):
    def orientation(self, line: bytes) -> Quaternion | None:
        orientation = numbers(line)
        return orientation if abs(math.hypot(*orientation) - 1.0) < 0.1 else None


@caught_by("keeps_up", "the newest was not delivered")
class LagsBehind(OwnLoop):
    async def read(self, reader: asyncio.StreamReader, deliver: Deliver) -> None:
        while line := await reader.readline():
            self.take(line, deliver)
            await asyncio.sleep(0.02)


@caught_by("keeps_up", "readings it held")
class KeepsAllReadings(ChangesReadings):
    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self.history: list[Reading] = []

    def change(self, reading: Reading) -> Reading:
        self.history.append(reading)
        return reading


@caught_by("silence", "of a processor core")
class Polls(OwnLoop):
    async def read(self, reader: asyncio.StreamReader, deliver: Deliver) -> None:
        line = asyncio.ensure_future(reader.readline())
        try:
            while True:
                if line.done():
                    if not line.result():
                        return
                    self.take(line.result(), deliver)
                    line = asyncio.ensure_future(reader.readline())
                await asyncio.sleep(0)
        finally:
            line.cancel()


@caught_by("ends", "open files")
class LeavesASocket(LineSource):
    opened: list[asyncio.StreamWriter] = []  # noqa: RUF012 - the fault

    async def _connect_and_read(self, deliver: Deliver) -> None:
        _, writer = await asyncio.open_connection(self._config.host, self._config.port)
        self.opened.append(writer)
        await super()._connect_and_read(deliver)


class UndescribedConfig(SourceConfig):
    gain: float = 1.0


def _accept(_config: Config) -> None:
    """Accept any parameters."""


caught_by("parameters", "without a description: gain", config=UndescribedConfig, check=_accept)(LineSource)
caught_by("parameters", "were accepted", check=_accept)(LineSource)


@caught_by("does_not_block", "stood still: Executing")
class SleepsInTheLoop(LineSource):
    async def run(self, deliver: Deliver) -> None:
        time.sleep(0.6)  # noqa: ASYNC251 - the fault
        await super().run(deliver)


@caught_by("ends", "task <coroutine")
class LeavesATask(LineSource):
    async def run(self, deliver: Deliver) -> None:
        self.task = asyncio.create_task(asyncio.sleep(3600))
        await super().run(deliver)


@caught_by("ends", "still ran")
class CannotBeCancelled(LineSource):
    async def run(self, deliver: Deliver) -> None:
        while True:
            with contextlib.suppress(asyncio.CancelledError):
                await super().run(deliver)
