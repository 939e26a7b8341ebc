"""The contract of IMU sources."""

import asyncio
import math
import random
import re
import statistics
import time
from collections import deque
from typing import Any

from pointit.geometry import vector
from pointit.plugins import Item, Quaternion, RawReading, Reading, Reconnected, Source, rotation
from pointit.testing.contract import TRIES, CheckFailedError, called, promise, require, require_bounded_memory
from pointit.testing.devices import UdpDevice
from pointit.testing.trial import DeviceContract, Trial

POSTURE: Quaternion = rotation.from_azimuth_elevation(0.7, -0.3)
"""Orientation that the fake device sends unless told otherwise."""
OTHER_POSTURE: Quaternion = rotation.from_azimuth_elevation(-1.1, 0.4)
NEAR_RAD = 0.05
"""Maximum error of a received orientation, since formats round, rad."""
MAX_READINGS = 64
"""Number of readings that a trial remembers; it must not need memory of its own."""
NO_ORIENTATIONS: tuple[Quaternion, ...] = (
    (math.nan, math.nan, math.nan, math.nan),
    (0.0, 0.0, math.nan, 1.0),
    (math.inf, 0.0, 0.0, 0.0),
    (0.0, -math.inf, 0.0, 1.0),
    (0.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 2.0),
    (0.5, 0.0, 0.0, 0.0),
    (1e20, 1e20, 1e20, 1e20),
)
BURST = 1000
MANY = 3000
LOT = 100
FLOOD_BYTES = 1_500_000
PIECE_BYTES = 8192
SETTLE_S = 0.1
"""Time for the source, and for the loop below it, to free what is done with, s."""
SILENCE_S = 0.4
VIRTUAL_SILENCE_S = 40.0
MAX_CPU = 0.06
"""Maximum CPU share of a source without input, in cores. Waiting takes 0.02. A busy loop takes the share of a
core that a busy machine leaves."""
SKIP = (
    "Treat what cannot be parsed as one bad reading: catch the parser's error, and limit a message's length"
)
ORDER = "`encode` of the contract and the source must agree on the order of numbers"
KEEP_UP = "Deliver what has arrived at once, without a pause for each reading; drop old ones rather than lag"


class ImuTrial(Trial):
    """One run of an IMU source."""

    def __init__(self, contract: "ImuSourceContract") -> None:
        super().__init__(contract)
        self.contract = contract
        self.readings: deque[Reading | RawReading] = deque(maxlen=MAX_READINGS)
        self.count = 0
        self.reconnections = 0
        """Number of `Reconnected` so far."""
        self.wrong = ""
        """First delivered thing that was wrong in itself, in words."""

    def make(self, config: Any) -> Source:
        """Check the parameters, and make the source."""
        self.contract.plugin.check(config)
        return self.contract.plugin.make(config, self.surroundings)

    async def start(self) -> None:
        """Run the source in the background."""
        with called("make"):
            source = self.make(self.config)
        self.task = asyncio.create_task(source.run(self._deliver))

    async def exchange(self, situation: str = "the device was connected") -> None:
        """Wait until a reading is delivered, if the source has any."""
        failure = f"{situation}, and no reading was delivered"
        if self.contract.sends:
            try:
                await self.hear(failure)
            except CheckFailedError as error:
                self.require_running()
                if not self.readings:
                    raise
                delivered = self.readings[-1]
                problem = f"{situation} and sent {POSTURE}, and {delivered} was delivered"
                raise CheckFailedError(f"{problem}. {ORDER}") from error
        elif self.contract.delivers:
            await self.until(lambda: self.count > 0, failure)

    async def live(self) -> None:
        """Disconnect and reconnect the device, if there is one."""
        if self.contract.sends:
            await self.replug()

    def encoded(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the bytes of a reading, none if there is no device or its format cannot express it."""
        try:
            return self.contract.encode(orientation_xyzw) if self.contract.sends else b""
        except (ValueError, OverflowError):
            return b""

    async def send(self, orientation_xyzw: Quaternion = POSTURE) -> None:
        """Send one reading, if the device's format can express it."""
        if data := self.encoded(orientation_xyzw):
            await self.device.send(data)

    async def hear(self, failure: str, orientation_xyzw: Quaternion = POSTURE, remedy: str = "") -> None:
        """Send a reading until it is delivered. Raises CheckFailedError if it is not."""
        self.readings.clear()

        def is_received() -> bool:
            return any(shows(reading, orientation_xyzw) for reading in self.readings)

        await self.until(is_received, failure, remedy, lambda: self.send(orientation_xyzw))
        self.require_running()

    def require_running(self) -> None:
        """Raise CheckFailedError if `run` has ended, or a reading was none."""
        super().require_running()
        require(not self.wrong, self.wrong, "Drop a reading whose norm is not finite or not nearly 1")

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
        are_finite = all(isinstance(value, float) and math.isfinite(value) for value in raw)
        if len(raw) == 6 and are_finite:
            return ""
        return f"delivered the raw values {raw!r}, which are not two times three finite floats"
    values = reading.world_from_sensor
    are_floats = all(isinstance(value, float) for value in values)
    if len(values) != 4 or not are_floats:
        return f"delivered the orientation {values!r}, which is not four floats x, y, z, w"
    norm = sum(value * value for value in values) ** 0.5
    is_unit = abs(norm - 1.0) < 1e-3  # not NaN either
    if is_unit:
        return ""
    return f"delivered the orientation {values!r}, whose norm is {norm:.4g}, not 1"


def shows(reading: Reading | RawReading, orientation_xyzw: Quaternion) -> bool:
    """Return True if `reading` is of a sensor at rest in that orientation; a raw one shows no yaw."""
    if isinstance(reading, Reading):
        return is_near(reading.world_from_sensor, orientation_xyzw)
    up = rotation.rotate(rotation.inverse(orientation_xyzw), (0.0, 0.0, 1.0))
    measured = reading.acceleration_mps2
    return any(measured) and vector.angle_between(measured, up) < NEAR_RAD


def is_near(one: Quaternion, other: Quaternion) -> bool:
    """Return True if two orientations differ by less than 0.05 rad."""
    dot = sum(a * b for a, b in zip(one, other, strict=True))
    return abs(dot) > math.cos(NEAR_RAD / 2)


def _sends(contract: "ImuSourceContract") -> bool:
    return contract.sends


class ImuSourceContract(DeviceContract):
    """Promises of an IMU source, with a fake device that stands for the real one."""

    sends: bool = True
    """False if there is no device that sends."""
    delivers: bool = True
    """False for a source without readings of its own."""

    def encode(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the bytes that the device sends for the orientation x, y, z, w.

        Raises:
            ValueError: If its format cannot express it.
        """
        raise NotImplementedError

    def trial(self) -> ImuTrial:
        """Return a trial of the source, which has not begun."""
        return ImuTrial(self)

    @promise(lambda self: self.delivers)
    async def test_delivers(self) -> None:
        """Delivers the device's orientation, a unit quaternion x, y, z, w, stamped by the given clock."""
        async with self.trial() as trial:
            last_ns = trial.clock.now_ns()
            await trial.begin()
            await trial.until(
                lambda: trial.count > 4, "fewer than five readings were delivered", "", trial.send
            )
            now_ns = trial.clock.now_ns()
            for reading in trial.readings:
                require(
                    last_ns <= reading.stamp_ns <= now_ns,
                    f"a reading has the stamp {reading.stamp_ns!r}, expected {last_ns} to {now_ns}",
                    "Take it from `surroundings.clock.now_ns()`; the device's own is `device_time_ns`",
                )
                last_ns = reading.stamp_ns
            if self.sends:
                await trial.hear("a second orientation was not delivered", OTHER_POSTURE, ORDER)

    @promise(_sends)
    async def test_bad_bytes(self) -> None:
        """Survives bytes that are no reading or no orientation, and goes on with the next that is one."""
        async with self.trial() as trial:
            await trial.begin()
            good = trial.encoded(POSTURE)
            half = len(good) // 2
            noise = random.Random(0)  # noqa: S311 - the same bytes in each run
            odd = [trial.encoded(orientation) for orientation in NO_ORIENTATIONS]
            random_pieces = [noise.randbytes(size) for size in (1, 7, 16, 100, 4096)]
            # Odd readings, cut ones, other programs' bytes, and noise
            pieces = (
                *odd,
                b"\n",
                b"\0",
                b"\xff" * 64,
                good[:half],
                good[half:],
                good[:-1],
                good + good[:half],
                b"1,2,3\n",
                b"nonsense,,,,\r\n",
                b"x" * 100_000,
                b"\n" * 100,
                re.sub(rb"\d+", b"9" * 400, good),
                *random_pieces,
            )
            for piece in filter(None, pieces):
                await trial.device.send(piece)
                await asyncio.sleep(0.005)
                trial.require_running()
            # until it is delivered: a stream is in step again only behind the end of a message
            await trial.hear("after bad bytes, no good reading was delivered", OTHER_POSTURE, SKIP)

    @promise(_sends)
    async def test_keeps_up(self) -> None:
        """Catches up after a burst of readings, and needs no more memory the longer it runs."""
        remedy = (
            "Keep no list of readings; bound every buffer (`deque(maxlen=…)`), also of an unfinished message"
        )
        # After a burst, the newest reading must not wait behind all others
        async with self.trial() as trial:
            await trial.begin()
            data = trial.encoded(POSTURE)
            for _ in range(BURST):
                await trial.device.send(data)
            await trial.hear(
                f"after {BURST} readings at once, the newest was not delivered", OTHER_POSTURE, KEEP_UP
            )

            async def flood() -> None:
                for _ in range(FLOOD_BYTES // PIECE_BYTES):
                    await trial.device.send(b"x" * PIECE_BYTES)
                await asyncio.sleep(SETTLE_S)

            async def many() -> None:
                for number in range(MANY):
                    await trial.device.send(data)
                    if number % LOT == 0:  # no more than a port's buffer holds
                        await trial.hear("of many readings, none was delivered")
                await asyncio.sleep(SETTLE_S)  # the loop forgets cancelled timers later

            await require_bounded_memory(flood, f"{FLOOD_BYTES} bytes without a reading", remedy)
            await trial.hear("after many bytes without a reading, none was delivered", POSTURE, SKIP)
            await require_bounded_memory(many, f"{MANY} readings", remedy)

    @promise(_sends)
    async def test_warns(self) -> None:
        """Waits for a device, or a port, that is not there yet, and warns until it is."""
        async with self.trial() as trial:
            if isinstance(trial.device, UdpDevice):
                with trial.device.take_program_port():
                    await trial.start()
                    await trial.warned("another program had its port")
            else:
                await trial.start()
                await trial.warned()
            await trial.plug()
            await trial.until(
                lambda: not trial.health.warnings,
                "the device was there and a warning stayed",
                "Clear it when a reading arrives",
                trial.send,
            )

    @promise(_sends)
    async def test_reconnects(self) -> None:
        """Reconnects after the device has vanished, and tells that it did."""
        async with self.trial() as trial:
            await trial.begin()
            for _ in range(2):
                count = trial.reconnections
                await trial.replug()
                require(
                    trial.reconnections > count or not trial.device.is_connected,
                    "the device came back and no `Reconnected` was delivered before its reading",
                    "Deliver it when a connection is open: a restarted device may have turned its yaw",
                )

    @promise()
    async def test_silence(self) -> None:
        """Waits through silence, without using the processor."""
        async with self.trial() as trial:
            await trial.begin()
            if self.virtual_time:
                await asyncio.sleep(VIRTUAL_SILENCE_S)
                return
            # One quick look is not enough: the median of several leaves out a garbage collection
            shares: list[float] = []
            for _ in range(TRIES):
                began_s = time.monotonic()
                cpu_s = time.process_time()
                await asyncio.sleep(SILENCE_S)
                used_s = time.process_time() - cpu_s
                shares.append(used_s / (time.monotonic() - began_s))
            used = statistics.median(shares)
            require(
                used <= MAX_CPU,
                f"while nothing arrived it used {used:.0%} of a processor core",
                "Await the next bytes instead of asking for them in a loop",
            )
            await trial.exchange("a silence ended")
