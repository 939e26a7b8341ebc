"""Interface of one kind of Bluetooth wrist: advertisements, commands, button, vibration."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.schemas import Feedback
from pointit.schemas.person import Gesture
from pointit.services.imu_bridge.ble.radio import Advertisement
from pointit.services.imu_bridge.sources import Item

if TYPE_CHECKING:
    from bleak import BleakClient

HOLD_S = 0.8
"""Minimum duration of a hold, s."""
DOUBLE_S = 0.32
"""Longest time between the releases of a double press, s."""


def vibration_pulses(haptic_ms: Sequence[int]) -> list[tuple[float, int]]:
    """Return pause before, s, and duration, ms, of each pulse of alternating times on and off."""
    pulses: list[tuple[float, int]] = []
    pause_ms = 0
    for number, duration_ms in enumerate(haptic_ms):
        if number % 2 == 0:
            pulses.append((pause_ms / 1000.0, duration_ms))
            pause_ms = 0
        pause_ms += duration_ms
    return pulses


class ButtonGestures:
    """Makes gestures of changes. All times are seconds of one clock."""

    def __init__(self) -> None:
        self._down_s: float | None = None
        self._tapped_s: float | None = None

    @property
    def due_s(self) -> float | None:
        """Return the time at which `wait` must be called next, or None if nothing is pending."""
        if self._down_s is not None:
            return self._down_s + HOLD_S
        return None if self._tapped_s is None else self._tapped_s + DOUBLE_S

    def down(self, now_s: float) -> Gesture | None:
        """Start a press. Return the previous press if it was too long ago for a double press."""
        previous = self.wait(now_s)
        if self._down_s is None:
            self._down_s = now_s
        return previous

    def up(self, now_s: float) -> Gesture | None:
        """End a press. Return the gesture that this completes, a double press or a late hold, or None."""
        if self._down_s is None:
            return None
        hold = self.wait(now_s)
        if hold is not None:
            return hold
        self._down_s = None
        if self._tapped_s is not None and now_s <= self._tapped_s + DOUBLE_S:
            self._tapped_s = None
            return "double"
        self._tapped_s = now_s
        return None

    def wait(self, now_s: float) -> Gesture | None:
        """Return the gesture that is complete by `now_s` because nothing else happened, or None."""
        if self._down_s is not None:
            if now_s >= self._down_s + HOLD_S:  # as in `due_s`, to the last bit
                self._down_s = self._tapped_s = None
                return "hold"
        elif self._tapped_s is not None and now_s >= self._tapped_s + DOUBLE_S:
            self._tapped_s = None
            return "press"
        return None


@dataclass(frozen=True, slots=True)
class ButtonChange:
    """The button went down or up."""

    is_down: bool


class LinkError(Exception):
    """The connection cannot be used. The message is a clause without its subject, the wrist."""

    def __init__(self, clause: str, pause_s: float = 0.0) -> None:
        """Set the message, and the minimum pause before the next connection, s."""
        super().__init__(clause)
        self.pause_s = pause_s


WristItem = Item | ButtonChange | LinkError
"""Item of a notification. A LinkError ends the connection."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Reason why a connected wrist sends nothing, if only a person can remove it."""

    clause: str
    """Reason and remedy, for people; its subject is the wrist."""
    timeout_s: float
    """Silence after which the connection is given up, s. Operating systems may show one that is none."""


class BleConfig(Config):
    """The wrist among those within reach, and the adapter that reaches it."""

    sensor: str = Field(
        default="",
        description="address (macOS: its identifier), serial number or first letters of the name, as "
        "`pointit devices` lists them; the first one found if empty",
    )
    adapter: str = Field(
        default="", description="Bluetooth adapter on Linux, such as hci1; the system's usual one if empty"
    )


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of wrist, by its advertisements."""

    label: str
    """Name for people."""
    plugin: str
    """Name of its source, as in parameters."""
    names: tuple[str, ...]
    """First letters of its advertised names."""
    services: frozenset[str] = frozenset()
    """Services that only this kind advertises."""
    identify: Callable[[Advertisement], str] = lambda advertisement: advertisement.address
    """Returns the text that chooses a wrist, as a parameter and for the next connection."""
    has_serial_number: bool = True
    """True if a wrist states its serial number, by which it can be chosen, when it is connected."""

    def includes(self, advertisement: Advertisement) -> bool:
        """Return True if `advertisement` is that of such a wrist."""
        has_name = advertisement.name.startswith(self.names)
        return has_name or bool(self.services & advertisement.services)


class Connection:
    """An open connection, as wrists use it."""

    def __init__(self, client: "BleakClient") -> None:
        self._client = client

    @property
    def is_connected(self) -> bool:
        """Return True unless the connection is known to be lost."""
        return self._client.is_connected

    async def write(self, characteristic: str, data: bytes) -> None:
        """Write without a response if the characteristic can do so: nothing waits for one."""
        gatt_characteristic = self._client.services.get_characteristic(characteristic)
        response = True
        if gatt_characteristic is not None:
            response = "write-without-response" not in gatt_characteristic.properties
        await self._client.write_gatt_char(characteristic, data, response)

    async def read(self, characteristic: str) -> bytes:
        """Return the value of a characteristic."""
        return bytes(await self._client.read_gatt_char(characteristic))


class Wrist(ABC):
    """One kind of wrist. Its link connects it, passes on its notifications and keeps it alive."""

    kind: Kind
    notifications: tuple[str, ...]
    """Characteristics that notify."""
    is_ready: bool = True
    """False while it waits for a person's approval and cannot be asked for anything."""

    @property
    def obstacle(self) -> Obstacle | None:
        """Obstacle while it is silent. None: it is configured again, then reset."""
        return None

    def begin(self, address: str) -> None:  # noqa: B027 - most need nothing
        """Forget what was buffered: a connection to the device at `address` begins."""

    async def resume(self, connection: Connection) -> bool:  # noqa: ARG002 - for those that can
        """Return True if the device has run on since the last connection and needs no configuration."""
        return False

    @abstractmethod
    async def configure(self, connection: Connection) -> None:
        """Write the whole configuration and start the stream.

        Raises:
            LinkError: If it is not a device that can be used.
        """

    @abstractmethod
    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification. `data` may be anything."""

    async def ask(self, connection: Connection) -> Iterable[Item]:  # noqa: ARG002 - not all can
        """Request values that the wrist does not send by itself, such as the battery. Called every minute."""
        return ()

    async def reset(self, connection: Connection) -> None:  # noqa: B027 - not all can
        """Restart the device, which has stayed silent after a configuration."""

    async def stop(self, connection: Connection) -> None:  # noqa: B027 - not all can
        """End the stream."""

    def cue(self, feedback: Feedback) -> Sequence[tuple[float, bytes]]:  # noqa: ARG002 - not all can
        """Return commands that play `feedback`, each after a pause in s."""
        return ()

    async def play(self, connection: Connection, command: bytes) -> None:  # noqa: B027 - not all can
        """Write one command of `cue`."""
