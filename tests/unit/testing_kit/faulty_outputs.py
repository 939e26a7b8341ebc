"""LED outputs with one fault each, and the check that must catch it."""

import asyncio
import socket
import time
from collections import deque
from dataclasses import replace

from pointit.plugins import Config, StripsFrame, Surroundings
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.testing import TcpDevice
from pointit.testing.templates.led_output import fake
from tests.unit.testing_kit.faults import CaughtBy, seed_in_run
from tests.unit.testing_kit.line_output import OUTPUT, Output, OutputParameters

DEVICE = replace(fake.DEVICE, plugin=OUTPUT, device=TcpDevice)
caught_by = CaughtBy(DEVICE)


@caught_by("config_errors", "`make` raised Connection")
class OpensTooEarly(Output):
    def __init__(self, config: OutputParameters, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        socket.create_connection((config.host, config.port)).close()


@caught_by("show_returns_at_once", "`show` took")
class WritesInShow(Output):
    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        time.sleep(0.05)
        super().show(frame, age_s)


@caught_by("newest_wins", "were sent, not just the newest")
class Queues(Output):
    """Sends every frame, in its order."""

    limit: int | None = 1000

    def __init__(self, config: OutputParameters, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self.waiting = deque[bytes](maxlen=self.limit)

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        super().show(frame, age_s)
        self.waiting.append(self._pixels or b"")

    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        while self.waiting:
            await super()._send(writer, self.waiting.popleft())
        await super()._send(writer, pixels, is_new=is_new)


@caught_by("bounded_memory", "it held")
class QueuesWithoutLimit(Queues):
    limit = None


@caught_by("reconnects", "came back, and did not get")
class HasNoHeartbeat(Output):
    """Sends what has changed alone, and never notices that the link is lost."""

    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        if is_new or not any(pixels):
            await super()._send(writer, pixels, is_new=is_new)


@caught_by("dark_at_end", "left lit")
class LeavesLit(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        if any(pixels):
            await super()._send(writer, pixels, is_new=is_new)


@caught_by("light_s", "after the first `show` it was")
class Milliseconds(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        await super()._send(writer, pixels, is_new=is_new)
        self.light_s *= 1000 if is_new else 1


@caught_by("shows", "did not get the newest frame")
class BlueFirst(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        swapped = b"".join(pixels[at : at + 3][::-1] for at in range(0, len(pixels), 3))
        await super()._send(writer, swapped, is_new=is_new)


@caught_by("odd_frames", "`show` raised")
class TrustsTheFrame(Output):
    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        for strip in frame.strips:
            assert len(strip.rgb) == self._sizes[strip.id]
        super().show(frame, age_s)


@caught_by("warns", "no warning said so")
class NeverWarns(Output):
    def __init__(self, config: OutputParameters, surroundings: Surroundings) -> None:
        super().__init__(config, replace(surroundings, health=NullHealth()))


caught_by("parameters", "is no OutputConfig", config=Config)(Output)
seed_in_run(caught_by, Output)
