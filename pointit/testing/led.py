"""The contract of LED outputs."""

import asyncio
import statistics
import time
from collections.abc import Sequence
from typing import Any
from unittest import SkipTest

from pointit.plugins import LampOutput, Output, OutputConfig
from pointit.schemas import Lamp, Strip, StripFrame, StripsFrame
from pointit.testing.contract import CheckFailedError, called, promise, require, require_bounded_memory
from pointit.testing.trial import WARN, DeviceContract, Trial

STRIPS = (
    Strip(id="a", line_m=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), pixels=10),
    Strip(id="b", line_m=((0.0, 1.0, 0.0), (1.0, 1.0, 0.0)), pixels=7),
)
PIXELS = sum(strip.pixels for strip in STRIPS)
DARK = bytes(3 * PIXELS)
SHOWS = 21
SHOW_S = 0.02
"""Median time of `show` above which it does not return at once, s."""
FRAMES = 300
STUCK_FRAMES = 20
MANY = 8000
NEWEST = "Keep one frame, not a queue: `show` replaces it, and `run` sends it when the device takes more"
AGAIN = (
    "Send the kept frame whenever a connection is open, since nobody shows it again, and again every second: "
    "only sending tells that a connection is lost"
)
ODD_FRAMES: tuple[tuple[StripFrame, ...], ...] = (
    (),
    (StripFrame(id="unknown", rgb=b"\xff" * 30),),
    (StripFrame(id="a", rgb=b"\xff" * 3),),
    (StripFrame(id="a", rgb=b"\xff" * 3000), StripFrame(id="b", rgb=b"")),
    (StripFrame(id="b", rgb=b"\xff" * 21),),
)


def pattern(number: int) -> bytes:
    """Return the pixels of all strips that show `number`, from 1, in binary; no two are the same."""
    bits = (number >> bit & 1 for bit in range(3 * PIXELS))
    return bytes(255 * bit for bit in bits)


class LedTrial(Trial):
    """One run of an LED output, which is made at once."""

    def __init__(self, contract: "LedOutputContract") -> None:
        super().__init__(contract)
        self.contract = contract
        self._newest = b""
        with called("make"):
            self.output = self.make(self.config)

    def make(self, config: Any) -> Output:
        """Create an output. Raises CheckFailedError if it has neither strips nor lamps."""
        output = self.contract.plugin.make(config, self.surroundings)
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
        failure = f"{situation}, and did not get the newest frame"

        def has_newest() -> bool:
            return self.shown()[-1:] == [self._newest]

        await self.until(has_newest, failure, AGAIN)

    async def live(self) -> None:
        """Show another pattern, let the device vanish and come back, and let it read no more."""
        self.show(2)
        await self.exchange()
        if self.device.is_connected:
            await self.replug()
        if self.device.can_stall:
            self.device.stall()
            for number in range(3, STUCK_FRAMES):
                self.show(number)
                await asyncio.sleep(0.01)

    def show_often(self, state: str) -> None:
        """Show many frames. Raises CheckFailedError if `show` is slow in the `state`, a clause."""
        took_s: list[float] = []
        for number in range(1, SHOWS + 1):
            began_s = time.perf_counter()
            self.show(number)
            took_s.append(time.perf_counter() - began_s)
        median_s = statistics.median(took_s)
        remedy = "Keep the frame in `show` and send it from `run`"
        median_ms = median_s * 1e3
        require(median_s <= SHOW_S, f"while {state}, `show` took {median_ms:.0f} ms", remedy)

    def show(self, number: int) -> None:
        """Show the pattern of a number."""
        rest = pattern(number)
        self._newest = rest
        frames: list[StripFrame] = []
        for strip in STRIPS:
            size = 3 * strip.pixels
            frames.append(StripFrame(id=strip.id, rgb=rest[:size]))
            rest = rest[size:]
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
        return list(self.contract.decode(bytes(self.device.received)))


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
        lamps: list[Lamp] = []
        for strip in strips:
            for pixel in range(strip.pixels):
                lamps.append(Lamp(id=lamp_id(strip.id, pixel), position_m=strip.line_m[0]))
        self._lamps.set_lamps(lamps)

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Show the pixels of `frame` on their lamps."""
        del age_s
        for strip in frame.strips:
            for pixel in range(len(strip.rgb) // 3):
                first = 3 * pixel
                red, green, blue = strip.rgb[first : first + 3]
                self._lamps.show_lamp(lamp_id(strip.id, pixel), (red, green, blue))

    async def run(self) -> None:
        """Run the output to lamps."""
        await self._lamps.run()


class LedOutputContract(DeviceContract):
    """Promises of an LED output, with a fake device that stands for the real one."""

    def decode(self, received: bytes) -> Sequence[bytes]:
        """Return the complete frames in the bytes that the device received since it was connected, in order.

        Each is the pixels of all strips: 3 bytes a pixel, red, green, blue. The tests use only 0 and 255. For
        an output to lamps, each pixel is a lamp: `a_0` to `a_9`, `b_0` to `b_6`.
        """
        raise NotImplementedError

    def trial(self) -> LedTrial:
        """Return a trial of the output, which is made at once. Raises CheckFailedError if it cannot be."""
        return LedTrial(self)

    @promise()
    async def test_shows(self) -> None:
        """Shows each strip's pixels, red, green, blue; measures the time to the wire; is dark at its end."""
        loop = asyncio.get_running_loop()
        kind = self.plugin.config
        require(issubclass(kind, OutputConfig), f"{kind.__name__} is no OutputConfig of pointit.plugins")
        async with self.trial() as trial:
            # Nothing is measured before the first frame
            light_s = trial.output.light_s
            began_s = loop.time()
            require(light_s == 0.0, f"before the first frame `light_s` was {light_s!r}, not 0.0")
            await trial.begin()
            for number in (5, 2**20 + 2**31 + 3, 2**50 + 1):
                trial.show(number)
                await trial.exchange()
            await asyncio.sleep(0.05)  # it may be measured after the last byte has arrived here
            light_s = trial.output.light_s
            passed_s = loop.time() - began_s
            duration = f"{passed_s:.2f} s"
            require(
                0.0 <= light_s <= passed_s,
                f"{duration} after the first `show` `light_s` was {light_s!r}",
                "It is the time from `show` to the last byte sent, s; leave 0.0 if it is not measured",
            )
            # The end is the last frame
            await trial.end()
            remedy = "Send a dark frame in `finally` of `run`, and wait until it has left"

            def is_dark() -> bool:
                return trial.shown()[-1:] == [DARK]

            await trial.until(is_dark, "the strips were left lit", remedy)

    @promise()
    async def test_newest_wins(self) -> None:
        """Returns at once from `show`, and keeps the newest frame alone while the device is away or slow."""
        async with self.trial() as trial:
            # Without a device, frames must not pile up
            await trial.begin(is_plugged=False)
            trial.show_often("the device was away")

            async def show_many() -> None:
                for number in range(MANY):
                    trial.show(number + 1)
                    if number % 100 == 0:
                        await asyncio.sleep(0)

            await require_bounded_memory(show_many, f"{MANY} frames without a device", NEWEST)
            # With a device, and with one that does not read, `show` must not wait for it
            await trial.plug()
            trial.show_often("the device was connected")
            if trial.device.can_stall:
                await trial.exchange()
                count = len(trial.shown())
                for number in range(2, FRAMES + 2):
                    trial.show(number)
                await trial.exchange("many frames were shown")
                sent = len(trial.shown()) - count
                require(
                    sent <= FRAMES / 2,
                    f"of {FRAMES} frames shown at once, {sent} were sent, not just the newest",
                    NEWEST,
                )
                trial.device.stall()
                trial.show_often("the device read nothing")

    @promise()
    async def test_odd_frames(self) -> None:
        """Survives frames that do not fit: no strips, unknown strips, too short, too long, too early."""
        async with self.trial() as trial:
            for frames in ODD_FRAMES:  # before there are strips
                trial.show_frames(frames)
            await trial.device.plug()
            await trial.start()
            # Strips may change while it runs, as maps do
            for strips in (STRIPS[:1], (), STRIPS[::-1], STRIPS):
                with called("set_strips"):
                    trial.output.set_strips(strips)
                for frames in ODD_FRAMES:
                    trial.show_frames(frames)
                    await asyncio.sleep(0.005)
                    trial.require_running()
            trial.show(7)
            await trial.exchange("frames did not fit")

    @promise()
    async def test_reconnects(self) -> None:
        """Warns while its device is away, and shows the newest frame when it comes, or comes back."""
        async with self.trial() as trial:
            if not trial.device.is_connected:
                raise SkipTest("the output cannot notice that its device has vanished")
            await trial.start()
            await trial.warned()
            await trial.plug()
            for _ in range(2):
                await trial.replug()
            cleared = "the device was back and a warning stayed"
            await trial.until(lambda: not trial.health.warnings, cleared, WARN, trial.exchange)
