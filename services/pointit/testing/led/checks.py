"""Checks of an LED output: what it shows, its parameters, a device that comes and goes."""

import asyncio
import math
import statistics
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.plugins import OutputConfig
from pointit.schemas import StripFrame
from pointit.testing import requirements
from pointit.testing.check import CheckFailedError, Suite, called
from pointit.testing.led.harness import DARK, STRIPS, LedHarness, LedTrial, notices_loss
from pointit.testing.trial import absent, connected

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
