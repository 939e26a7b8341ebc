"""MetaMotion R, RL and S of MbientLab: quaternions of the board's fusion, button, motor.

    frame = module register data*        read: register | 0x80, which the reply repeats

Readings of the fusion contain no time and no sequence number. Without its complete configuration, the fusion
sends zeros or nothing.

The protocol is written from public byte facts and was tested against a simulated board over a complete
Bluetooth stack of others, never against a real one.

No core: it waits for a radio.
"""

import asyncio
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from pointit.runtime.clock import wait_up_to
from pointit.schemas import Feedback
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.ble.ble_source import BleSource, discover_ble
from pointit.services.imu_bridge.ble.radio import require_bleak
from pointit.services.imu_bridge.ble.wrist import (
    BleConfig,
    ButtonChange,
    Connection,
    Kind,
    LinkError,
    Wrist,
    WristItem,
    vibration_pulses,
)
from pointit.services.imu_bridge.sources import Battery, ImuSource, Item, Reading

Accelerometer = Literal["BMI160", "BMI270"]

SERVICE = "326a9000-85cb-9195-d9dd-464cfbbae75a"
COMMAND = "326a9001-85cb-9195-d9dd-464cfbbae75a"
NOTIFY = "326a9006-85cb-9195-d9dd-464cfbbae75a"
READ = 0x80
ACCELEROMETERS: dict[int, Accelerometer] = {1: "BMI160", 4: "BMI270"}
"""Accelerometers by the implementation that their module states."""
READ_GYRO = bytes.fromhex("1380")
READ_ACCELEROMETER = bytes.fromhex("0380")
READ_FUSION = bytes.fromhex("1980")
READ_BATTERY = bytes.fromhex("118c")
SOFT_RESET = bytes.fromhex("fe01")
FAST_INTERVAL = bytes.fromhex("1109060006000000" + "5802")
"""Asks for a connection interval of 7.5 ms, latency 0 and a time-out of 6 s."""
STOP_LED = bytes.fromhex("020201")
PLAY_LED = bytes.fromhex("020101")
FULL_DUTY = 0xF8
MAX_LED = 31
"""Largest intensity of a colour."""
FLASH_MS = 300
_LED_CHANNELS = ((0, 1), (1, 0), (2, 2))
"""Number of a colour on the board, and its place in red, green, blue."""

REPLY_S = 2.0
"""Time limit of a reply, s."""
RESUME_S = 0.3
"""Time in which a board that has run on after a lost connection sends again, s."""
RESUMED = 3
"""Number of quaternions that show this; a single one may be a stale one of the operating system."""
FUSION = 0x19
GYRO = 0x13
ACCELEROMETER = 0x03


@dataclass(frozen=True, slots=True)
class ModuleInfo:
    """Reply to a read of register 0: a module's implementation, or None if it has none."""

    module: int
    implementation: int | None


def parse(frame: bytes, stamp_ns: int) -> Reading | Battery | ButtonChange | ModuleInfo | None:
    """Return the content of a notification, or None if it is another one or broken."""
    if len(frame) < 2:
        return None
    module = frame[0]
    register = frame[1]
    data = frame[2:]
    if register == READ:
        return ModuleInfo(module, data[0] if len(data) >= 2 else None)
    if (module, register) == (0x19, 0x07) and len(data) == 16:
        w, x, y, z = struct.unpack("<4f", data)
        try:
            return Reading(stamp_ns, unit_quaternion((x, y, z, w)))
        except ValueError:  # zeros are a fusion that is not configured
            return None
    if (module, register) == (0x01, 0x01) and len(data) == 1:
        return ButtonChange(data[0] != 0)
    if (module, register) == (0x11, 0x8C) and len(data) == 3:
        return Battery(min(data[0], 100) / 100.0, int.from_bytes(data[1:], "little") / 1000.0)
    return None


def teardown() -> tuple[bytes, ...]:
    """Return commands that remove what an earlier program left: processors, events, loggers, the stream."""
    return (bytes.fromhex("0908"), bytes.fromhex("0a05"), bytes.fromhex("0b0a"), *stop())


def stop() -> tuple[bytes, ...]:
    """Return commands that end the fusion and its sensors."""
    texts = (
        "190100", "1903007f", "030100", "130100", "03020001", "13020001", "150100", "15020001",
        "190700", "010100",
    )  # fmt: skip
    return tuple(bytes.fromhex(text) for text in texts)


def start(accelerometer: Accelerometer, *, magnetometer: bool) -> tuple[bytes, ...]:
    """Return the whole configuration of quaternions at 100 Hz, and its start.

    Six axes (`IMU_PLUS`), or with the `magnetometer` nine (`NDOF`); ±16 g, 2000 °/s.
    """
    # Mode of the fusion, and the ranges and rates of its sensors
    texts = [
        "19020113" if magnetometer else "19020213",
        "0303280c" if accelerometer == "BMI160" else "0303a803",
        "13032800",
    ]
    if magnetometer:
        texts += ["1504040e", "150306"]

    # Notify quaternions, and sample
    texts += ["190701", "03020100", "13020100"]
    if magnetometer:
        texts.append("15020100")

    # Start the sensors, then the fusion that reads them, then the button
    texts += ["030101", "130101"]
    if magnetometer:
        texts.append("150101")
    texts += ["19030800", "190101", "010101"]
    return (*map(bytes.fromhex, texts), FAST_INTERVAL)


def buzz(duration_ms: int) -> bytes:
    """Return the command that runs the motor at full strength for some ms, at most 65535."""
    return struct.pack("<BBBHB", 0x08, 0x01, FULL_DUTY, duration_ms, 0)


def flash(color: tuple[int, int, int]) -> tuple[bytes, ...]:
    """Return commands of one flash in red, green, blue, 0 to 255 each."""
    patterns: list[bytes] = []
    for channel, place in _LED_CHANNELS:
        intensity = round(color[place] * MAX_LED / 255)
        if intensity:
            values = (channel, 0x02, intensity, 0, 0, FLASH_MS, 0, FLASH_MS, 0, 1)
            patterns.append(struct.pack("<BBBBBBHHHHHB", 0x02, 0x03, *values))
    if not patterns:
        return (STOP_LED,)
    return (STOP_LED, *patterns, PLAY_LED)


def cue(feedback: Feedback) -> list[tuple[float, bytes]]:
    """Return commands that play `feedback`, each with the pause before it, s. The motor comes first."""
    pulses = vibration_pulses(feedback.haptic_ms)
    commands = [(pause_s, buzz(duration_ms)) for pause_s, duration_ms in pulses]
    lights = () if feedback.color is None else flash(feedback.color)
    commands[1:1] = [(0.0, light) for light in lights]
    return commands


class MetaMotionConfig(BleConfig):
    """A MetaMotion R, RL or S."""

    magnetometer: bool = Field(
        default=False,
        description="use the magnetometer, too: the yaw does not drift, but steel and motors nearby bend it",
    )


class MetaMotion(Wrist):
    """The commands and the notifications of a board."""

    kind = Kind(
        label="MetaMotion",
        plugin="metamotion",
        names=("MetaWear", "MetaMotion"),
        services=frozenset({SERVICE}),
    )
    notifications = (NOTIFY,)

    def __init__(self, config: MetaMotionConfig) -> None:
        self._config = config
        self._modules: dict[int, asyncio.Future[ModuleInfo]] = {}
        self._address = ""
        self._configured = ""
        """Address of the board that this run has configured."""
        self._count = 0
        """Number of quaternions since the connection began."""
        self._runs_on = asyncio.Event()

    def begin(self, address: str) -> None:
        """Forget what was buffered: a connection to the board at `address` begins."""
        self._address = address
        self._count = 0
        self._runs_on.clear()

    async def resume(self, connection: Connection) -> bool:
        """Return True if the board still sends: one that was restarted, and lost its yaw, would not."""
        if self._configured != self._address:
            return False
        if not await wait_up_to(self._runs_on, RESUME_S):
            return False
        await connection.write(COMMAND, FAST_INTERVAL)  # holds for one connection
        return True

    async def configure(self, connection: Connection) -> None:
        """Identify the chips, remove what an earlier program left, and start the fusion."""
        implementation = await self._implementation(connection, READ_ACCELEROMETER, ACCELEROMETER)
        accelerometer = ACCELEROMETERS.get(implementation)
        await self._implementation(connection, READ_GYRO, GYRO)
        await self._implementation(connection, READ_FUSION, FUSION)
        if accelerometer is None:
            raise LinkError("has an accelerometer that is not known here: only R, RL and S can be used")
        commands = start(accelerometer, magnetometer=self._config.magnetometer)
        self._configured = ""  # until all is written: a connection that is lost meanwhile leaves a part
        for command in (*teardown(), *commands):
            await connection.write(COMMAND, command)
        self._configured = self._address

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification."""
        del characteristic
        item = parse(data, stamp_ns)
        if isinstance(item, ModuleInfo):
            reply = self._modules.get(item.module)
            if reply is not None and not reply.done():
                reply.set_result(item)
            return ()
        if isinstance(item, Reading):
            self._count += 1
            if self._count >= RESUMED:
                self._runs_on.set()
        return () if item is None else (item,)

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Ask for the battery, which the board states in a notification."""
        await connection.write(COMMAND, READ_BATTERY)
        return ()

    async def reset(self, connection: Connection) -> None:
        """Restart the board, which ends the connection."""
        self._configured = ""
        await connection.write(COMMAND, SOFT_RESET)

    async def stop(self, connection: Connection) -> None:
        """End the fusion, and the LED."""
        for command in (*stop(), STOP_LED):
            await connection.write(COMMAND, command)

    def cue(self, feedback: Feedback) -> Sequence[tuple[float, bytes]]:
        """Return commands for the motor and the LED."""
        return cue(feedback)

    async def play(self, connection: Connection, command: bytes) -> None:
        """Write one of them."""
        await connection.write(COMMAND, command)

    async def _implementation(self, connection: Connection, command: bytes, module: int) -> int:
        """Return the implementation of a module. Raises LinkError if the board has none."""
        reply: asyncio.Future[ModuleInfo] = asyncio.get_running_loop().create_future()
        self._modules[module] = reply
        await connection.write(COMMAND, command)
        async with asyncio.timeout(REPLY_S):
            info = await reply
        if info.implementation is None:
            raise LinkError("has no sensor fusion: only MetaMotion R, RL and S can be used")
        return info.implementation


METAMOTION = ImuSource(
    summary="a MetaMotion R, RL or S wristband of MbientLab, by Bluetooth",
    config=MetaMotionConfig,
    make=lambda config, around: BleSource(MetaMotion(config), config, around.clock, around.health),
    check=lambda _config: require_bleak("metamotion"),
    argument="sensor",
    argument_optional=True,
    discover=discover_ble(MetaMotion.kind),
)
