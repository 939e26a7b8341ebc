"""MetaMotion R, RL and S of MbientLab: quaternions of the board's own fusion, button, motor and LED.

The protocol is written from public byte facts and was tested against a simulated board over a complete
Bluetooth stack of others, never against a real one.
"""

import asyncio
from collections.abc import Iterable, Sequence

from pydantic import Field

from pointit.schemas import Feedback
from pointit.services.imu_bridge.ble import metamotion_protocol as protocol
from pointit.services.imu_bridge.ble.ble_source import BleSource
from pointit.services.imu_bridge.ble.button import ButtonChange
from pointit.services.imu_bridge.ble.discovery import discover_ble
from pointit.services.imu_bridge.ble.radio import require_bleak
from pointit.services.imu_bridge.ble.wrist import BleConfig, Connection, Kind, LinkError, Wrist, WristItem
from pointit.services.imu_bridge.reading import Battery, Item, Reading
from pointit.services.imu_bridge.sources import ImuSource

REPLY_S = 2.0
"""Time limit of a reply, s."""
RESUME_S = 0.3
"""Time in which a board that has run on after a lost connection sends again, s."""
RESUMED = 3
"""Number of quaternions that show this; a single one may be a stale one of the operating system."""
FUSION, GYRO, ACCELEROMETER = 0x19, 0x13, 0x03


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
        services=frozenset({protocol.SERVICE}),
    )
    notifications = (protocol.NOTIFY,)

    def __init__(self, config: MetaMotionConfig) -> None:
        self._config = config
        self._modules: dict[int, asyncio.Future[protocol.ModuleInfo]] = {}
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
        try:
            async with asyncio.timeout(RESUME_S):
                await self._runs_on.wait()
        except TimeoutError:
            return False
        await connection.write(protocol.COMMAND, protocol.FAST_INTERVAL)  # holds for one connection
        return True

    async def configure(self, connection: Connection) -> None:
        """Identify the chips, remove what an earlier program left, and start the fusion."""
        accelerometer = protocol.ACCELEROMETERS.get(
            await self._implementation(connection, protocol.READ_ACCELEROMETER, ACCELEROMETER)
        )
        await self._implementation(connection, protocol.READ_GYRO, GYRO)
        await self._implementation(connection, protocol.READ_FUSION, FUSION)
        if accelerometer is None:
            raise LinkError("has an accelerometer that is not known here: only R, RL and S can be used")
        commands = protocol.start(accelerometer, magnetometer=self._config.magnetometer)
        self._configured = ""
        for command in (*protocol.teardown(), *commands):
            await connection.write(protocol.COMMAND, command)
        self._configured = self._address

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification."""
        del characteristic
        found = protocol.parse(data)
        match found:
            case protocol.Orientation():
                self._count += 1
                if self._count >= RESUMED:
                    self._runs_on.set()
                return (Reading(stamp_ns, found.orientation_xyzw),)
            case protocol.ButtonState():
                return (ButtonChange(found.is_down),)
            case protocol.ModuleInfo():
                if (waiting := self._modules.get(found.module)) is not None and not waiting.done():
                    waiting.set_result(found)
            case protocol.Charge():
                return (Battery(found.level, found.volts),)
            case None:
                pass
        return ()

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Ask for the battery, which the board tells in a notification."""
        await connection.write(protocol.COMMAND, protocol.READ_BATTERY)
        return ()

    async def reset(self, connection: Connection) -> None:
        """Restart the board, which ends the connection."""
        self._configured = ""
        await connection.write(protocol.COMMAND, protocol.SOFT_RESET)

    async def stop(self, connection: Connection) -> None:
        """End the fusion, and the LED."""
        for command in (*protocol.stop(), protocol.STOP_LED):
            await connection.write(protocol.COMMAND, command)

    def cue(self, feedback: Feedback) -> Sequence[tuple[float, bytes]]:
        """Return commands for the motor and the LED."""
        return protocol.cue(feedback)

    async def play(self, connection: Connection, command: bytes) -> None:
        """Write one of them."""
        await connection.write(protocol.COMMAND, command)

    async def _implementation(self, connection: Connection, command: bytes, module: int) -> int:
        """Return the implementation of a module. Raises LinkError if the board has none."""
        reply: asyncio.Future[protocol.ModuleInfo] = asyncio.get_running_loop().create_future()
        self._modules[module] = reply
        await connection.write(protocol.COMMAND, command)
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
    argument="address",
    argument_optional=True,
    discover=discover_ble(MetaMotion.kind),
)
