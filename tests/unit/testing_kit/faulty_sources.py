"""IMU sources with one fault each, made from the template, and the check that must catch it."""

import asyncio
import contextlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from pydantic import Field

from pointit.plugins import Config, Deliver, HealthSink, Quaternion, Reading, Reconnected, Surroundings
from pointit.testing.templates.imu_source import SOURCE, Source, SourceConfig, parse
from pointit.testing.templates.imu_source.fake import DEVICE


class DiesWithoutDevice(Source):
    async def run(self, deliver: Deliver) -> None:
        while True:
            await self._connect_and_read(deliver)


class ConnectsOnce(Source):
    async def run(self, deliver: Deliver) -> None:
        await super()._connect_and_read(deliver)
        await asyncio.Event().wait()


class ConcealsRestarts(Source):
    async def run(self, deliver: Deliver) -> None:
        await super().run(lambda item: None if isinstance(item, Reconnected) else deliver(item))


class Silently:
    """Health of which only what is named is told."""

    def __init__(self, health: HealthSink, *told: str) -> None:
        self._health = health
        self._told = told

    def __getattr__(self, name: str) -> Callable[..., None]:
        return getattr(self._health, name) if name in self._told else self._nothing

    @staticmethod
    def _nothing(*_: object) -> None:
        """Tell nobody."""


class NeverWarns(Source):
    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self._health: Any = Silently(surroundings.health)


class NeverStopsWarning(Source):
    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self._health: Any = Silently(surroundings.health, "warn")


class CannotBeCancelled(Source):
    async def run(self, deliver: Deliver) -> None:
        while True:
            try:
                await super().run(deliver)
            except asyncio.CancelledError:
                continue


class RaisesAtItsEnd(Source):
    async def run(self, deliver: Deliver) -> None:
        try:
            await super().run(deliver)
        finally:
            raise RuntimeError("lost my temper")


class ChangesReadings(Source):
    """Delivers something else than it should."""

    def change(self, reading: Reading) -> Reading:
        raise NotImplementedError

    async def run(self, deliver: Deliver) -> None:
        def changed(item: Any) -> None:
            deliver(self.change(item) if isinstance(item, Reading) else item)

        await super().run(changed)


class StampsWithDeviceTime(ChangesReadings):
    def change(self, reading: Reading) -> Reading:
        return replace(reading, stamp_ns=12345)


class ScalarFirst(ChangesReadings):
    def change(self, reading: Reading) -> Reading:
        x, y, z, w = reading.world_from_sensor
        return replace(reading, world_from_sensor=(w, x, y, z))


class DeliversFromAThread(Source):
    async def run(self, deliver: Deliver) -> None:
        def elsewhere(item: Any) -> None:
            thread = threading.Thread(target=deliver, args=(item,))
            thread.start()
            thread.join()

        await super().run(elsewhere)


class OwnLoop(Source):
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


class TrustsTheNorm(OwnLoop):
    def orientation(self, line: bytes) -> Quaternion | None:
        try:
            w, x, y, z = map(float, line.split(b","))
        except ValueError:
            return None
        return (x, y, z, w) if math.isfinite(w + x + y + z) else None


class LetsNanThrough(OwnLoop):
    def orientation(self, line: bytes) -> Quaternion | None:
        with contextlib.suppress(ValueError):
            w, x, y, z = map(float, line.split(b","))
            return None if abs(math.hypot(w, x, y, z) - 1.0) > 0.1 else (x, y, z, w)
        return None


class DiesOfBadBytes(OwnLoop):
    def orientation(self, line: bytes) -> Quaternion | None:
        w, x, y, z = map(float, line.split(b","))
        return (x, y, z, w)


class DiesOfLongLines(OwnLoop):
    """Has forgotten that `readline` raises ValueError beyond its limit."""


class LagsBehind(OwnLoop):
    async def read(self, reader: asyncio.StreamReader, deliver: Deliver) -> None:
        while line := await reader.readline():
            self.take(line, deliver)
            await asyncio.sleep(0.02)


class KeepsAllReadings(ChangesReadings):
    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self.history: list[Reading] = []

    def change(self, reading: Reading) -> Reading:
        self.history.append(reading)
        return reading


class KeepsALineWithoutEnd(OwnLoop):
    async def read(self, reader: asyncio.StreamReader, deliver: Deliver) -> None:
        rest: bytes = b""
        while data := await reader.read(65536):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self.take(line, deliver)


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


class EndsInSilence(OwnLoop):
    async def read(self, reader: asyncio.StreamReader, deliver: Deliver) -> None:
        try:
            async with asyncio.timeout(0.5):
                await super().read(reader, deliver)
        except TimeoutError as error:
            raise ValueError("no data") from error


class SleepsInTheLoop(Source):
    async def _connect_and_read(self, deliver: Deliver) -> None:
        time.sleep(0.6)  # noqa: ASYNC251 - the fault
        await super()._connect_and_read(deliver)


class Hangs(Source):
    async def run(self, deliver: Deliver) -> None:
        threading.Event().wait(8.0)
        await super().run(deliver)


class LeavesASocket(Source):
    opened: list[asyncio.StreamWriter] = []  # noqa: RUF012 - the fault

    async def _connect_and_read(self, deliver: Deliver) -> None:
        _, writer = await asyncio.open_connection(self._config.host, self._config.port)
        self.opened.append(writer)
        await super()._connect_and_read(deliver)


class LeavesAThread(Source):
    async def run(self, deliver: Deliver) -> None:
        threading.Thread(target=time.sleep, args=(6.0,), name=f"reader {id(self)}", daemon=True).start()
        await super().run(deliver)


class LeavesATask(Source):
    async def run(self, deliver: Deliver) -> None:
        self.task = asyncio.create_task(asyncio.sleep(3600))
        await super().run(deliver)


class UndescribedConfig(SourceConfig):
    gain: float = 1.0


class StrictConfig(Config):
    host: str = Field(default="", description="name of the device")
    port: int = Field(default=1, description="port of the device")


def _accept(_config: Config) -> None:
    """Accept any parameters."""


def _key_error(config: StrictConfig, surroundings: Surroundings) -> Source:
    ports: dict[int, int] = {}
    return Source(SourceConfig(host=config.host, port=ports[config.port]), surroundings)


@dataclass(frozen=True)
class Fault:
    """A faulty plug-in, the check that catches it, and words of the report."""

    check: str
    words: str
    harness: Any


def fault(
    check: str, words: str, make: Any, *, config: type[Config] | None = None, wait_s: float = 5.0
) -> Fault:
    """Return the template with another source, and without its check if there is another `config`."""
    plugin = replace(SOURCE, make=make)
    if config is not None:
        plugin = replace(plugin, config=config, check=_accept)
    return Fault(check, words, replace(DEVICE, plugin=plugin, patience_s=wait_s))


FAULTS: dict[str, Fault] = {
    "dies_without_device": fault("waits_for_device", "`run` raised Connection", DiesWithoutDevice),
    "connects_once": fault("reconnects", "after the first loss", ConnectsOnce),
    "conceals_restarts": fault("tells_reconnection", "no `Reconnected`", ConcealsRestarts),
    "never_warns": fault("warns", "no warning said so", NeverWarns),
    "never_stops_warning": fault("warns", "a warning stayed", NeverStopsWarning),
    "cannot_be_cancelled": fault("cancels", "still ran", CannotBeCancelled),
    "raises_at_its_end": fault("cancels", "raised RuntimeError when it was cancelled", RaisesAtItsEnd),
    "stamps_with_device_time": fault("stamps", "has the stamp 12345", StampsWithDeviceTime),
    "scalar_first": fault("delivers", "no reading of the device", ScalarFirst),
    "delivers_from_a_thread": fault("calls_in_the_loop", "another thread", DeliversFromAThread),
    "trusts_the_norm": fault("not_unit", "whose norm is 0", TrustsTheNorm),
    "lets_nan_through": fault("not_finite", "whose norm is nan", LetsNanThrough),
    "dies_of_bad_bytes": fault("bad_bytes", "`run` raised ValueError", DiesOfBadBytes),
    "dies_of_long_lines": fault("bad_bytes", "`run` raised ValueError", DiesOfLongLines),
    "lags_behind": fault("burst", "the newest was not delivered", LagsBehind),
    "keeps_all_readings": fault("bounded_memory", "readings it held", KeepsAllReadings),
    "keeps_a_line_without_end": fault("bounded_memory", "without a reading it held", KeepsALineWithoutEnd),
    "polls": fault("silence", "of a processor core", Polls),
    "ends_in_silence": fault("silence", "`run` raised ValueError: no data", EndsInSilence),
    "sleeps_in_the_loop": fault("does_not_block", r"stood still .*time\.sleep", SleepsInTheLoop),
    "hangs": fault("waits_for_device", r"come to an end .*Event", Hangs, wait_s=0.5),
    "leaves_a_socket": fault("leaves_nothing", "open file", LeavesASocket),
    "leaves_a_thread": fault("leaves_nothing", "thread 'reader", LeavesAThread),
    "leaves_a_task": fault("leaves_nothing", "task", LeavesATask),
    "undescribed_parameter": fault(
        "parameters", "without a description: gain", Source, config=UndescribedConfig
    ),
    "raises_key_error": fault("config_errors", "raised KeyError", _key_error, config=StrictConfig),
    "accepts_no_address": fault("config_errors", "were accepted", Source, config=SourceConfig),
}
