"""Checks of an IMU source that gets garbage, or more than it can carry."""

import asyncio
import math
import random
import re

from pointit.geometry.rotation import Quaternion
from pointit.testing.check import CheckFailedError
from pointit.testing.common import MEMORY_BYTES, memory_growth
from pointit.testing.imu.harness import OTHER_POSTURE, POSTURE, ImuHarness
from pointit.testing.imu.suite import IMU_SUITE, connected, sends

NOT_FINITE: tuple[Quaternion, ...] = (
    (math.nan, math.nan, math.nan, math.nan),
    (0.0, 0.0, math.nan, 1.0),
    (math.inf, 0.0, 0.0, 0.0),
    (0.0, -math.inf, 0.0, 1.0),
)
NOT_UNIT: tuple[Quaternion, ...] = (
    (0.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 2.0),
    (0.5, 0.0, 0.0, 0.0),
    (1e20, 1e20, 1e20, 1e20),
)
BURST = 3000
FLOOD_BYTES = 1_500_000
PIECE_BYTES = 8192
SETTLE_S = 0.1
"""Time for the source to read what has been sent, s."""


@IMU_SUITE.add(
    "survives bytes that are no reading, and goes on with the next that is one",
    "Treat what cannot be parsed as one bad reading: catch the parser's error there, and limit a message's "
    "length",
    sends,
)
async def bad_bytes(harness: ImuHarness) -> None:
    """See the promise."""
    encode = harness.encode
    if encode is None:
        return
    good, noise = encode(POSTURE), random.Random(0)  # noqa: S311 - the same bytes in each run
    pieces = (
        b"\n",
        b"\0",
        b"\xff" * 64,
        good[: len(good) // 2],
        good[len(good) // 2 :],
        good[:-1],
        good + good[: len(good) // 2],
        b"1,2,3\n",
        b"nonsense,,,,\r\n",
        b"x" * 100_000,
        b"\n" * 100,
        re.sub(rb"\d+", b"9" * 400, good),
        *(noise.randbytes(size) for size in (1, 7, 16, 100, 4096)),
    )
    async with connected(harness) as trial:
        for piece in pieces:
            await trial.device.send(piece)
            await asyncio.sleep(0.005)
            trial.require_running()
        # twice: a stream is in step again only behind the end of a message
        await trial.hear("after bytes that are no reading, no good reading was delivered", OTHER_POSTURE)
        if trial.wrong:
            raise CheckFailedError(trial.wrong)


async def _odd(harness: ImuHarness, orientations: tuple[Quaternion, ...]) -> None:
    async with connected(harness) as trial:
        for each in orientations:
            await trial.send(each)
            await asyncio.sleep(0.005)
            trial.require_running()
        await trial.hear("no reading was delivered afterwards", OTHER_POSTURE)
        if trial.wrong:
            raise CheckFailedError(trial.wrong)


@IMU_SUITE.add(
    "delivers no orientation with NaN or infinity",
    "Drop a reading unless `math.isfinite` holds for all its numbers",
    sends,
)
async def not_finite(harness: ImuHarness) -> None:
    """See the promise."""
    await _odd(harness, NOT_FINITE)


@IMU_SUITE.add(
    "delivers no orientation whose norm is not 1",
    "Normalize what is nearly a unit quaternion, and drop what is not, such as four zeros",
    sends,
)
async def not_unit(harness: ImuHarness) -> None:
    """See the promise."""
    await _odd(harness, NOT_UNIT)


@IMU_SUITE.add(
    "catches up after a burst of readings",
    "Deliver what has arrived at once, without a pause for each reading; drop old ones rather than lag",
    sends,
)
async def burst(harness: ImuHarness) -> None:
    """See the promise."""
    encode = harness.encode
    if encode is None:
        return
    async with connected(harness) as trial:
        for _ in range(BURST):
            await trial.device.send(encode(POSTURE))
        await trial.hear(f"after {BURST} readings at once, the newest was not delivered", OTHER_POSTURE)


@IMU_SUITE.add(
    "needs no more memory the longer it runs",
    "Keep no list of readings; bound every buffer and queue (`deque(maxlen=…)`), also that of an unfinished "
    "message",
    sends,
    alone=True,
)
async def bounded_memory(harness: ImuHarness) -> None:
    """See the promise."""
    encode = harness.encode
    if encode is None:
        return
    async with connected(harness) as trial:
        for _ in range(200):  # what is made once does not count
            await trial.send()

        async def flood() -> None:
            for _ in range(FLOOD_BYTES // PIECE_BYTES):
                await trial.device.send(b"x" * PIECE_BYTES)
            await asyncio.sleep(SETTLE_S)

        async def many() -> None:
            for _ in range(2 * BURST):
                await trial.send()
            # what it has not read yet is not what it keeps, nor are cancelled timers of the loop
            await trial.hear(f"after {2 * BURST} readings, the newest was not delivered", OTHER_POSTURE)
            await asyncio.sleep(SETTLE_S)

        for act, what in ((flood, f"{FLOOD_BYTES} bytes without a reading"), (many, f"{2 * BURST} readings")):
            grown = await memory_growth(act)
            if grown > MEMORY_BYTES:
                raise CheckFailedError(f"after {what} it held {grown / 1e6:.1f} MB more")
            await trial.hear(f"after {what}, no reading was delivered")
