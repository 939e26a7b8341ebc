"""Checks of an IMU source that gets garbage, or more than it can carry."""

import asyncio
import math
import random
import re
from collections.abc import Iterable

from pointit.geometry.rotation import Quaternion
from pointit.testing.check import CheckFailedError
from pointit.testing.common import require_bounded_memory
from pointit.testing.imu.harness import IMU_SUITE, OTHER_POSTURE, POSTURE, ImuHarness, encoded, sends
from pointit.testing.trial import connected

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
"""Time for the source, and for the loop below it, to free what is done with, s."""


@IMU_SUITE.check(
    "Treat what cannot be parsed as one bad reading: catch the parser's error there, and limit a message's "
    "length",
    sends,
)
async def bad_bytes(harness: ImuHarness) -> None:
    """Survives bytes that are no reading, and goes on with the next that is one."""
    good, noise = encoded(harness, POSTURE), random.Random(0)  # noqa: S311 - the same bytes in each run
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
    await _survives(harness, pieces)


async def _survives(harness: ImuHarness, pieces: Iterable[bytes]) -> None:
    async with connected(harness.trial()) as trial:
        for piece in filter(None, pieces):
            await trial.device.send(piece)
            await asyncio.sleep(0.005)
            trial.require_running()
        # until it is delivered: a stream is in step again only behind the end of a message
        await trial.hear("afterwards, no good reading was delivered", OTHER_POSTURE)
        if trial.wrong:
            raise CheckFailedError(trial.wrong)


@IMU_SUITE.check("Drop a reading unless `math.isfinite` holds for all its numbers", sends)
async def not_finite(harness: ImuHarness) -> None:
    """Delivers no orientation with NaN or infinity."""
    await _survives(harness, (encoded(harness, each) for each in NOT_FINITE))


@IMU_SUITE.check(
    "Normalize what is nearly a unit quaternion, and drop what is not, such as four zeros", sends
)
async def not_unit(harness: ImuHarness) -> None:
    """Delivers no orientation whose norm is not 1."""
    await _survives(harness, (encoded(harness, each) for each in NOT_UNIT))


@IMU_SUITE.check(
    "Deliver what has arrived at once, without a pause for each reading; drop old ones rather than lag", sends
)
async def burst(harness: ImuHarness) -> None:
    """Catches up after a burst of readings."""
    async with connected(harness.trial()) as trial:
        for _ in range(BURST):
            await trial.send()
        await trial.hear(f"after {BURST} readings at once, the newest was not delivered", OTHER_POSTURE)


@IMU_SUITE.check(
    "Keep no list of readings; bound every buffer and queue (`deque(maxlen=…)`), also that of an unfinished "
    "message",
    sends,
    alone=True,
)
async def bounded_memory(harness: ImuHarness) -> None:
    """Needs no more memory the longer it runs."""
    async with connected(harness.trial()) as trial:
        for _ in range(200):  # what is made once does not count
            await trial.send()

        async def flood() -> None:
            for _ in range(FLOOD_BYTES // PIECE_BYTES):
                await trial.device.send(b"x" * PIECE_BYTES)
            await asyncio.sleep(SETTLE_S)

        async def many() -> None:
            for _ in range(2 * BURST):
                await trial.send()
            await trial.hear("after many readings, the newest was not delivered", OTHER_POSTURE)
            await asyncio.sleep(SETTLE_S)  # the loop forgets cancelled timers later

        await require_bounded_memory(flood, f"{FLOOD_BYTES} bytes without a reading")
        await trial.hear("after many bytes without a reading, none was delivered")
        await require_bounded_memory(many, f"{2 * BURST} readings")
