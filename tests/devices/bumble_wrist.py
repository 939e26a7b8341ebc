"""A wrist on Google's Bluetooth stack `bumble`: it advertises, and serves its characteristics by GATT."""

import asyncio
import contextlib
import itertools
from collections.abc import Callable, Sequence

from bumble import core, gatt
from bumble.controller import Controller
from bumble.device import Connection, Device
from bumble.hci import Address
from bumble.host import Host
from bumble.link import LocalLink
from bumble.transport.common import AsyncPipeSink

from pointit.plugins import Quaternion
from pointit_lab.devices.wrists.wrist import SimulatedWrist

PROPERTIES: dict[str, gatt.Characteristic.Properties] = {
    "read": gatt.Characteristic.Properties.READ,
    "write": gatt.Characteristic.Properties.WRITE,
    "write-without-response": gatt.Characteristic.Properties.WRITE_WITHOUT_RESPONSE,
    "notify": gatt.Characteristic.Properties.NOTIFY,
}
numbers = itertools.count(1)


async def virtual_device(link: LocalLink, name: str) -> Device:
    """Return a bumble device with a controller of its own on `link`, powered on."""
    address = f"F0:F1:F2:F3:{next(numbers) % 256:02X}:FF"
    controller = Controller(name, link=link, public_address=address)
    host = Host(controller, AsyncPipeSink(controller))
    device = Device(name=name, address=Address(address), host=host)
    await device.power_on()
    return device


class BumbleWrist:
    """A wrist that advertises and serves its characteristics."""

    def __init__(self, device: Device, wrist: SimulatedWrist) -> None:
        self.device = device
        self.wrist = wrist
        self.connections = 0
        """Number of connections so far."""
        self.drops_at_once = False
        """True if it drops each connection when it is made."""
        self._connection: Connection | None = None
        self._characteristics: dict[str, gatt.Characteristic[bytes]] = {}
        for uuid, properties in wrist.characteristics.items():
            self._characteristics[uuid] = self._characteristic(uuid, properties)
        device.add_service(gatt.Service(wrist.service, [*self._characteristics.values()]))
        device.on("connection", self._on_connection)

    @property
    def address(self) -> str:
        """Return its address as bleak shows it."""
        return self.device.random_address.to_string(with_type_qualifier=False)

    @property
    def is_connected(self) -> bool:
        return self._connection is not None

    @property
    def is_subscribed(self) -> bool:
        """Return True while notifications are subscribed to."""
        subscriptions = self.device.gatt_server.subscribers.values()
        return any(any(each[:1] == b"\1" for each in values.values()) for values in subscriptions)

    async def appear(self) -> None:
        """Advertise, also after each connection."""
        kinds = core.AdvertisingData
        wrist = self.wrist
        service = bytes(core.UUID(wrist.advertised_service or wrist.service))
        name = (kinds.COMPLETE_LOCAL_NAME, wrist.name.encode())
        data = [(kinds.COMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS, service)]
        for company, value in wrist.manufacturer_data.items():
            data.append((kinds.MANUFACTURER_SPECIFIC_DATA, company.to_bytes(2, "little") + value))
        rest = [] if wrist.manufacturer_data else [name]  # 31 bytes hold no name beside them
        await self.device.start_advertising(
            advertising_data=bytes(kinds([*data, *rest])),
            scan_response_data=bytes(kinds([name])),
            auto_restart=True,
        )

    async def vanish(self) -> None:
        """End the connection and advertise no longer."""
        with contextlib.suppress(Exception):
            await self.device.stop_advertising()
        if self._connection is not None:
            await self._connection.disconnect()
        with contextlib.suppress(Exception):
            await self.device.stop_advertising()

    async def send(self, characteristic: str, data: bytes) -> None:
        """Notify of `data`, if that was subscribed to."""
        if self._connection is not None:
            await self.device.notify_subscribers(self._characteristics[characteristic], data)

    async def stream(self, rate_hz: float, orientation: Callable[[], Quaternion]) -> None:
        """Send readings for ever, while the wrist is configured."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            due_s += 1.0 / rate_hz
            await asyncio.sleep(due_s - loop.time())
            if self.wrist.is_streaming:
                await self.send(self.wrist.stream, self.wrist.frame(orientation()))

    def _characteristic(self, uuid: str, properties: Sequence[str]) -> gatt.Characteristic[bytes]:
        async def write(_connection: Connection, value: bytes) -> None:
            for answer in self.wrist.write(uuid, value):
                await self.send(*answer)

        def read(_connection: Connection) -> bytes:
            return self.wrist.values[uuid]

        flags = gatt.Characteristic.Properties(0)
        for each in properties:
            flags |= PROPERTIES[each]
        permissions = gatt.Characteristic.READABLE | gatt.Characteristic.WRITEABLE
        return gatt.Characteristic(uuid, flags, permissions, gatt.CharacteristicValue(read=read, write=write))

    def _on_connection(self, connection: Connection) -> None:
        self.connections += 1
        self._connection = connection
        connection.on("disconnection", self._on_disconnection)
        self.wrist.connected()
        if self.drops_at_once:
            self._dropping = asyncio.ensure_future(connection.disconnect())

    def _on_disconnection(self, _reason: int) -> None:
        self._connection = None
