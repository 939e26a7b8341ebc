"""Checks of an LED output, and the harness that its author gives."""

import asyncio
import math
import statistics
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from pointit.plugins import LampOutput, LedOutput, Output, OutputConfig
from pointit.schemas import Lamp, Strip, StripFrame, StripsFrame
from pointit.testing import requirements
from pointit.testing.trial import CheckFailedError, DeviceHarness, Suite, Trial, absent, called, connected

__all__ = [
    "DARK",
    "FRAMES",
    "LATE_S",
    "LED_SUITE",
    "MANY",
    "PIXELS",
    "SHOWS",
    "SHOW_S",
    "STRIPS",
    "STUCK_FRAMES",
    "LampsAsStrips",
    "LedHarness",
    "LedTrial",
    "bounded_memory",
    "cancels",
    "config_errors",
    "dark_at_end",
    "lamp_id",
    "light_s",
    "newest_wins",
    "notices_loss",
    "odd_frames",
    "parameters",
    "pattern",
    "reconnects",
    "show_returns_at_once",
    "shows",
]


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


LED_SUITE = Suite[LedHarness]()
LATE_S = 0.5
SHOWS = 21
SHOW_S = 0.02
"""Median time of `show` above which it does not return at once, s."""
FRAMES = 300


@LED_SUITE.check(
    "Derive the parameters from pointit.plugins.OutputConfig; operators see them in `pointit plugin list`"
)
async def parameters(harness: LedHarness) -> None:
    """Has a summary of one line, a description for each parameter, and those of every output."""
    if not issubclass(harness.plugin.config, OutputConfig):
        raise CheckFailedError(f"{harness.plugin.config.__name__} is no OutputConfig")
    requirements.require_parameters(harness.plugin)


@LED_SUITE.check("Raise pointit.plugins.ConfigError from `make`, with one sentence; connect in `run`")
async def config_errors(harness: LedHarness) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else, and opens nothing yet."""
    await requirements.config_errors(harness)  # made while the device is away


@LED_SUITE.check("`decode` of the harness and the output must agree on the order of strips and colours")
async def shows(harness: LedHarness) -> None:
    """Shows frames: each strip's pixels arrive, red, green, blue."""
    async with connected(harness.trial()) as trial:
        for number in (5, 2**20 + 2**31 + 3, 2**50 + 1):
            trial.show(number)
            await trial.exchange()


@LED_SUITE.check("Keep the frame in `show` and send it from `run`", alone=True)
async def show_returns_at_once(harness: LedHarness) -> None:
    """Returns at once from `show`, also while the device is away or stuck."""

    def show_often(state: str) -> None:
        took_s: list[float] = []
        for number in range(1, SHOWS + 1):
            began_s = time.perf_counter()
            trial.show(number)
            took_s.append(time.perf_counter() - began_s)
        if statistics.median(took_s) > SHOW_S:
            raise CheckFailedError(f"{state}, `show` took {statistics.median(took_s) * 1e3:.0f} ms")

    async with absent(harness.trial()) as trial:
        show_often("while the device was away")
        await trial.plug()
        show_often("while the device was connected")
        if trial.device.can_stall:
            trial.device.stall()
            show_often("while the device read nothing")


@LED_SUITE.check(
    "Keep one frame, not a queue: `show` replaces it, and `run` sends it when the device takes more",
    lambda harness: harness.example().can_stall,
)
async def newest_wins(harness: LedHarness) -> None:
    """Sends the newest frame and drops those that it replaced."""
    async with connected(harness.trial()) as trial:
        before = len(trial.shown())
        for number in range(2, FRAMES + 2):
            trial.show(number)
        await trial.exchange("many frames were shown")
        sent = len(trial.shown()) - before
        if sent > FRAMES / 2:
            raise CheckFailedError(f"of {FRAMES} frames shown at once, {sent} were sent, not just the newest")


@LED_SUITE.check("Look strips up by their id in what `set_strips` gave last; cut or fill their pixels")
async def odd_frames(harness: LedHarness) -> None:
    """Survives frames that do not fit: without strips, of unknown strips, too short, too long, too early."""
    odd: tuple[list[StripFrame], ...] = (
        [],
        [StripFrame(id="unknown", rgb=b"\xff" * 30)],
        [StripFrame(id="a", rgb=b"\xff" * 3)],
        [StripFrame(id="a", rgb=b"\xff" * 3000), StripFrame(id="b", rgb=b"")],
        [StripFrame(id="b", rgb=b"\xff" * 21)],
    )
    async with harness.trial() as trial:
        for frames in odd:  # before there are strips
            trial.show_frames(frames)
        await trial.device.plug()
        await trial.start()
        for strips in (STRIPS[:1], (), STRIPS[::-1], STRIPS):
            with called("set_strips"):
                trial.output.set_strips(strips)
            for frames in odd:
                trial.show_frames(frames)
                await asyncio.sleep(0.005)
                trial.require_running()
        trial.show(7)
        await trial.exchange("frames did not fit")


@LED_SUITE.check(
    "Take the time in `show` and after the last byte was sent, in seconds; leave 0.0 if it is not measured"
)
async def light_s(harness: LedHarness) -> None:
    """Has an honest `light_s`: 0.0 before the first frame, then the time from `show` to the wire."""
    loop = asyncio.get_running_loop()
    async with harness.trial() as trial:
        if trial.output.light_s != 0.0:
            raise CheckFailedError(f"before the first frame it was {trial.output.light_s!r}, not 0.0")
        shown_s = loop.time()
        await trial.start()
        await asyncio.sleep(LATE_S)
        late_s = loop.time() - shown_s
        await trial.plug()
        await asyncio.sleep(0.05)  # it may be measured after the last byte has arrived here
        measured_s, passed_s = trial.output.light_s, loop.time() - shown_s
        if not (math.isfinite(measured_s) and 0.0 <= measured_s <= passed_s):
            raise CheckFailedError(f"{passed_s:.2f} s after the first `show` it was {measured_s!r}")
        if notices_loss(harness) and 0.0 < measured_s < late_s - 0.1:
            raise CheckFailedError(
                f"a frame left {late_s:.2f} s after its `show`, and it was {measured_s:.3f}"
            )


STUCK_FRAMES = 20
MANY = 8000


@LED_SUITE.check(
    "Connect in a loop, send the kept frame whenever a connection is open, since nobody shows it again, and "
    "send it again every second: only sending tells that a connection is lost",
    notices_loss,
)
async def reconnects(harness: LedHarness) -> None:
    """Shows the newest frame on a device that comes late, or came back."""
    async with absent(harness.trial()) as trial:
        await trial.plug()
        for _ in range(2):
            await trial.replug()


LED_SUITE.add(requirements.warns, requirements.WARN, notices_loss)


@LED_SUITE.check(
    "Await only what can be cancelled, do not catch CancelledError, and limit the time of the last frame"
)
async def cancels(harness: LedHarness) -> None:
    """Ends within 1 s of being cancelled."""

    @asynccontextmanager
    async def stuck() -> AsyncGenerator[LedTrial]:
        async with connected(harness.trial()) as trial:
            trial.device.stall()
            for number in range(2, STUCK_FRAMES):
                trial.show(number)
                await asyncio.sleep(0.01)
            yield trial

    await requirements.cancels(harness)
    if harness.example().can_stall:
        await requirements.require_quick_end(stuck, "while the device read nothing")


@LED_SUITE.check("Send a dark frame in `finally` of `run`, and wait until it has left")
async def dark_at_end(harness: LedHarness) -> None:
    """Switches the strips off when it ends."""
    async with connected(harness.trial()) as trial:
        await trial.end()
        await trial.until(lambda: trial.shown()[-1:] == [DARK], "the strips were left lit")


@LED_SUITE.check(
    "Keep the newest frame alone; a queue without limit grows while the device is away or slow", alone=True
)
async def bounded_memory(harness: LedHarness) -> None:
    """Needs no more memory the longer it runs."""
    async with absent(harness.trial()) as trial:

        async def many() -> None:
            for number in range(MANY):
                trial.show(number + 1)
                if number % 100 == 0:
                    await asyncio.sleep(0)

        await requirements.require_bounded_memory(many, f"{MANY} frames without a device")


LED_SUITE.add(
    requirements.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking write: use asyncio's streams, or a thread",
    alone=True,
)
LED_SUITE.add(requirements.leaves_nothing, requirements.CLOSE, alone=True)
