"""Harness of an LED output, given by its author, and one run of the output."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.plugins import LedOutput
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.testing.check import CheckFailedError
from pointit.testing.devices.device import FakeDevice
from pointit.testing.trial import Trial

STRIPS = (
    Strip(id="a", line_m=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), pixels=10),
    Strip(id="b", line_m=((0.0, 1.0, 0.0), (1.0, 1.0, 0.0)), pixels=7),
)
PIXELS = sum(strip.pixels for strip in STRIPS)
DARK = bytes(3 * PIXELS)


@dataclass(frozen=True, kw_only=True)
class LedHarness:
    """An LED output with a fake device that stands for the real one."""

    plugin: LedOutput
    device: Callable[[], FakeDevice]
    """Makes a device that is not plugged in: `TcpDevice`, `UdpDevice`, `PtyDevice` or one of your own."""
    parameters: Callable[[Any], Mapping[str, object]]
    """Parameters of the output that lead it to the device given."""
    decode: Callable[[bytes], Sequence[bytes]]
    """Returns the complete frames in what the device has received since it was connected, in their order.
    Each is the pixels of all strips: 3 bytes a pixel, red, green, blue. The checks use only 0 and 255."""
    wrong_parameters: tuple[Mapping[str, object], ...] = ()
    """Parameters that the output must refuse."""
    patience_s: float = 10.0
    """Time that the output may take to connect, to notice a loss, and to warn, s."""

    def makes(self, holds: Callable[[FakeDevice], bool]) -> bool:
        """Return True if `holds` of the device."""
        device = self.device()
        try:
            return holds(device)
        finally:
            device.close()


def pattern(number: int) -> bytes:
    """Return the pixels of all strips that show `number`, from 1, in binary; no two are the same."""
    return bytes(255 * (number >> bit & 1) for bit in range(3 * PIXELS))


class LedTrial(Trial):
    """One run of an LED output."""

    def __init__(self, harness: LedHarness) -> None:
        super().__init__(harness.device(), harness.patience_s)
        self._harness = harness
        plugin = harness.plugin
        config = plugin.config.model_validate(dict(harness.parameters(self.device)))
        self.output = self.made(lambda: plugin.make(config, self.surroundings))

    def start(self) -> None:
        """Set the strips, and run the output in the background."""
        self.output.set_strips(STRIPS)
        self.task = asyncio.create_task(self.output.run())

    def show(self, pixels: bytes) -> None:
        """Show `pixels`, those of all strips.

        Raises:
            CheckFailedError: If the output raises.
        """
        frames: list[StripFrame] = []
        for strip in STRIPS:
            frames.append(StripFrame(id=strip.id, rgb=pixels[: 3 * strip.pixels]))
            pixels = pixels[3 * strip.pixels :]
        self.show_frames(frames)

    def show_frames(self, frames: Sequence[StripFrame]) -> None:
        """Show frames of any strips.

        Raises:
            CheckFailedError: If the output raises.
        """
        frame = StripsFrame(stamp_ns=self.clock.now_ns(), seq=1, strips=tuple(frames))
        try:
            self.output.show(frame, 0.01)
        except Exception as error:
            raise CheckFailedError(f"`show` raised {type(error).__name__}: {error}") from error

    def shown(self) -> list[bytes]:
        """Return the frames that the device has received since it was connected."""
        return list(self._harness.decode(bytes(self.device.received)))

    async def see(self, pixels: bytes, failure: str) -> None:
        """Wait until the newest frame of the device is `pixels`.

        Raises:
            CheckFailedError: If it does not come.
        """
        await self.until(lambda: self.shown()[-1:] == [pixels], failure)
