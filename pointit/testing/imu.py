"""Checks of an IMU source, and the harness that its author gives."""

import asyncio
import math
import random
import re
import statistics
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, cast

from pointit.geometry import vector
from pointit.plugins import ImuSource, Item, Quaternion, RawReading, Reading, Reconnected, Source, rotation
from pointit.testing import requirements
from pointit.testing.devices import UdpDevice
from pointit.testing.trial import (
    ABSENT_S,
    CheckFailedError,
    DeviceHarness,
    Suite,
    Trial,
    absent,
    called,
    connected,
)

__all__ = [
    "BURST",
    "FLOOD_BYTES",
    "IMU_SUITE",
    "LOT",
    "MAX_CPU",
    "MAX_READINGS",
    "NEAR_RAD",
    "NOT_FINITE",
    "NOT_UNIT",
    "OTHER_POSTURE",
    "PIECE_BYTES",
    "POSTURE",
    "SETTLE_S",
    "SILENCE_S",
    "VIRTUAL_SILENCE_S",
    "ImuHarness",
    "ImuTrial",
    "bad_bytes",
    "bounded_memory",
    "burst",
    "calls_in_the_loop",
    "delivers",
    "encoded",
    "is_near",
    "not_finite",
    "not_unit",
    "parameters",
    "problem",
    "reconnects",
    "sends",
    "shows",
    "silence",
    "stamps",
    "tells_reconnection",
    "waits_for_device",
    "waits_for_port",
]


POSTURE: Quaternion = rotation.from_azimuth_elevation(0.7, -0.3)
"""Orientation that the fake device sends unless told otherwise."""
OTHER_POSTURE: Quaternion = rotation.from_azimuth_elevation(-1.1, 0.4)
NEAR_RAD = 0.05
"""Maximum error of a received orientation, since formats round, rad."""
MAX_READINGS = 64
"""Number of readings that a trial remembers; it must not need memory of its own."""

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
LOT = 100
FLOOD_BYTES = 1_500_000
PIECE_BYTES = 8192
SETTLE_S = 0.1
"""Time for the source, and for the loop below it, to free what is done with, s."""

SILENCE_S = 0.4
VIRTUAL_SILENCE_S = 120.0
MAX_CPU = 0.06
"""Maximum CPU share of a source without input, in cores. Waiting takes 0.02. A busy loop takes the share of a
core that a busy machine leaves."""


@dataclass(frozen=True, kw_only=True)
class ImuHarness(DeviceHarness[ImuSource]):
    """An IMU source with a fake device that stands for the real one."""

    encode: Callable[[Quaternion], bytes] | None = None
    """Returns the bytes that the device sends for the orientation x, y, z, w. Raises ValueError if its format
    cannot express it. None if there is no device that sends."""
    delivers: bool = True
    """False for a source without readings of its own."""

    def trial(self) -> "ImuTrial":
        """Return a trial of the source, which has not begun."""
        return ImuTrial(self)


def sends(harness: ImuHarness) -> bool:
    """Return True if there is a fake device that sends."""
    return harness.encode is not None


def encoded(harness: ImuHarness, orientation_xyzw: Quaternion) -> bytes:
    """Return the bytes of a reading, none if the device's format cannot express it."""
    try:
        return harness.encode(orientation_xyzw) if harness.encode is not None else b""
    except (ValueError, OverflowError):
        return b""


class ImuTrial(Trial):
    """One run of an IMU source."""

    def __init__(self, harness: ImuHarness) -> None:
        super().__init__(harness)
        self.harness = harness
        self.readings: deque[Reading | RawReading] = deque(maxlen=MAX_READINGS)
        self.count = 0
        self.reconnections = 0
        """Number of `Reconnected` so far."""
        self.wrong = ""
        """First delivered thing that was wrong in itself, in words."""

    def make(self, config: Any) -> Source:
        """Check the parameters, and make the source."""
        self.harness.plugin.check(config)
        return self.harness.plugin.make(config, self.surroundings)

    async def start(self) -> None:
        """Run the source in the background."""
        with called("make"):
            source = self.make(self.config)
        self.task = asyncio.create_task(source.run(self._deliver))

    async def exchange(self, situation: str = "the device was connected") -> None:
        """Wait until a reading is delivered, if the source has any."""
        failure = f"{situation}, and no reading was delivered"
        if sends(self.harness):
            await self.hear(failure)
        elif self.harness.delivers:
            await self.until(lambda: self.count > 0, failure)

    async def live(self) -> None:
        """Disconnect and reconnect the device, if there is one."""
        if sends(self.harness):
            await self.replug()

    async def send(self, orientation_xyzw: Quaternion = POSTURE) -> None:
        """Send one reading, if the device's format can express it."""
        data = encoded(self.harness, orientation_xyzw)
        if data:
            await self.device.send(data)

    async def hear(self, failure: str, orientation_xyzw: Quaternion = POSTURE) -> None:
        """Send a reading until it is delivered. Raises CheckFailedError if it is not."""
        self.readings.clear()

        def is_received() -> bool:
            return any(shows(each, orientation_xyzw) for each in self.readings)

        await self.until(is_received, failure, lambda: self.send(orientation_xyzw))

    def _deliver(self, item: Item) -> None:
        self.health.note_thread("deliver")
        if isinstance(item, Reconnected):
            self.reconnections += 1
        elif isinstance(item, Reading | RawReading):
            self.count += 1
            self.readings.append(item)
            self.wrong = self.wrong or problem(item)


def problem(reading: Reading | RawReading) -> str:
    """Return an error message if the orientation, or the raw values, of `reading` are none, else `""`."""
    if isinstance(reading, RawReading):
        raw = (*reading.angular_velocity_radps, *reading.acceleration_mps2)
        if len(raw) == 6 and all(isinstance(value, float) and math.isfinite(value) for value in raw):
            return ""
        return f"delivered the raw values {raw!r}, which are not two times three finite floats"
    values = reading.world_from_sensor
    if len(values) != 4 or not all(isinstance(value, float) for value in values):
        return f"delivered the orientation {values!r}, which is not four floats x, y, z, w"
    norm = sum(value * value for value in values) ** 0.5
    if not abs(norm - 1.0) < 1e-3:  # also NaN
        return f"delivered the orientation {values!r}, whose norm is {norm:.4g}, not 1"
    return ""


def shows(reading: Reading | RawReading, orientation_xyzw: Quaternion) -> bool:
    """Return True if `reading` is of a sensor at rest in that orientation; a raw one shows no yaw."""
    if isinstance(reading, Reading):
        return is_near(reading.world_from_sensor, orientation_xyzw)
    up = rotation.rotate(rotation.inverse(orientation_xyzw), (0.0, 0.0, 1.0))
    measured = reading.acceleration_mps2
    return any(measured) and vector.angle_between(measured, up) < NEAR_RAD


def is_near(one: Quaternion, other: Quaternion) -> bool:
    """Return True if two orientations differ by less than 0.05 rad."""
    return abs(sum(a * b for a, b in zip(one, other, strict=True))) > math.cos(NEAR_RAD / 2)


IMU_SUITE = Suite[ImuHarness]()


@IMU_SUITE.check("Operators see them in `pointit plugin list` and in the help of imu-bridge")
async def parameters(harness: ImuHarness) -> None:
    """Has a summary of one line and a description for each parameter."""
    requirements.require_parameters(harness.plugin)


IMU_SUITE.add(
    requirements.config_errors,
    "Raise pointit.plugins.ConfigError from `check` or `make`, with one sentence: what, where, what to do",
)


@IMU_SUITE.check(
    "Call `deliver(Reading(stamp_ns, (x, y, z, w)))` for each reading; `encode` of the harness and the "
    "source must agree on the order of numbers",
    lambda harness: harness.delivers,
)
async def delivers(harness: ImuHarness) -> None:
    """Delivers the orientation that the device sends, as a unit quaternion x, y, z, w."""
    async with connected(harness.trial()) as trial:
        if sends(harness):
            await trial.hear("a second orientation was not delivered", OTHER_POSTURE)
        if trial.wrong:
            raise CheckFailedError(trial.wrong)


@IMU_SUITE.check(
    "Take `stamp_ns` from `surroundings.clock.now_ns()`; the device's own time belongs in `device_time_ns`",
    lambda harness: harness.delivers,
)
async def stamps(harness: ImuHarness) -> None:
    """Stamps readings with the clock of its surroundings, at capture or arrival."""
    async with harness.trial() as trial:
        began_ns = trial.clock.now_ns()
        await trial.device.plug()
        await trial.start()
        await trial.until(lambda: trial.count > 4, "fewer than five readings were delivered", trial.send)
        now_ns = trial.clock.now_ns()
        last_ns = began_ns
        for each in trial.readings:
            if not began_ns <= each.stamp_ns <= now_ns:
                raise CheckFailedError(
                    f"a reading has the stamp {each.stamp_ns!r}; it arrived between {began_ns} and {now_ns}"
                )
            if each.stamp_ns < last_ns:
                raise CheckFailedError(f"a stamp went back by {(last_ns - each.stamp_ns) / 1e6:.3f} ms")
            last_ns = each.stamp_ns


@IMU_SUITE.check("From another thread use `loop.call_soon_threadsafe(deliver, reading)`")
async def calls_in_the_loop(harness: ImuHarness) -> None:
    """Calls `deliver` and reports health in the event loop's thread."""
    async with connected(harness.trial()) as trial:
        trial.health.require_in_loop()


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
            for number in range(2 * BURST):
                await trial.send()
                if number % LOT == 0:  # no more than a port's buffer holds
                    await trial.hear("of many readings, none was delivered")
            await trial.hear("after many readings, the newest was not delivered", OTHER_POSTURE)
            await asyncio.sleep(SETTLE_S)  # the loop forgets cancelled timers later

        await requirements.require_bounded_memory(flood, f"{FLOOD_BYTES} bytes without a reading")
        await trial.hear("after many bytes without a reading, none was delivered")
        await requirements.require_bounded_memory(many, f"{2 * BURST} readings")


@IMU_SUITE.check("Catch OSError around connecting, and try again after a pause", sends)
async def waits_for_device(harness: ImuHarness) -> None:
    """Waits for a device that is not there yet."""
    async with absent(harness.trial()) as trial:
        await trial.plug()


@IMU_SUITE.check(
    "Catch OSError around opening the port, warn, and try again after a pause",
    lambda harness: sends(harness) and isinstance(harness.example(), UdpDevice),
)
async def waits_for_port(harness: ImuHarness) -> None:
    """Waits while another program has its port, warns meanwhile, and listens when it is free."""
    async with harness.trial() as trial:
        with cast("UdpDevice", trial.device).take_program_port():
            await trial.start()
            await trial.until(
                lambda: bool(trial.health.warnings), "another program had its port and no warning said so"
            )
            await asyncio.sleep(ABSENT_S)
            trial.require_running()
        await trial.plug("the port became free")


@IMU_SUITE.check("Connect in a loop: end of file and OSError lead back to connecting, after a pause", sends)
async def reconnects(harness: ImuHarness) -> None:
    """Reconnects after the device has vanished."""
    async with connected(harness.trial()) as trial:
        for _ in range(2):
            await trial.replug()


@IMU_SUITE.check(
    "Call `deliver(Reconnected())` whenever a connection is open, since a restarted device may have turned "
    "its yaw",
    lambda harness: sends(harness) and harness.example().is_connected,
)
async def tells_reconnection(harness: ImuHarness) -> None:
    """Tells that the device was connected again."""
    async with connected(harness.trial()) as trial:
        before = trial.reconnections
        await trial.replug()
        if trial.reconnections == before:
            raise CheckFailedError(
                "the device came back and no `Reconnected` was delivered before its reading"
            )


IMU_SUITE.add(requirements.warns, requirements.WARN, sends)


@IMU_SUITE.check(
    "Await the next bytes instead of asking for them in a loop, and take silence for no error", alone=True
)
async def silence(harness: ImuHarness) -> None:
    """Waits through silence, without using the processor."""
    async with connected(harness.trial()) as trial:
        if harness.virtual_time:
            await asyncio.sleep(VIRTUAL_SILENCE_S)
            trial.require_running()
            return
        shares: list[float] = []
        for _ in range(requirements.TRIES):
            began_s, cpu_s = time.monotonic(), time.process_time()
            await asyncio.sleep(SILENCE_S)
            shares.append((time.process_time() - cpu_s) / (time.monotonic() - began_s))
            trial.require_running()
        used = statistics.median(shares)  # a garbage collection is no polling
        if used > MAX_CPU:
            raise CheckFailedError(f"while nothing arrived it used {used:.0%} of a processor core")
        await trial.exchange("a silence ended")


IMU_SUITE.add(
    requirements.cancels,
    "Await only what can be cancelled, do not catch CancelledError, and join no thread for longer",
)
IMU_SUITE.add(
    requirements.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking read: use asyncio's streams, or "
    "`asyncio.to_thread` and a thread of its own",
    alone=True,
)
IMU_SUITE.add(requirements.leaves_nothing, requirements.CLOSE, alone=True)
