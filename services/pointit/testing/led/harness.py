"""Harness of an LED output, given by its author, and one run of the output, also to single lamps."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.plugins import LampOutput, LedOutput, Output
from pointit.schemas import Lamp, Strip, StripFrame, StripsFrame
from pointit.testing.check import CheckFailedError, called
from pointit.testing.trial import DeviceHarness, Trial

STRIPS = (
    Strip(id="a", line_m=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), pixels=10),
    Strip(id="b", line_m=((0.0, 1.0, 0.0), (1.0, 1.0, 0.0)), pixels=7),
)
PIXELS = sum(strip.pixels for strip in STRIPS)
DARK = bytes(3 * PIXELS)


@dataclass(frozen=True, kw_only=True)
class LedHarness(DeviceHarness[LedOutput]):
    """An LED output with a fake device that stands for the real one."""

    decode: Callable[[bytes], Sequence[bytes]]
    """Returns the complete frames in the bytes that the device has received since it was connected, in order.
    Each is the pixels of all strips: 3 bytes a pixel, red, green, blue. The checks use only 0 and 255. For an
    output to lamps, each pixel is a lamp: `a_0` to `a_9`, `b_0` to `b_6`."""

    def trial(self) -> "LedTrial":
        """Return a trial of the output, which is made at once. Raises CheckFailedError if it cannot be."""
        return LedTrial(self)


def notices_loss(harness: LedHarness) -> bool:
    """Return True if the output can notice that its device has vanished."""
    return harness.example().is_connected


def pattern(number: int) -> bytes:
    """Return the pixels of all strips that show `number`, from 1, in binary; no two are the same."""
    return bytes(255 * (number >> bit & 1) for bit in range(3 * PIXELS))


class LedTrial(Trial):
    """One run of an LED output, which is made at once."""

    def __init__(self, harness: LedHarness) -> None:
        super().__init__(harness)
        self.harness = harness
        self._newest = b""
        with called("make"):
            self.output = self.make(self.config)

    def make(self, config: Any) -> Output:
        """Create an output. Raises CheckFailedError if it has neither strips nor lamps."""
        output = self.harness.plugin.make(config, self.surroundings)
        if isinstance(output, Output):
            return output
        if isinstance(output, LampOutput):
            return LampsAsStrips(output)
        name = type(output).__name__
        raise CheckFailedError(f"{name} is no Output of pointit.plugins, which has strips, and no LampOutput")

    async def start(self) -> None:
        """Set the strips, run the output in the background, and show the first pattern."""
        self.output.set_strips(STRIPS)
        self.task = asyncio.create_task(self.output.run())
        self.show(1)

    async def exchange(self, situation: str = "the device was connected") -> None:
        """Wait until the newest frame of the device is the pattern that was shown last."""
        await self.until(
            lambda: self.shown()[-1:] == [self._newest], f"{situation}, and did not get the newest frame"
        )

    async def live(self) -> None:
        """Show another pattern, and let the device vanish and come back, if that can be noticed."""
        self.show(2)
        await self.exchange()
        if self.device.is_connected:
            await self.replug()

    def show(self, number: int) -> None:
        """Show the pattern of a number."""
        self._newest = rest = pattern(number)
        frames: list[StripFrame] = []
        for strip in STRIPS:
            frames.append(StripFrame(id=strip.id, rgb=rest[: 3 * strip.pixels]))
            rest = rest[3 * strip.pixels :]
        self.show_frames(frames)

    def show_frames(self, frames: Sequence[StripFrame]) -> None:
        """Show frames of any strips.

        Raises:
            CheckFailedError: If the output raises.
        """
        frame = StripsFrame(stamp_ns=self.clock.now_ns(), seq=1, strips=tuple(frames))
        with called("show"):
            self.output.show(frame, 0.01)

    def shown(self) -> list[bytes]:
        """Return the frames that the device has received since it was connected."""
        return list(self.harness.decode(bytes(self.device.received)))


def lamp_id(strip_id: str, pixel: int) -> str:
    """Return the id of the lamp that stands for a pixel."""
    return f"{strip_id}_{pixel}"


class LampsAsStrips:
    """An output to strips, each pixel of which is a lamp of an output to lamps."""

    light_s = 0.0
    """Not measured."""

    def __init__(self, lamps: LampOutput) -> None:
        self._lamps = lamps

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set a lamp for each pixel."""
        self._lamps.set_lamps(
            [
                Lamp(id=lamp_id(strip.id, pixel), position_m=strip.line_m[0])
                for strip in strips
                for pixel in range(strip.pixels)
            ]
        )

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Show the pixels of `frame` on their lamps."""
        del age_s
        for strip in frame.strips:
            for pixel in range(len(strip.rgb) // 3):
                red, green, blue = strip.rgb[3 * pixel : 3 * pixel + 3]
                self._lamps.show_lamp(lamp_id(strip.id, pixel), (red, green, blue))

    async def run(self) -> None:
        """Run the output to lamps."""
        await self._lamps.run()
