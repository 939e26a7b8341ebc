"""LED outputs with one fault each, made from the template, and the check that must catch it."""

import asyncio
import contextlib
import socket
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pointit.plugins import Config, Strip, StripsFrame, Surroundings
from pointit.testing.templates.led_output import OUTPUT, Output, OutputParameters
from pointit.testing.templates.led_output.fake import DEVICE
from tests.unit.testing_kit.faulty_sources import Fault, Silently


class DiesWithoutDevice(Output):
    async def run(self) -> None:
        await self._connect_and_send()


class OpensTooEarly(Output):
    def __init__(self, config: OutputParameters, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        socket.create_connection((config.host, config.port)).close()


class WritesInShow(Output):
    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        time.sleep(0.05)
        super().show(frame, age_s)


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


class QueuesWithoutLimit(Queues):
    limit = None


class ForgetsOnReconnect(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        await super()._send(writer, pixels, is_new=is_new)
        self._pixels = None


class LeavesLit(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        if any(pixels):
            await super()._send(writer, pixels, is_new=is_new)


class Dawdles(Output):
    async def run(self) -> None:
        try:
            await super().run()
        finally:
            await asyncio.sleep(1.5)


class Milliseconds(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        await super()._send(writer, pixels, is_new=is_new)
        self.light_s *= 1000 if is_new else 1


class MeasuresTheWriteAlone(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        began_s = time.monotonic()
        await super()._send(writer, pixels, is_new=is_new)
        self.light_s = time.monotonic() - began_s


class BlueFirst(Output):
    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        swapped = b"".join(pixels[at : at + 3][::-1] for at in range(0, len(pixels), 3))
        await super()._send(writer, swapped, is_new=is_new)


class TrustsTheFrame(Output):
    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        for strip in frame.strips:
            assert len(strip.rgb) == self._sizes[strip.id]
        super().show(frame, age_s)


class TrustsTheMap(Output):
    def set_strips(self, strips: Sequence[Strip]) -> None:
        self.longest = max(strip.pixels for strip in strips)
        super().set_strips(strips)


class NeverWarns(Output):
    def __init__(self, config: OutputParameters, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self._health: Any = Silently(surroundings.health, "reached")


class SleepsInTheLoop(Output):
    async def _connect_and_send(self) -> None:
        time.sleep(0.6)  # noqa: ASYNC251 - the fault
        await super()._connect_and_send()


class LeavesATask(Output):
    async def run(self) -> None:
        self.task = asyncio.create_task(asyncio.sleep(3600))
        with contextlib.suppress(ValueError):
            await super().run()


class PlainConfig(Config, extra="allow"):
    """Not that of an output."""


def fault(
    check: str, words: str, make: Any, *, config: type[Config] = OutputParameters, wait_s: float = 5.0
) -> Fault:
    """Return the template with another output."""
    return Fault(
        check, words, replace(DEVICE, plugin=replace(OUTPUT, make=make, config=config), patience_s=wait_s)
    )


FAULTS: dict[str, Fault] = {
    "dies_without_device": fault("reconnects", "`run` raised Connection", DiesWithoutDevice),
    "opens_too_early": fault("config_errors", "`make` raised Connection", OpensTooEarly),
    "writes_in_show": fault("show_returns_at_once", "`show` took", WritesInShow),
    "queues": fault("newest_wins", "were sent, not just the newest", Queues),
    "queues_without_limit": fault("bounded_memory", "it held", QueuesWithoutLimit),
    "forgets_on_reconnect": fault("reconnects", "came back, and did not get", ForgetsOnReconnect),
    "leaves_lit": fault("dark_at_end", "left lit", LeavesLit),
    "dawdles": fault("cancels", "ended 1.* s after it was cancelled", Dawdles),
    "milliseconds": fault("light_s", "after the first `show` it was", Milliseconds),
    "measures_the_write_alone": fault("light_s", "a frame left", MeasuresTheWriteAlone),
    "blue_first": fault("shows", "did not reach the device", BlueFirst),
    "trusts_the_frame": fault("odd_frames", "`show` raised", TrustsTheFrame),
    "trusts_the_map": fault("odd_frames", "`set_strips` raised ValueError", TrustsTheMap),
    "never_warns": fault("warns", "no warning said so", NeverWarns),
    "sleeps_in_the_loop": fault("does_not_block", r"stood still .*time\.sleep", SleepsInTheLoop),
    "leaves_a_task": fault("leaves_nothing", "task", LeavesATask),
    "no_output_config": fault("parameters", "is no OutputConfig", Output, config=PlainConfig),
}
