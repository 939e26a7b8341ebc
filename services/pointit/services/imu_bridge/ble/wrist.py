"""Interface of one kind of wrist: its advertisements, its commands, and its notifications."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.schemas import Feedback
from pointit.services.imu_bridge.ble.button import ButtonChange
from pointit.services.imu_bridge.ble.radio import Advertisement
from pointit.services.imu_bridge.reading import Item

if TYPE_CHECKING:
    from bleak import BleakClient


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

    address: str = Field(
        default="",
        description="address (macOS: its identifier), serial number or first letters of the name, as "
        "`pointit devices` lists them; the first one found if empty",
    )
    sensor: str = Field(default="", description="the same as `address`, as for other kinds of sources")
    adapter: str = Field(
        default="", description="Bluetooth adapter on Linux, such as hci1; the system's usual one if empty"
    )

    @property
    def wanted(self) -> str:
        """Return the address, serial number or first letters of the name that is wanted, or `""`."""
        return self.sensor or self.address


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
        return advertisement.name.startswith(self.names) or bool(self.services & advertisement.services)


class Connection:
    """An open connection, as wrists use it."""

    def __init__(self, client: "BleakClient") -> None:
        self._client = client

    @property
    def is_connected(self) -> bool:
        """Return True unless the connection is known to be lost."""
        return bool(self._client.is_connected)

    async def write(self, characteristic: str, data: bytes) -> None:
        """Write without a response if the characteristic can do so: nothing waits for one."""
        found = self._client.services.get_characteristic(characteristic)
        response = found is None or "write-without-response" not in found.properties
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
